"""Completion of each `Reach` of a graft by inverse kinematics, unless it breaks a constraint."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.blend.reach_completion import ReachCompletion, ReachLimits, complete_reaches
from mograft.body.hierarchy import subtree_mask
from mograft.body.limbs import find_limb
from mograft.motion.motion import Motion
from mograft.search.constraints import Constraint, overlaps
from mograft.search.donor_constraints import KeepOriginal
from mograft.search.pose_constraints import Reach
from mograft.solve.search_problem import SearchProblem

_MAX_INCREASE = 1e-6  # tolerances; a smaller increase of a violation is rounding


def active_reaches(constraints: Sequence[Constraint]) -> list[Reach]:
    """Return each `Reach` among constraints that has an effect: all except those of weight 0.

    Instances of subclasses of `Reach` are left out, because provenance cannot restore them.
    """
    return [own for own in constraints if type(own) is Reach and own.weight != 0]


def finish_reaches(
    problem: SearchProblem, motion: Motion, reaches: Sequence[Reach]
) -> tuple[Motion, tuple[ReachCompletion, ...]]:
    """Move limbs to the targets of `reaches` within `Config.reach_ik`; return motion and results.

    The limbs are moved in the order of `reaches`. A limb is left alone if its correction would
    increase the violation of a hard constraint that is not a `Reach`.
    """
    config = problem.config
    if not reaches or not config.reach_ik:
        return motion, ()
    limits = ReachLimits(
        distance=config.reach_ik,
        n_blend=max(round(config.seam_blend * motion.rate), 1),
        is_movable=_exchanged_joints(problem),
        is_kept=_kept_frames(problem),
    )
    if not _other_constraints(problem):
        return complete_reaches(motion, reaches, limits, problem.base_poses)
    accepted: list[Reach] = []
    completions: list[ReachCompletion] = []
    finished = motion
    for reach in reaches:
        trial, found = complete_reaches(motion, [*accepted, reach], limits, problem.base_poses)
        completion = found[-1]
        if completion.is_moved:
            broken = _broken_constraint(problem, finished, trial, completion, limits.n_blend)
            if broken:
                reason = f"{broken} would be violated"
                completion = replace(completion, after=completion.before, reason=reason)
            else:
                finished = trial
                accepted.append(reach)
        completions.append(completion)
    return finished, tuple(completions)


def _exchanged_joints(problem: SearchProblem) -> BoolArray:
    """Return whether each joint is in a grafted group with all its channels, (n_joints,)."""
    is_exchanged = np.zeros(problem.base.n_joints, bool)
    for group in problem.pools:
        joints = problem.library.joints(group)
        is_exchanged[np.setdiff1d(joints, list(problem.divided_channels[group]))] = True
    return is_exchanged


def _kept_frames(problem: SearchProblem) -> BoolArray:
    """Return a mask of the frames of segments with a hard `KeepOriginal`, shape (n_frames,)."""
    is_kept = np.zeros(problem.base.n_frames, bool)
    segments = problem.base_segments
    for own in problem.constraints:
        if isinstance(own, KeepOriginal) and own.is_hard:
            for position in np.flatnonzero(overlaps(segments, own.frames)).tolist():
                is_kept[segments.start[position] : segments.stop[position] + 1] = True
    return is_kept


def _other_constraints(problem: SearchProblem) -> list[Constraint]:
    """Return the hard pose constraints that are not `Reach` constraints."""
    return [own for own in problem.pose_constraints if own.is_hard and not isinstance(own, Reach)]


def _broken_constraint(
    problem: SearchProblem,
    before: Motion,
    after: Motion,
    completion: ReachCompletion,
    n_blend: int,
) -> str:
    """Return the class name of the first hard constraint that `after` violates more than `before`.

    Constraints of the class `Reach` are not compared. The name is empty if there is none.
    """
    limb = find_limb(after.skeleton, after.skeleton.index(completion.reach.joint))
    if limb is None:
        return ""
    joints = subtree_mask(after.skeleton, [limb.start])
    first, last = completion.frames
    # A curve between two corrections of one limb has less than `2 * n_blend` frames.
    margin = 2 * n_blend
    frames = np.arange(max(first - margin, 0), min(last + margin + 1, after.n_frames))
    poses = [
        problem.base_poses.with_poses(
            frames, *motion[frames[0] : frames[-1] + 1].world_transforms()
        )
        for motion in (before, after)
    ]
    for constraint in _other_constraints(problem):
        old, new = (_excess(constraint.errors(own, joints)[0]) for own in poses)
        if (new > old + _MAX_INCREASE).any():
            return type(constraint).__name__
    return ""


def _excess(errors: FloatArray) -> FloatArray:
    """Return by how much errors, in tolerances, exceed 1; 0 if they do not."""
    excess: FloatArray = np.maximum(errors - 1.0, 0.0)
    return excess
