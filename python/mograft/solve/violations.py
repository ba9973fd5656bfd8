"""Violations of hard constraints by a finished motion, its donors, its seams and kept joints."""

from collections.abc import Iterator, Sequence

import numpy as np

from mograft._util.arrays import IntArray
from mograft.body.world_poses import Poses
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.search.constraints import (
    Constraint,
    Violation,
    build_violation,
    find_violations,
    overlaps,
)
from mograft.search.costs import origin_violations
from mograft.search.donor_constraints import OnlyFrom, find_seam_violations
from mograft.search.pose_constraints import Avoid, Face, KeepOut, Reach
from mograft.search.trellis import DonorSequences
from mograft.solve.search_problem import SearchProblem, driven_joints

_KINDS_OF_SINGLE_JOINTS = (Avoid, Face, KeepOut, Reach)
"""Constraints whose errors are those of single joints; others, such as `AvoidSelf`, relate two."""


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
    segments, frames = problem.library.segments, problem.base_segments
    base, clips = segments[problem.scenario], problem.library.entries
    (amounts,) = origin_violations([constraint], group, base, segments[sequence], frames, clips)
    for position in np.flatnonzero(amounts > 1.0).tolist():
        span, amount = (
            (int(frames.start[position]), int(frames.stop[position])),
            float(amounts[position]),
        )
        description = constraint.describe_error(amount, problem.base_poses.height)
        description += f"; no donor of {group} satisfies all constraints"
        yield build_violation(constraint, span, amount, description)


def _unsatisfiable(problem: SearchProblem, constraint: OnlyFrom) -> Iterator[Violation]:
    """Yield one violation if no candidate at any position is from the clips of `constraint`."""
    library, frames = problem.library, problem.base_segments
    positions = np.flatnonzero(overlaps(frames, constraint.frames)).tolist()
    lists = [own[position] for own in problem.candidates.values() for position in positions]
    if not lists:
        return
    if not constraint.selects(library.segments[np.concatenate(lists)], library.entries).any():
        span = (int(frames.start[positions[0]]), int(frames.stop[positions[-1]]))
        description = f"no candidate is from {constraint.describe_selection()}"
        yield build_violation(constraint, span, 2.0, description)


def find_kept_violations(
    library: Library, base: Motion, groups: Sequence[str], constraints: Sequence[Constraint]
) -> list[Violation]:
    """Return the violations of hard constraints on single joints by joints that no donor moves.

    `groups` are the grafted groups. If one of them contains the root, donors move every joint, and
    the list is empty.
    """
    hard = [own for own in constraints if own.is_hard and isinstance(own, _KINDS_OF_SINGLE_JOINTS)]
    members = {group: library.joints(group) for group in groups}
    if not hard or any(library.root in joints for joints in members.values()):
        return []
    moved = np.any(list(driven_joints(library.skeleton, members).values()), axis=0)
    return find_violations(hard, Poses.from_motion(base), ~moved)
