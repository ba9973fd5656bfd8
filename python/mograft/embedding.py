"""One vector per segment and joint group: resampled, aligned, reduced (paper, 4.1.3 and 4.2)."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft import rotations
from mograft._arrays import FloatArray, IntArray
from mograft.config import FRAME, Config
from mograft.motion import Motion
from mograft.resample import segments, segments_positions
from mograft.segmentation import Segments

__all__ = ["Embedding", "Samples", "embed", "features", "normalise", "pca"]


@dataclass(frozen=True, eq=False)
class Samples:
    """Segments of equal length, in the same place and, if wanted, facing the same way.

    Attributes
    ----------
    rotations : ndarray, shape (n_segments, n_samples, n_joints, 4)
        Local rotations; those of the locomotion root are its rotations in the world.
    steps : ndarray, shape (n_segments, n_samples, 3)
        The root's way from the sample before, in skeleton heights; 0 at the first.
    lengths : ndarray, shape (n_segments,)
        Lengths before resampling, in frames of 1/30 s.
    """

    rotations: FloatArray
    steps: FloatArray
    lengths: FloatArray


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

    def project(self, matrix: FloatArray) -> FloatArray:
        """Return the points of feature vectors, shape (n, n_features) to (n, n_components)."""
        projected: FloatArray = ((matrix - self.mean) / self.scale) @ self.components
        return projected


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
    quats, steps, lengths = [], [], []
    for index, clip in enumerate(clips):
        own = cut.of_clip(index)
        bounds = (cut.start[own], cut.stop[own], np.full(len(own), m))
        sampled = segments(clip.rotations, *bounds).reshape(len(own), m, clip.n_joints, 4)
        if root == 0:
            carried, place = sampled[:, :, 0], clip.positions[:, :1]
        else:
            turned, placed = clip.world()
            carried = segments(turned[:, root : root + 1], *bounds).reshape(len(own), m, 4)
            place = placed[:, root : root + 1]
        way = np.zeros((len(own), m, 3))
        place = segments_positions(place, *bounds).reshape(len(own), m, 3) / heights[index]
        way[:, 1:] = np.diff(place, axis=1)
        if not config.keep_heading:
            back = rotations.inverse(_headings(carried[:, 0], up))[:, None]
            carried, way = rotations.multiply(back, carried), rotations.rotate(back, way)
        sampled[:, :, root] = carried
        quats.append(sampled)
        steps.append(way)
        lengths.append(cut.lengths[own] * clip.frame_time / FRAME)
    return Samples(np.concatenate(quats), np.concatenate(steps), np.concatenate(lengths))


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
    n = len(samples.lengths)
    vectors = rotations.log(
        rotations.multiply(rotations.inverse(reference), samples.rotations[:, :, joints])
    )
    parts = [vectors.transpose(0, 2, 1, 3).reshape(n, -1)]
    if has_root:
        parts.append(samples.steps.reshape(n, -1))
    return np.concatenate([*parts, samples.lengths[:, None]], axis=1)


def mean_rotations(quats: FloatArray) -> FloatArray:
    """Return the mean rotation of each joint.

    Parameters
    ----------
    quats : ndarray, shape (n, n_joints, 4)
        Unit quaternions.

    Returns
    -------
    ndarray, shape (n_joints, 4)
        For each joint the unit quaternion with the greatest Σ (q·mean)², w ≥ 0: the signs of
        the quaternions do not matter (Markley et al. 2007).
    """
    moments = np.einsum("nji,njk->jik", quats, quats)
    means = np.linalg.eigh(moments)[1][..., -1]
    signed: FloatArray = np.where(means[:, 3:] < 0, -means, means)
    return signed


def pca(
    matrix: FloatArray, n_components: int, floors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Find the principal components of standardised features (correlation matrix).

    Parameters
    ----------
    matrix : ndarray, shape (n_segments, n_features)
        One row per segment.
    n_components : int
        Components kept, at most; never more than the rank.
    floors : ndarray, shape (n_features,)
        Least standard deviation to divide by. Features that vary by less than 1e-9 are
        dropped.

    Returns
    -------
    mean, scale : ndarray, shape (n_features,)
        Subtracted and divided by; infinite where a feature is dropped.
    components : ndarray, shape (n_features, n_components)
        Orthonormal columns by descending variance; the largest entry of each is positive.
    variances : ndarray, shape (n_features,)
        Variance along every principal component, descending.
    """
    mean = matrix.mean(axis=0)
    std = matrix.std(axis=0, ddof=1)
    scale = np.where(std < 1e-9, np.inf, np.maximum(std, floors))
    standard = (matrix - mean) / scale
    variances, vectors = np.linalg.eigh(standard.T @ standard / (len(matrix) - 1))
    variances, vectors = variances[::-1], vectors[:, ::-1]
    rank = int((variances > 1e-12 * max(variances[0], 0.0)).sum())
    kept = vectors[:, : min(n_components, len(matrix) - 1, rank)]
    largest = np.take_along_axis(kept, np.abs(kept).argmax(axis=0)[None], axis=0)
    return mean, scale, kept * np.where(largest < 0, -1.0, 1.0), np.maximum(variances, 0.0)


def embed(
    samples: Samples, joints: IntArray, config: Config, *, root: int, group: str
) -> Embedding | None:
    """Embed the segments of one joint group.

    Parameters
    ----------
    samples : Samples
        The normalised segments.
    joints : ndarray of int
        The group's joints whose rotations count.
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
    n, m = samples.rotations.shape[:2]
    has_root = bool((joints == root).any())
    reference = mean_rotations(samples.rotations[:, :, joints].reshape(n * m, len(joints), 4))
    if has_root and not config.keep_heading:
        reference[joints == root] = rotations.IDENTITY
    matrix = features(samples, joints, reference, has_root=has_root)
    n_rotations = 3 * m * len(joints)
    floors = np.full(matrix.shape[1], config.rotation_floor)
    floors[n_rotations:-1] = config.position_floor
    floors[-1] = config.length_floor
    _warn_of_the_cut(matrix[:, :n_rotations], group)
    # Lengths alone are nothing to go by: a motion without motion is cut evenly.
    if n < 3 or (matrix[:, :-1].std(axis=0) < 1e-9).all():
        few = f"{n} segment{'s are' if n > 1 else ' is'} too few to compare"
        what = few if n < 3 else f"all {n} segments are alike"
        warnings.warn(f"group {group}: {what}; each is left by itself", stacklevel=2)
        return None
    mean, scale, components, variances = pca(matrix, config.components, floors)
    points = ((matrix - mean) / scale) @ components
    return Embedding(points, joints, has_root, reference, mean, scale, components, variances)


def _warn_of_the_cut(vectors: FloatArray, group: str) -> None:
    """Warn where rotation vectors come near a half turn from the mean, where they jump."""
    angles = np.linalg.norm(vectors.reshape(-1, 3), axis=1)
    share = float((angles > np.pi - 0.1).mean()) if len(angles) else 0.0
    if share > 0.001:
        warnings.warn(
            f"group {group}: {share:.1%} of its poses are nearly a half turn from the mean; "
            "segments that are alike there may be told apart",
            stacklevel=3,
        )
