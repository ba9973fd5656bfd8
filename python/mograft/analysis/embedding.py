"""One vector per segment and joint group: resampled, aligned, reduced (paper, 4.1.3 and 4.2)."""

import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Protocol

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray, Packed
from mograft._util.linalg import eigen, gram, product
from mograft.analysis.segmentation import Segments
from mograft.config import FRAME, Config
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.resample import resample_segment_positions, resample_segments

__all__ = [
    "Embedding",
    "Samples",
    "Source",
    "embed",
    "features",
    "means_of",
    "normalise",
    "pca",
]

CHUNK = 1024
"""Segments that are held at a time. Sums are taken chunk by chunk in the order of segments, so
that their last bits depend on this number and on nothing else."""

_AT_HAND = 1 << 27
"""Bytes of features that are kept between two passes."""

_STILL = 1e-6
"""Features that vary by less are dropped: samples are kept in single precision, whose grain
is 6e-8 for a rotation, and what is below it is no motion."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Segments of equal length, in the same place and, if wanted, facing the same way.

    Attributes
    ----------
    rows : ndarray, shape (n_segments, 4·samples·joints + 3·samples + 1)
        A row per segment, as libraries keep it, in single precision, or as it is computed.
        Local rotations, sample by sample, those of the locomotion root in the world; the
        root's way from the sample before, in skeleton heights, 0 at the first; the length
        before resampling, in frames of 1/30 s.
    n_samples, n_joints : int
        Samples per segment, and joints of each.
    """

    rows: Packed | FloatArray
    n_samples: int
    n_joints: int

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def rotations(self) -> Packed | FloatArray:
        """The rotations, a view of shape (n_segments, n_samples, n_joints, 4)."""
        end = 4 * self.n_samples * self.n_joints
        return self.rows[:, :end].reshape(len(self), self.n_samples, self.n_joints, 4)

    @property
    def rest(self) -> Packed | FloatArray:
        """What stands behind the rotations, shape (n_segments, 3·samples + 1)."""
        return self.rows[:, 4 * self.n_samples * self.n_joints :]

    def packed(self) -> Packed:
        """Return the rows in single precision, as libraries keep them."""
        return self.rows.astype(np.float32, copy=False)

    def chunks(self) -> "Iterator[Samples]":
        """Yield `CHUNK` segments at a time."""
        for start in range(0, len(self), CHUNK):
            yield replace(self, rows=self.rows[start : start + CHUNK])


class Source(Protocol):
    """Samples of segments, wherever they are kept."""

    def __len__(self) -> int:
        """Return the number of segments."""
        ...

    def chunks(self) -> Iterator[Samples]:
        """Yield `CHUNK` segments at a time."""
        ...


@dataclass(frozen=True, eq=False)
class Embedding:
    """Segments of one joint group as points whose distances compare motions.

    Attributes
    ----------
    points : ndarray, shape (n_segments, n_components)
        Principal component scores.
    joints : ndarray of int
        The joints whose rotations count.
    has_root : bool
        Whether the root's rotation, heading removed, and its way are among the features.
    reference : ndarray, shape (n_joints, 4)
        Mean rotation of each joint, from which rotation vectors are taken.
    mean, scale : ndarray, shape (n_features,)
        Subtracted from and divided into a feature; a scale of infinity drops it.
    components : ndarray, shape (n_features, n_components)
        Orthonormal columns; the largest entry of each is positive.
    variances : ndarray
        Variance along all principal components, descending.
    """

    points: FloatArray
    joints: IntArray
    has_root: bool
    reference: FloatArray
    mean: FloatArray
    scale: FloatArray
    components: FloatArray
    variances: FloatArray

    def __repr__(self) -> str:
        n, axes = self.points.shape
        part = self.variances[:axes].sum() / max(self.variances.sum(), np.finfo(float).tiny)
        return f"Embedding({n} points of {axes} axes, {part:.0%} of the variance)"

    def project(self, matrix: FloatArray) -> FloatArray:
        """Return the points of feature vectors, shape (n, n_features) to (n, n_components)."""
        return product((matrix - self.mean) / self.scale, self.components)


def normalise(
    clips: Sequence[Motion],
    cut: Segments,
    config: Config,
    *,
    root: int,
    up: int,
    heights: Sequence[float],
) -> Samples:
    """Resample all segments to the same number of frames and take out where they are.

    Parameters
    ----------
    clips : sequence of Motion
        Of one hierarchy.
    cut : Segments
        Their segments, clip by clip.
    config : Config
        Gives `samples` and `keep_heading`.
    root : int
        The joint that carries the body through the world.
    up : int
        The axis that points up: 0, 1 or 2.
    heights : sequence of float
        Each clip's skeleton height in its file's unit.

    Returns
    -------
    Samples
        The segments in the order of `cut`.
    """
    m = config.samples
    rows = []
    for index, clip in enumerate(clips):
        own = cut.of_clip(index)
        bounds = (cut.start[own], cut.stop[own], np.full(len(own), m))
        sampled = resample_segments(clip.rotations, *bounds).reshape(len(own), m, clip.n_joints, 4)
        if root == 0:
            carried, place = sampled[:, :, 0], clip.positions[:, :1]
        else:
            turned, placed = clip.world_transforms()
            carried = resample_segments(turned[:, root : root + 1], *bounds).reshape(len(own), m, 4)
            place = placed[:, root : root + 1]
        way = np.zeros((len(own), m, 3))
        place = resample_segment_positions(place, *bounds).reshape(len(own), m, 3) / heights[index]
        way[:, 1:] = np.diff(place, axis=1)
        if not config.keep_heading:
            back = rotations.inverse(_headings(carried[:, 0], up))[:, None]
            carried, way = rotations.multiply(back, carried), rotations.rotate(back, way)
        sampled[:, :, root] = carried
        lengths = cut.lengths[own] * clip.frame_time / FRAME
        parts = [sampled.reshape(len(own), -1), way.reshape(len(own), -1), lengths[:, None]]
        rows.append(np.concatenate(parts, axis=1))
    return Samples(np.concatenate(rows), m, clips[0].n_joints)


def _headings(first: FloatArray, up: int) -> FloatArray:
    """Return the turn about up in each segment's first pose, shape (n_segments, 4).

    Upside down, facing up or down, a pose has none; the segment before lends its own.
    """
    parts = first[:, [up, 3]]
    has_none = np.hypot(*parts.T) < 1e-6
    known = np.where(has_none, 0, np.arange(len(first)))
    headings: FloatArray = rotations.twist(first, up)[np.maximum.accumulate(known)]
    return headings


def features(
    samples: Samples, joints: IntArray, reference: FloatArray, *, has_root: bool
) -> FloatArray:
    """Return the feature vectors of one joint group.

    Parameters
    ----------
    samples : Samples
        The normalised segments.
    joints : ndarray of int
        The group's joints.
    reference : ndarray, shape (len(joints), 4)
        The rotation from which each joint's rotation vectors are taken.
    has_root : bool
        Whether to add the root's way.

    Returns
    -------
    ndarray, shape (n_segments, 3·joints·samples [+ 3·samples] + 1)
        Per joint and sample a rotation vector in radians, then the root's steps in skeleton
        heights, then the length in frames of 1/30 s.
    """
    return _core.features(
        samples.rows,
        (samples.n_samples, samples.n_joints),
        joints,
        reference,
        (3 * samples.n_samples if has_root else 0) + 1,
        os.cpu_count() or 1,
    )


def moments(samples: Samples) -> FloatArray:
    """Return each joint's Σ q qᵀ, from which `mean_rotations` tells the mean.

    Parameters
    ----------
    samples : Samples
        The normalised segments.

    Returns
    -------
    ndarray, shape (n_joints, 4, 4)
        Those of several sets add up to those of their union.
    """
    return _core.moments(samples.rows, (samples.n_samples, samples.n_joints))


def mean_rotations(summed: FloatArray) -> FloatArray:
    """Return the mean rotation of each joint.

    Parameters
    ----------
    summed : ndarray, shape (n_joints, 4, 4)
        What `moments` returns.

    Returns
    -------
    ndarray, shape (n_joints, 4)
        For each joint the unit quaternion with the greatest Σ (q·mean)², w ≥ 0: the signs of
        the quaternions do not matter (Markley et al. 2007).
    """
    means = np.linalg.eigh(summed)[1][..., -1]
    signed: FloatArray = np.where(means[:, 3:] < 0, -means, means)
    return signed


@dataclass(frozen=True, eq=False)
class Spread:
    """Mean and scatter of rows, gathered chunk by chunk.

    Attributes
    ----------
    n : int
        Number of rows.
    mean : ndarray, shape (n_features,)
        Their mean.
    scatter : ndarray, shape (n_features, n_features)
        Σ (row - mean)(row - mean)ᵀ.
    """

    n: int
    mean: FloatArray
    scatter: FloatArray

    @classmethod
    def of(cls, chunks: Iterable[FloatArray]) -> "Spread":
        """Gather chunks of rows, at least one, in their order.

        Notes
        -----
        Each chunk is centred on its own mean before it is squared, and the chunks are joined
        by Chan, Golub and LeVeque's rule, so that nothing cancels and a feature that never
        varies has a scatter of zero but for rounding.
        """
        n, mean, scatter = 0, np.zeros(0), np.zeros((0, 0))
        for rows in chunks:
            own = rows.mean(axis=0)
            centred = rows - own
            within = gram(centred)
            if not n:
                n, mean, scatter = len(rows), own, within
                continue
            apart, whole = own - mean, n + len(rows)
            scatter += within
            scatter += np.outer(apart, apart) * (n * len(rows) / whole)
            mean = mean + apart * (len(rows) / whole)
            n = whole
        return cls(n, mean, scatter)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of each feature, with n - 1; 0 for a single row."""
        deviation: FloatArray = np.sqrt(np.diag(self.scatter) / max(self.n - 1, 1))
        return deviation


def pca(
    spread: Spread, n_components: int, floors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Find the principal components of standardised features (correlation matrix).

    Parameters
    ----------
    spread : Spread
        Of the features of all segments.
    n_components : int
        Components kept, at most; never more than the rank.
    floors : ndarray, shape (n_features,)
        Least standard deviation to divide by. Features that vary by less than 1e-6 are
        dropped.

    Returns
    -------
    scale : ndarray, shape (n_features,)
        What to divide by once the mean is subtracted; infinite where a feature is dropped.
    components : ndarray, shape (n_features, n_components)
        Orthonormal columns by descending variance; the largest entry of each is positive.
    variances : ndarray, shape (n_features,)
        Variance along every principal component, descending.
    """
    deviation = spread.deviation
    scale = np.where(deviation < _STILL, np.inf, np.maximum(deviation, floors))
    standard = spread.scatter / (spread.n - 1) / scale / scale[:, None]
    variances, vectors = eigen(standard, min(n_components, spread.n - 1))
    rank = int((variances > 1e-12 * max(variances[0], 0.0)).sum())
    kept = vectors[:, :rank]
    largest = np.take_along_axis(kept, np.abs(kept).argmax(axis=0)[None], axis=0)
    return scale, kept * np.where(largest < 0, -1.0, 1.0), np.maximum(variances, 0.0)


def means_of(samples: Source, n_joints: int) -> FloatArray:
    """Return the mean rotation of each joint in all segments, shape (n_joints, 4)."""
    summed = np.zeros((n_joints, 4, 4))
    for part in samples.chunks():
        summed += moments(part)
    return mean_rotations(summed)


def embed(
    samples: Source,
    joints: IntArray,
    means: FloatArray,
    config: Config,
    *,
    root: int,
    group: str,
) -> Embedding | None:
    """Embed the segments of one joint group.

    Parameters
    ----------
    samples : Samples or other source of them
        The normalised segments. They are gone through twice, a chunk at a time.
    joints : ndarray of int
        The group's joints whose rotations count.
    means : ndarray, shape (n_joints, 4)
        The mean rotation of each joint of the skeleton.
    config : Config
        Gives `components`, the floors and `keep_heading`.
    root : int
        The joint that carries the body through the world.
    group : str
        The group's name, for warnings.

    Returns
    -------
    Embedding or None
        None, with a warning, where there is nothing to compare: fewer than three segments,
        or all of them alike.
    """
    n, n_joints = len(samples), len(joints)
    has_root = bool((joints == root).any())
    reference = means[joints]
    if has_root and not config.keep_heading:
        reference[joints == root] = rotations.IDENTITY

    at_hand: list[FloatArray] = []

    def matrices() -> Iterator[FloatArray]:
        yield from at_hand
        known = len(at_hand)
        if known * CHUNK >= n:
            return
        for number, part in enumerate(islice(samples.chunks(), known, None), known):
            matrix = features(part, joints, reference, has_root=has_root)
            # Features are computed anew for the second pass, but for the first that fit.
            if number == len(at_hand) and 8 * matrix.size * (number + 1) <= _AT_HAND:
                at_hand.append(matrix)
            yield matrix

    n_rotations = 3 * config.samples * n_joints
    near_the_cut = _NearTheCut(n_rotations)
    spread = Spread.of(map(near_the_cut.seen, matrices()))
    near_the_cut.warn(group)
    # Lengths alone are nothing to go by: a motion without motion is cut evenly.
    if n < 3 or (spread.deviation[:-1] < _STILL).all():
        few = f"{n} segment{'s are' if n > 1 else ' is'} too few to compare"
        what = few if n < 3 else f"all {n} segments are alike"
        warnings.warn(f"group {group}: {what}; each is left by itself", stacklevel=2)
        return None
    floors = np.full(len(spread.mean), config.rotation_floor)
    floors[n_rotations:-1] = config.position_floor
    floors[-1] = config.length_floor
    scale, components, variances = pca(spread, config.components, floors)
    own = Embedding(
        np.empty((0, components.shape[1])),
        joints,
        has_root,
        reference,
        spread.mean,
        scale,
        components,
        variances,
    )
    return replace(own, points=np.concatenate([own.project(matrix) for matrix in matrices()]))


class _NearTheCut:
    """How many rotation vectors come near a half turn from the mean, where they jump."""

    def __init__(self, n_rotations: int) -> None:
        self._n_rotations = n_rotations
        self._near = self._whole = 0

    def seen(self, matrix: FloatArray) -> FloatArray:
        """Count a chunk's, and hand it on."""
        vectors = matrix[:, : self._n_rotations].reshape(len(matrix), -1, 3)
        squared = np.einsum("nvi,nvi->nv", vectors, vectors)
        self._near += int(np.count_nonzero(squared > (np.pi - 0.1) ** 2))
        self._whole += squared.size
        return matrix

    def warn(self, group: str) -> None:
        """Warn if they are more than one in a thousand."""
        share = self._near / max(self._whole, 1)
        if share > 0.001:
            warnings.warn(
                f"group {group}: {share:.1%} of its poses are nearly a half turn from the mean; "
                "segments that are alike there may be told apart",
                stacklevel=3,
            )
