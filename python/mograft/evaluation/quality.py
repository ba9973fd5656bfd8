"""Measures of grafts relative to the recording: exchanged parts, seams, smoothness, variety.

None of the measures is a measure of naturalness. Each states how much grafts differ from the
recording in one respect, and in which direction.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import feature_joints
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, MethodRecord
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft

_SEAM_BLOCK_FRAMES = 75  # seams of one base within this many frames are one block of the bootstrap
_MAX_BLOCKS_PER_BASE = 100_000


@dataclass(frozen=True)
class Quality(MethodRecord):
    """Measures of the grafts of one method.

    Attributes
    ----------
    method : str
        Name of the method that selected the donors.
    runs : int
        Number of grafts for each base.
    new_segments : Estimate
        Share of the grafted parts that come from another segment than the base segment.
    seam_gap : Estimate
        Mean seam angle before seam treatment, in degrees.
    acceleration, jerk : Estimate
        Mean angular acceleration and jerk of the grafted joints, divided by those of the
        recording.
    diversity : Estimate
        Mean joint angle between two grafts at the same time, in degrees.
    """

    new_segments: Estimate
    seam_gap: Estimate
    acceleration: Estimate
    jerk: Estimate
    diversity: Estimate


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
        Measures without a value, such as the seam gap without seams, are NaN with a sample size
        of 0.

    Raises
    ------
    InsufficientDataError
        If there is no graft, or a base has fewer than four frames.

    Notes
    -----
    Stretching a donor changes acceleration and jerk. All measures are relative to the library, so
    they do not detect faults of the recordings.
    """
    if not grafts or not all(grafts):
        raise InsufficientDataError("quality needs at least one graft on every base")
    library, groups = grafts[0][0].library, grafts[0][0].alternatives
    per_group = [feature_joints(library.skeleton, library.joints(group)) for group in groups]
    joints = np.unique(np.concatenate(per_group))
    # Pairs of a value and its block, and the two ratios of each graft.
    parts, seams = list[tuple[float, int]](), list[tuple[float, int]]()
    frames, ratios = list[tuple[float, int]](), list[list[float]]()
    for index, several in enumerate(grafts):
        base, first_block = several[0].base, _MAX_BLOCKS_PER_BASE * index
        if base.n_frames < 4:
            raise InsufficientDataError(
                f"quality needs at least 4 frames for derivatives, {base.name} has {base.n_frames}"
            )
        recorded = angular_derivatives(base.rotations[:, joints], base.rate)
        angles = np.degrees(_angles_between([graft.motion for graft in several], joints)).tolist()
        frames += ((a, first_block + i // _SEAM_BLOCK_FRAMES) for i, a in enumerate(angles))
        for graft in several:
            parts += (
                (not s.is_own, first_block + s.segment // estimate.BLOCK_SEGMENTS)
                for s in graft.substitutions
            )
            seams += (
                (math.degrees(seam.gap), first_block + seam.frame // _SEAM_BLOCK_FRAMES)
                for seam in graft.seams
            )
            found = angular_derivatives(graft.motion.rotations[:, joints], graft.motion.rate)
            pairs = zip(found, recorded, strict=True)
            ratios.append([own / other if other > 0 else math.nan for own, other in pairs])

    def average(pairs: Sequence[tuple[float, int]], unit: str) -> Estimate:
        values, blocks = np.array(pairs, np.float64).reshape(-1, 2).T
        return estimate.block_mean(values, blocks, unit, seed)

    means = {"new_segments": average(parts, "parts"), "seam_gap": average(seams, "seams")}
    for name, values in zip(("acceleration", "jerk"), zip(*ratios, strict=True), strict=True):
        means[name] = estimate.block_mean(values, range(len(values)), "grafts", seed)
    means["diversity"] = average(frames, "frames")
    return Quality(method=method, runs=len(grafts[0]), **means)


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
