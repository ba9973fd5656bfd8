"""Measures of grafts relative to the recording: seams, smoothness, feet, variety, coordination.

None of the measures is a measure of naturalness. Each states how much grafts differ from the
recording in one respect, and in which direction.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import Ground, find_legs, skating_share
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, Record
from mograft.evaluation.limb_coordination import coordination
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft

_WINDOW_RATE = 10.0  # frames per second at which windows are compared
_COVERAGE_SECONDS, _LOCAL_SECONDS = 1.0, 0.5  # windows of coverage and of local diversity
_MAX_COVERED_DISTANCE = 2.0  # mean L2 distance of 6D rotations per frame to a near window
_MAX_SOURCE_FRAMES = 20_000  # above this, half an hour, only every k-th window is compared
_SEAM_BLOCK_FRAMES = 75  # seams of one base within this many frames are one block of the bootstrap
_MAX_BLOCKS_PER_BASE = 100_000


@dataclass(frozen=True)
class Quality(Record):
    """Measures of the grafts of one method.

    Attributes
    ----------
    method : str
        Name of the method that selected the donors.
    runs : int
        Number of grafts for each base.
    new_segments : Estimate
        Share of the grafted parts that come from another segment than the base segment.
    seam_gap, seam_gap_p90 : Estimate
        Mean and 90th percentile of the seam angles before seam treatment, in degrees.
    acceleration, jerk : Estimate
        Mean angular acceleration and jerk of the grafted joints, divided by those of the
        recording.
    foot_skate : Estimate
        Share of sliding feet among the feet in all frames, minus that of the recording.
    coverage : Estimate
        Share of the one-second windows of the library that are near a window of the graft, see
        `quality`.
    local_diversity : Estimate
        Mean distance of the half-second windows of the graft from the nearest window of the
        library, as root mean square distance of 6D rotations per joint. It is 0 for a copy of a
        clip.
    diversity : Estimate
        Mean joint angle between two grafts at the same time, in degrees.
    coordination, lag : Estimate
        Correlation of the swing of arms and opposite legs, and its lag in seconds, each minus
        that of the recording; see `mograft.evaluation.limb_coordination`.
    """

    method: str
    runs: int
    new_segments: Estimate
    seam_gap: Estimate
    seam_gap_p90: Estimate
    acceleration: Estimate
    jerk: Estimate
    foot_skate: Estimate
    coverage: Estimate
    local_diversity: Estimate
    diversity: Estimate
    coordination: Estimate
    lag: Estimate


def angular_derivatives(quats: FloatArray, rate: float) -> tuple[float, float]:
    """Return the mean angular acceleration and jerk of joints, in rad/s² and rad/s³.

    `quats` are local rotations of at least four frames, shape (n_frames, n_joints, 4), xyzw. The
    means are over joints and frames.
    """
    steps = rotations.multiply(rotations.inverse(quats[:-1]), quats[1:])
    accelerations = np.diff(rotations.log(steps) * rate, axis=0) * rate
    jerks = np.diff(accelerations, axis=0) * rate
    mean_acceleration = np.linalg.norm(accelerations, axis=-1).mean()
    return float(mean_acceleration), float(np.linalg.norm(jerks, axis=-1).mean())


def quality(method: str, grafts: Sequence[Sequence[Graft]], seed: int = 0) -> Quality:
    """Measure the quality of grafts.

    Parameters
    ----------
    method : str
        Name of the method that selected the donors.
    grafts : sequence of sequence of Graft
        For each base, its grafts; all from one library.
    seed : int
        Seed of the resampling.

    Returns
    -------
    Quality
        Measures that the skeleton does not support, such as coordination without known arms,
        are NaN with a sample size of 0.

    Raises
    ------
    InsufficientDataError
        If there is no graft, or a base has fewer than four frames.

    Notes
    -----
    Coverage and local diversity follow GANimator (Li et al., ACM Transactions on Graphics 41,
    2022), for the grafted joints at 10 frames per second. Two windows are near if the L2 distance
    of their 6D rotations, averaged over frames, is below 2. Stretching a donor changes acceleration
    and jerk. All measures are relative to the library, so they do not detect faults of the
    recordings.
    """
    if not grafts or not all(grafts):
        raise InsufficientDataError("quality needs at least one graft on every base")
    joints = _grafted_joints(grafts[0][0])
    source = [_rotations_6d(clip, joints) for clip in grafts[0][0].library.clips]
    step = math.ceil(sum(map(len, source)) / _MAX_SOURCE_FRAMES)
    values = defaultdict[str, list[float]](list)
    diversities, is_new, gaps = list[float](), list[float](), list[float]()
    part_blocks, seam_blocks, frame_blocks = list[int](), list[int](), list[int]()
    for index, several in enumerate(grafts):
        base = several[0].base
        if base.n_frames < 4:
            raise InsufficientDataError(
                f"quality needs at least 4 frames for derivatives, {base.name} has {base.n_frames}"
            )
        ground = Ground.of(base)
        recording = _measure(base, joints, ground)
        first_block = _MAX_BLOCKS_PER_BASE * index
        angles = _angles_between([graft.motion for graft in several], joints)
        diversities += np.degrees(angles).tolist()
        frame_blocks += (first_block + np.arange(len(angles)) // _SEAM_BLOCK_FRAMES).tolist()
        for graft in several:
            for s in graft.substitutions:
                is_new.append(float(not s.is_own))
                part_blocks.append(first_block + s.segment // estimate.BLOCK_SEGMENTS)
            for seam in graft.seams:
                gaps.append(math.degrees(seam.gap))
                seam_blocks.append(first_block + seam.frame // _SEAM_BLOCK_FRAMES)
            for name, value in _measure(graft.motion, joints, ground).items():
                reference = recording[name]
                if name in ("acceleration", "jerk"):
                    values[name].append(value / reference if reference > 0 else math.nan)
                else:
                    values[name].append(value - reference)
            coverage, local = nearest_windows(source, _rotations_6d(graft.motion, joints), step)
            values["coverage"].append(coverage)
            values["local_diversity"].append(local)

    return Quality(
        method=method,
        runs=len(grafts[0]),
        new_segments=estimate.block_mean(is_new, part_blocks, "parts", seed),
        seam_gap=estimate.block_mean(gaps, seam_blocks, "seams", seed),
        seam_gap_p90=_percentile_90(np.array(gaps), np.array(seam_blocks), seed),
        diversity=estimate.block_mean(diversities, frame_blocks, "frames", seed),
        **{
            name: estimate.block_mean(sample, range(len(sample)), "grafts", seed)
            for name, sample in values.items()
        },
    )


def _measure(motion: Motion, joints: IntArray, ground: Ground) -> dict[str, float]:
    """Return the measures, by field of `Quality`, that are compared between graft and base."""
    acceleration, jerk = angular_derivatives(motion.rotations[:, joints], motion.rate)
    correlation, lag = coordination(motion)
    has_legs = bool(find_legs(motion.skeleton))
    return {
        "acceleration": acceleration,
        "jerk": jerk,
        "foot_skate": skating_share(motion, ground) if has_legs else math.nan,
        "coordination": correlation,
        "lag": lag,
    }


def _percentile_90(values: FloatArray, blocks: IntArray, seed: int) -> Estimate:
    """Return the 90th percentile of seam gaps with an interval that resamples blocks."""
    if not len(values):
        return Estimate.without_value(0, "seams", "bootstrap of 0 blocks")
    distinct, index = np.unique(blocks, return_inverse=True)
    order = np.argsort(values, kind="stable")

    def weighted_percentiles(multiplicities: FloatArray) -> FloatArray:
        percentiles = np.empty(len(multiplicities))
        for resample, row in enumerate(multiplicities):
            weights = np.cumsum(row[index[order]])
            position = np.searchsorted(weights, 0.9 * weights[-1])
            percentiles[resample] = values[order][position]
        return percentiles

    value = float(np.percentile(values, 90))
    return estimate.bootstrap_estimate(
        value, weighted_percentiles, len(distinct), n=len(values), unit="seams", seed=seed
    )


def _grafted_joints(graft: Graft) -> IntArray:
    library = graft.library
    joints = [feature_joints(library.skeleton, library.joints(g)) for g in graft.alternatives]
    return np.unique(np.concatenate(joints))


def _rotations_6d(motion: Motion, joints: IntArray) -> FloatArray:
    """Return 6D rotations at about ten frames per second, shape (n_frames, 6 · n_joints).

    6D rotations are two columns of the rotation matrix (Zhou et al., CVPR 2019).
    """
    frames = np.arange(0, motion.n_frames, max(round(motion.rate / _WINDOW_RATE), 1))
    x, y, z, w = np.moveaxis(motion.rotations[frames][:, joints], -1, 0)
    first = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
    second = [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)]
    return np.stack([*first, *second], axis=-1).reshape(len(frames), -1)


def nearest_windows(
    source: Sequence[FloatArray], track: FloatArray, step: int = 1
) -> tuple[float, float]:
    """Return the share of the clips `source` that the motion `track` covers, and its distance.

    All arrays are 6D rotations at 10 frames per second, shape (n_frames, 6 * n_joints). The
    coverage is the share of every `step`-th one-second window of the clips that has a window of the
    motion within a mean L2 distance of 2 per frame. The distance is the mean over the half-second
    windows of the motion of the distance to the nearest window of the clips, as root mean square
    per joint. Both are NaN if the motion or all clips are shorter than one second.
    """
    n_coverage = round(_COVERAGE_SECONDS * _WINDOW_RATE)
    n_local = round(_LOCAL_SECONDS * _WINDOW_RATE)
    if len(track) < n_coverage:
        return math.nan, math.nan
    to_nearest: list[FloatArray] = []
    nearest = np.full(len(track) - n_local + 1, np.inf)
    squares = (track**2).sum(axis=1)
    for clip in source:
        if len(clip) < n_coverage:
            continue
        squared = (clip**2).sum(axis=1)[:, None] + squares - 2.0 * clip @ track.T
        distances = np.sqrt(np.maximum(squared, 0.0))
        to_nearest.append(_window_distances(distances, n_coverage, step).min(axis=1))
        nearest = np.minimum(nearest, _window_distances(distances, n_local, step).min(axis=0))
    if not to_nearest:
        return math.nan, math.nan
    n_joints = track.shape[1] / 6
    is_covered = np.concatenate(to_nearest) < _MAX_COVERED_DISTANCE
    return float(is_covered.mean()), float(nearest.mean() / math.sqrt(n_joints))


def _window_distances(distances: FloatArray, length: int, step: int) -> FloatArray:
    """Return the distances between windows of `length` frames, from those between frames.

    The distance of two windows is the mean distance of their corresponding frames. Entry (i, j) of
    the result is for the windows that start at row ``i * step`` and column j of `distances`.
    """
    rows, columns = distances.shape[0] - length + 1, distances.shape[1] - length + 1
    total = np.zeros((len(range(0, rows, step)), columns))
    for offset in range(length):
        total += distances[offset : offset + rows : step, offset : offset + columns]
    return total / length


def diversity(motions: Sequence[Motion], joints: IntArray) -> float:
    """Return the mean joint angle, in degrees, over all pairs of motions of equal length.

    The angle is between poses at the same time. The result is NaN for a single motion.
    """
    angles = _angles_between(motions, joints)
    return float(np.degrees(angles.mean())) if len(angles) else math.nan


def _angles_between(motions: Sequence[Motion], joints: IntArray) -> FloatArray:
    """Return, for each frame, the angle between the rotations of a joint in two motions.

    It is the mean over `joints` and all pairs of motions; the array is empty without a pair.
    """
    angles = [
        rotations.angle(a.rotations[:, joints], b.rotations[:, joints]).mean(axis=1)
        for i, a in enumerate(motions)
        for b in motions[:i]
    ]
    return np.asarray(np.mean(angles, axis=0) if angles else [], np.float64)
