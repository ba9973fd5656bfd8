"""The last steps of a graft: feet are planted, and limbs brought to the targets of `Reach`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray
from mograft.blend.foot_planting import FeetReport, plant_feet
from mograft.blend.reach_completion import ReachCompletion, ReachLimits, complete_reaches
from mograft.body.contacts import detect_contacts, find_legs
from mograft.body.hierarchy import subtree_mask
from mograft.body.limbs import find_limb
from mograft.motion.motion import Motion
from mograft.scenario.realize import donor_contacts
from mograft.search.constraints import Constraint, overlaps
from mograft.search.costs import excess
from mograft.search.donor_constraints import KeepOriginal
from mograft.search.pose_constraints import Reach
from mograft.search.trellis import DonorSequences
from mograft.solve.search_problem import SearchProblem

_MAX_INCREASE = 1e-6  # tolerances; a smaller increase of a violation is rounding


def finish_motion(
    problem: SearchProblem,
    motion: Motion,
    donors: DonorSequences,
    reaches: Sequence[Reach] | None = None,
) -> tuple[Motion, FeetReport | None, tuple[ReachCompletion, ...]]:
    """Plant the feet of an assembled motion, and bring limbs to the targets of `reaches`.

    Return the motion, a report on the feet, which is None if no foot was planted, and the changes
    of limbs.

    By default `reaches` are those among the constraints, except those of weight 0 and instances of
    subclasses, which provenance cannot restore.
    """
    planted, feet = _plant_feet(problem, motion, donors)
    if reaches is None:
        reaches = [own for own in problem.constraints if type(own) is Reach and own.weight != 0]
    finished, completions = _finish_reaches(problem, planted, reaches)
    return finished, feet, completions


def _plant_feet(
    problem: SearchProblem, motion: Motion, donors: DonorSequences
) -> tuple[Motion, FeetReport | None]:
    """Plant each foot in its contacts of the new motion and in those of its donors' clips.

    A foot is planted in every frame in which it touches the floor in the new motion or touched it
    in its donor's clip. The motion is not changed if `Config.feet` is "never" or if no exchanged
    group drives the feet.
    """
    library, skeleton = problem.library, motion.skeleton
    if library.config.feet == "never":
        return motion, None
    legs = find_legs(skeleton)
    donors_of = {
        joint: sequence
        for group, sequence in donors.items()
        for joint in problem.whole_joints[group].tolist()
    }
    exchanged = {
        joint for joint, sequence in donors_of.items() if (sequence != problem.scenario).any()
    }
    above_root = set(skeleton.ancestors(library.root))
    driving = {joint for leg in legs for joint in (leg.ankle, *skeleton.ancestors(leg.ankle))}
    if exchanged.isdisjoint(driving - above_root):
        return motion, None
    sources = [donors_of.get(leg.ankle, problem.scenario) for leg in legs]
    contacts, heights = donor_contacts(library, problem.base_segments, sources)
    return plant_feet(
        motion,
        # Contacts of the donors' feet, and contacts detected in the new motion.
        contacts | detect_contacts(motion),
        movable_legs=problem.movable_legs,
        move_root=library.root in donors_of,
        floor_reference=problem.base,
        min_heights=heights,
    )


def _finish_reaches(
    problem: SearchProblem, motion: Motion, reaches: Sequence[Reach]
) -> tuple[Motion, tuple[ReachCompletion, ...]]:
    """Move limbs to the targets of `reaches` within `Config.reach_ik`; return motion and results.

    The limbs are moved in the order of `reaches`. A limb is left alone if its correction would
    increase the violation of a hard constraint that is not a `Reach`.
    """
    config = problem.config
    if not reaches or not config.reach_ik:
        return motion, ()
    is_exchanged = np.zeros(problem.base.n_joints, bool)
    is_exchanged[np.concatenate(list(problem.whole_joints.values()))] = True
    limits = ReachLimits(
        distance=config.reach_ik,
        n_blend=max(round(config.seam_blend * motion.rate), 1),
        is_movable=is_exchanged,
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
    problem: SearchProblem, before: Motion, after: Motion, completion: ReachCompletion, n_blend: int
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
        old, new = (excess(constraint.errors(own, joints)[0]) for own in poses)
        if (new > old + _MAX_INCREASE).any():
            return type(constraint).__name__
    return ""
