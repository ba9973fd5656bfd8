"""The last steps of a graft: planted feet, limbs at the targets of `Reach`, and violations."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft.blend.foot_planting import FeetReport, plant_feet
from mograft.blend.reach_completion import ReachCompletion, ReachLimits, complete_reaches
from mograft.body.anatomy import find_limb
from mograft.body.capsules import Poses
from mograft.body.contacts import detect_contacts, find_legs
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.scenario.scenario import donor_contacts
from mograft.search.constraints import (
    Constraint,
    Violation,
    build_violation,
    find_violations,
    overlaps,
)
from mograft.search.costs import excess
from mograft.search.donor_constraints import KeepOriginal, OnlyFrom, find_seam_violations
from mograft.search.figure_position import FigurePosition
from mograft.search.pose_constraints import Avoid, Face, KeepOut, Reach
from mograft.search.trellis import DonorSequences
from mograft.solve.search_problem import SearchProblem, driven_joints

_MAX_INCREASE = 1e-6  # tolerances; a smaller increase of a violation is rounding
_KINDS_OF_SINGLE_JOINTS = (Avoid, Face, KeepOut, Reach)
"""Constraints whose errors are those of single joints; others, such as `AvoidSelf`, relate two."""


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
    library = problem.library
    donors_of = {
        joint: sequence
        for group, sequence in donors.items()
        for joint in problem.group_specs[group].whole_joints.tolist()
    }
    exchanged = {
        joint for joint, sequence in donors_of.items() if (sequence != problem.scenario).any()
    }
    if not plants_feet(library, exchanged):
        return motion, None
    sources = [donors_of.get(leg.ankle, problem.scenario) for leg in find_legs(motion.skeleton)]
    contacts, heights = donor_contacts(library, problem.base_segments, sources)
    return plant_feet(
        motion,
        contacts | detect_contacts(motion),
        movable_legs=problem.movable_legs,
        move_root=library.root in donors_of,
        floor_reference=problem.base,
        min_heights=heights,
    )


def plants_feet(library: Library, joints: set[int]) -> bool:
    """Whether feet are planted if `joints` are exchanged, because they drive feet.

    Those of a robot are not: its legs have hinges, which `bend_leg` does not know.
    """
    skeleton = library.skeleton
    above_root = set(skeleton.ancestors(library.root))
    ankles = [leg.ankle for leg in find_legs(skeleton)]
    driving = {joint for ankle in ankles for joint in (ankle, *skeleton.ancestors(ankle))}
    may_plant = library.config.feet != "never" and skeleton.hinges is None
    return may_plant and not joints.isdisjoint(driving - above_root)


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
    is_exchanged[np.concatenate([own.whole_joints for own in problem.group_specs.values()])] = True
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
    joints = after.skeleton.subtree_mask([limb.start])
    first, last = completion.frames
    # A curve between two corrections of one limb has less than `2 * n_blend` frames.
    margin = 2 * n_blend
    frames = np.arange(max(first - margin, 0), min(last + margin + 1, after.n_frames))
    cuts = (motion[frames[0] : frames[-1] + 1].world_transforms() for motion in (before, after))
    poses = [problem.base_poses.with_poses(frames, *own) for own in cuts]
    for constraint in _other_constraints(problem):
        old, new = (excess(constraint.errors(own, joints)[0]) for own in poses)
        if (new > old + _MAX_INCREASE).any():
            return type(constraint).__name__
    return ""


def find_motion_violations(
    problem: SearchProblem, motion: Motion, donors: DonorSequences
) -> list[Violation]:
    """Return the violations of hard constraints by a finished motion and its donors."""
    if not problem.constraints:
        return []
    found = find_violations(problem.constraints, problem.poses_of(motion))
    found += find_donor_violations(problem, donors)
    seam_frames = problem.base_segments.stop[:-1].tolist()
    for constraint in problem.constraints:
        for group, sequence in donors.items():
            angles = problem.pools[group].seam_angles_along(sequence).tolist()
            found += find_seam_violations([constraint], group, seam_frames, angles)
    return found


def find_donor_violations(problem: SearchProblem, donors: DonorSequences) -> list[Violation]:
    """Return the violations of hard constraints on donors, by constraint, group and position.

    A donor that a constraint excludes is a violation, and so is an `OnlyFrom` constraint that no
    candidate satisfies.
    """
    found: list[Violation] = []
    for constraint in problem.constraints:
        if constraint.is_hard:
            for group, sequence in donors.items():
                found += _excluded_donors(problem, constraint, group, sequence)
            if isinstance(constraint, OnlyFrom):
                found += _unsatisfiable(problem, constraint)
    return found


def _excluded_donors(
    problem: SearchProblem, constraint: Constraint, group: str, sequence: IntArray
) -> Iterator[Violation]:
    """Yield one violation for each position whose donor is excluded by the constraint."""
    frames = problem.base_segments
    (amounts,) = problem.origin_amounts([constraint], group, slice(None), sequence)
    for position in np.flatnonzero(amounts > 1.0).tolist():
        span, amount = (int(frames.start[position]), int(frames.stop[position])), amounts[position]
        description = constraint.describe_error(float(amount), problem.base_poses.height)
        description += f"; no donor of {group} satisfies all constraints"
        yield build_violation(constraint, span, float(amount), description)


def _unsatisfiable(problem: SearchProblem, constraint: OnlyFrom) -> Iterator[Violation]:
    """Yield one violation if no candidate at any position is from the clips of `constraint`."""
    library, frames = problem.library, problem.base_segments
    positions = np.flatnonzero(overlaps(frames, constraint.frames)).tolist()
    lists = [own[position] for own in problem.candidates.values() for position in positions]
    if not constraint.selects(library.segments[np.concatenate(lists)], library.entries).any():
        span = (int(frames.start[positions[0]]), int(frames.stop[positions[-1]]))
        description = f"no candidate is from {constraint.describe_selection()}"
        yield build_violation(constraint, span, 2.0, description)


def find_kept_violations(
    library: Library, base: Motion, groups: Sequence[str], constraints: Sequence[Constraint]
) -> list[Violation]:
    """Return the violations of hard constraints on single joints by joints that no donor moves.

    `groups` are the grafted groups. If one of them contains the root, donors move every joint, and
    the list is empty. Donors may move a target that is relative to the figure.
    """
    hard = [own for own in constraints if own.is_hard and isinstance(own, _KINDS_OF_SINGLE_JOINTS)]
    hard = [own for own in hard if not isinstance(getattr(own, "target", None), FigurePosition)]
    members = {group: library.joints(group) for group in groups}
    if not hard or any(library.root in joints for joints in members.values()):
        return []
    moved = np.any(list(driven_joints(library.skeleton, members).values()), axis=0)
    return find_violations(hard, Poses.from_motion(base), ~moved)
