"""One vector per segment and joint group: resampled, aligned, reduced (paper, 4.1.3 and 4.2)."""

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import islice
from typing import Protocol

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray, Packed
from mograft._util.linalg import eigenvectors, product
from mograft.config import FRAME, Config
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.resample import resample_segment_positions, resample_segments
from mograft.motion.segments import Segments

CHUNK = 1024
"""Number of segments in memory at a time. Sums run chunk by chunk in the order of segments, so
their last bits depend on this number only."""

CACHE_BYTES = 1 << 27
"""Bytes of features that are kept between the two passes."""

MIN_DEVIATION = 1e-6
"""Features with a smaller standard deviation are dropped. Samples are stored in single
precision, which rounds rotations by 6e-8."""

_MIN_VARIANCE_RATIO = 1e-6
"""Components with a smaller share of the largest variance are dropped. Their scores are below a
thousandth of the first component's, and the rounding of the samples decides their axes."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Segments resampled to equal length, without position and, by default, without heading.

    Each row has three parts. The first part has the rotations of all joints, sample by sample:
    relative to the world for the locomotion root, the joint that moves the body through the world,
    and relative to the parent for other joints. The second part has the displacements of that root
    since the previous sample in skeleton heights, 0 at the first sample. The third part is the
    length before resampling in frames of 1/30 s. Libraries store rows in single precision.
    """

    rows: Packed | FloatArray  # (n_segments, 4·samples·joints + 3·samples + 1)
    n_samples: int
    n_joints: int

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def rotations(self) -> Packed | FloatArray:
        """Quaternions of the joints, a view of shape (n_segments, n_samples, n_joints, 4)."""
        end = 4 * self.n_samples * self.n_joints
        return self.rows[:, :end].reshape(len(self), self.n_samples, self.n_joints, 4)

    @property
    def displacements_and_length(self) -> Packed | FloatArray:
        """Root displacements, then the length; a view of shape (n_segments, 3 * n_samples + 1)."""
        return self.rows[:, 4 * self.n_samples * self.n_joints :]

    def pack(self) -> Packed:
        """Return the rows in single precision, as libraries store them."""
        return self.rows.astype(np.float32, copy=False)

    def select(self, indices: IntArray) -> "Samples":
        """Return the samples of some segments, in the order of `indices`."""
        return replace(self, rows=self.rows[indices])

    def chunks(self) -> "Iterator[Samples]":
        """Yield `CHUNK` segments at a time."""
        for start in range(0, len(self), CHUNK):
            yield replace(self, rows=self.rows[start : start + CHUNK])


class Source(Protocol):
    """Interface of the samples of segments, in memory or in files."""

    def __len__(self) -> int:
        """Return the number of segments."""

    def chunks(self) -> Iterator[Samples]:
        """Yield `CHUNK` segments at a time."""


@dataclass(frozen=True, eq=False)
class Embedding:
    """The segments of one joint group as points; similar motions have a small distance."""

    points: FloatArray  # principal component scores, (n_segments, n_components)
    joints: IntArray  # the joints whose rotations are features
    has_root: bool  # whether rotation and displacements of the locomotion root are features
    reference: FloatArray  # mean rotations (n_joints, 4); features are relative to them
    mean: FloatArray  # (n_features,); a standardised feature is (x - mean) / scale
    scale: FloatArray  # (n_features,); infinite for dropped features
    components: FloatArray  # (n_features, n_components), loadings in columns, see `eigenvectors`
    variances: FloatArray  # along all principal components, descending

    def __repr__(self) -> str:
        n, axes = self.points.shape
        part = self.variances[:axes].sum() / max(self.variances.sum(), np.finfo(float).tiny)
        return f"Embedding({n} points of {axes} axes, {part:.0%} of the variance)"

    def project(self, matrix: FloatArray) -> FloatArray:
        """Return the points, shape (n, n_components), of the feature vectors in `matrix`.

        `matrix` has shape (n, n_features). The standardised features are rounded to multiples of
        2^-20, so that the bits of a point depend neither on the other feature vectors nor on the
        number of BLAS threads.
        """
        return product((matrix - self.mean) / self.scale, self.components)


def normalise(
    clips: Sequence[Motion],
    cut: Segments,
    config: Config,
    *,
    root: int,
    up: int,
    heights: Sequence[float],
    is_packed: bool = False,
) -> Samples:
    """Resample all segments to `config.samples` frames; remove position and heading.

    `cut` has the segments of all clips, whose skeletons have the same hierarchy. `root` is the
    locomotion root, the joint that moves the body through the world; `up` is the vertical axis,
    0 to 2; `heights` are the skeleton heights of the clips in the units of their files. If
    `config.keep_heading` is set, heading is not removed. If `is_packed`, the rows are in single
    precision.
    """
    m, n_joints = config.samples, clips[0].n_joints
    ends = np.cumsum([4 * m * n_joints, 3 * m, 1])
    rows = np.empty((len(cut), ends[-1]), np.float32 if is_packed else np.float64)
    filled = 0
    for index, clip in enumerate(clips):
        own, track = cut[cut.of_clip(index)], clip.world_track(root)
        turns = rotations.inverse(segment_headings(track[0][own.start], up))
        # In chunks, because rows in double precision take more memory than the clip.
        for start in range(0, len(own), CHUNK):
            chunk = slice(start, start + CHUNK)
            quats, places = _resample(clip, track, own[chunk], m, root)
            steps = np.zeros_like(places)
            steps[:, 1:] = np.diff(places / heights[index], axis=1)
            if not config.keep_heading:
                quats[:, :, root] = rotations.multiply(turns[chunk, None], quats[:, :, root])
                steps = rotations.rotate(turns[chunk, None], steps)
            part = rows[filled : filled + len(quats)]
            part[:, : ends[0]] = quats.reshape(len(quats), -1)
            part[:, ends[0] : ends[1]] = steps.reshape(len(quats), -1)
            part[:, -1] = own.lengths[chunk] * clip.frame_time / FRAME
            filled += len(quats)
    return Samples(rows[:filled], m, n_joints)


def _resample(
    clip: Motion, root_track: tuple[FloatArray, FloatArray], cut: Segments, m: int, root: int
) -> tuple[FloatArray, FloatArray]:
    """Return rotations, (n_segments, m, n_joints, 4), and root positions, (n_segments, m, 3).

    The rotations of the root and its positions are in the world: `root_track` is the result of
    `Motion.world_track` for the root.
    """
    n, first = len(cut), int(cut.start.min())
    frames = slice(first, int(cut.stop.max()) + 1)
    bounds = (cut.start - first, cut.stop - first, np.full(n, m))
    quats = resample_segments(clip.rotations[frames], *bounds).reshape(n, m, clip.n_joints, 4)
    track, places = (own[frames, None] for own in root_track)
    if root != 0:
        quats[:, :, root] = resample_segments(track, *bounds).reshape(n, m, 4)
    return quats, resample_segment_positions(places, *bounds).reshape(n, m, 3)


def segment_headings(first: FloatArray, up: int) -> FloatArray:
    """Return the headings that `normalise` removes, shape (n_segments, 4).

    They are the parts about the axis `up` of the rotations `first` of the root, in the world at the
    start of each segment. The heading is undefined if this rotation is half a turn about a
    horizontal axis; then that of the previous segment is used.
    """
    parts = first[:, [up, 3]]
    is_undefined = np.hypot(*parts.T) < 1e-6
    sources = np.where(is_undefined, 0, np.arange(len(first)))
    return rotations.twist(first, up)[np.maximum.accumulate(sources)]


def features(
    samples: Samples, joints: IntArray, reference: FloatArray, *, has_root: bool
) -> FloatArray:
    """Return the feature vectors of the segments for one joint group, (n_segments, n_features).

    A feature vector has, for each joint and sample, a rotation vector in radians relative to
    `reference`, shape (n_joints, 4); then, if `has_root`, the displacements of the root in skeleton
    heights, three for each sample; last, the length of the segment in frames of 1/30 s.
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
    """Return Σ q qᵀ over all quaternions q of each joint, shape (n_joints, 4, 4).

    The moments of several sets of segments are the sum of the moments of each set.
    """
    return _core.moments(samples.rows, (samples.n_samples, samples.n_joints))


def mean_rotations(chunks: Iterable[Samples]) -> FloatArray:
    """Return the mean rotation of each joint over all segments, shape (n_joints, 4)."""
    return rotations.mean_of_products(reduce(np.add, map(moments, chunks)))


@dataclass(frozen=True, eq=False)
class Spread:
    """Mean and scatter matrix of the rows of a matrix.

    The bits of the mean and of the diagonal of the scatter matrix do not depend on the number of
    BLAS threads; the last bits of the other entries do.
    """

    n: int  # number of rows
    mean: FloatArray  # (n_features,)
    scatter: FloatArray  # Σ (row - mean)(row - mean)ᵀ, (n_features, n_features)

    @classmethod
    def of(cls, chunks: Iterable[FloatArray]) -> "Spread":
        """Compute mean and scatter matrix of a matrix, given as one or more chunks of its rows.

        The mean of each chunk is subtracted before products are computed, and the chunks are merged
        by the formula of Chan, Golub and LeVeque. This avoids the subtraction of nearly equal
        numbers, so the scatter of a constant feature is zero up to rounding.
        """
        n, mean, scatter = 0, np.zeros(0), np.zeros((0, 0))
        for rows in chunks:
            chunk_mean = rows.mean(axis=0)
            centred = rows - chunk_mean
            within = centred.T @ centred
            # numpy.einsum adds without BLAS, on whose threads the scales would depend otherwise.
            np.fill_diagonal(within, np.einsum("ij,ij->j", centred, centred))
            if not n:
                n, mean, scatter = len(rows), chunk_mean, within
                continue
            shift, total = chunk_mean - mean, n + len(rows)
            scatter += within
            scatter += np.outer(shift, shift) * (n * len(rows) / total)
            mean = mean + shift * (len(rows) / total)
            n = total
        return cls(n, mean, scatter)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of each feature, with divisor n - 1; 0 for a single row."""
        return np.sqrt(np.diag(self.scatter) / max(self.n - 1, 1))


def pca(
    spread: Spread, n_components: int, floors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the principal components of the correlation matrix (eq. 7 to 11).

    Returns three arrays. The first has the scale of each feature: the larger one of its standard
    deviation and its entry in `floors`, or infinity if the standard deviation is below 1e-6. The
    second, shape (n_features, at most n_components), has the loadings of one component in each
    column; see `eigenvectors`. The third has the variances along all components, descending.
    """
    deviation = spread.deviation
    scale = np.where(deviation < MIN_DEVIATION, np.inf, np.maximum(deviation, floors))
    correlation = spread.scatter / (spread.n - 1) / scale / scale[:, None]
    variances, components = eigenvectors(correlation, min(n_components, spread.n - 1))
    variances = np.maximum(variances, 0.0)
    rank = int((variances > _MIN_VARIANCE_RATIO * variances[0]).sum())
    return scale, components[:, :rank], variances


def embed(
    samples: Source,
    joints: IntArray,
    means: FloatArray,
    config: Config,
    *,
    root: int,
    group: str,
    restrict: Callable[[Samples], Samples] = lambda samples: samples,
) -> Embedding | None:
    """Compute the embedding of the segments for one joint group.

    `joints` are the joints whose rotations are features, `means`, shape (n_joints, 4), the mean
    rotations of all joints of the skeleton, and `root` is the locomotion root. `samples` is read
    twice, chunk by chunk. If there are fewer than three segments, or all segments are alike, the
    result is None, with a warning that names `group`. `restrict` is applied to each chunk.
    """
    n = len(samples)
    has_root = bool((joints == root).any())
    reference = means[joints]
    if has_root and not config.keep_heading:
        reference[joints == root] = rotations.IDENTITY

    cache: list[FloatArray] = []

    def matrices() -> Iterator[FloatArray]:
        yield from cache
        n_cached = len(cache)
        if n_cached * CHUNK >= n:
            return
        for number, part in enumerate(islice(samples.chunks(), n_cached, None), n_cached):
            matrix = features(restrict(part), joints, reference, has_root=has_root)
            # The first chunks that fit are kept; the second pass recomputes the others.
            if number == len(cache) and 8 * matrix.size * (number + 1) <= CACHE_BYTES:
                cache.append(matrix)
            yield matrix

    spread = Spread.of(matrices())
    # The last feature, the length, is not sufficient to distinguish segments: a clip at rest is
    # cut into equal parts.
    if n < 3 or (spread.deviation[:-1] < MIN_DEVIATION).all():
        few = f"{n} segment{'s are' if n != 1 else ' is'} too few to compare"
        reason = few if n < 3 else f"all {n} segments are alike"
        message = f"group {group}: {reason}; each segment forms its own cluster"
        warnings.warn(message, stacklevel=2)
        return None
    floors = np.full(len(spread.mean), config.rotation_floor)
    floors[3 * config.samples * len(joints) : -1] = config.position_floor
    floors[-1] = config.length_floor
    scale, components, variances = pca(spread, config.components, floors)
    embedding = Embedding(
        points=np.empty((0, components.shape[1])),
        joints=joints,
        has_root=has_root,
        reference=reference,
        mean=spread.mean,
        scale=scale,
        components=components,
        variances=variances,
    )
    points = np.concatenate([embedding.project(matrix) for matrix in matrices()])
    return replace(embedding, points=points)
