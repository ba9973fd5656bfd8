"""Violations of hard constraints by a finished motion, its donors and its seams."""

import numpy as np

from mograft._util.arrays import IntArray
from mograft.motion.motion import Motion
from mograft.search.constraints import Constraint, Violation, find_violations, overlaps
from mograft.search.costs import origin_violations
from mograft.search.donor_constraints import OnlyFrom, find_seam_violations
from mograft.search.trellis import DonorSequences
from mograft.solve.search_problem import SearchProblem


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
    found = []
    for constraint in problem.constraints:
        if constraint.is_hard:
            for group, sequence in donors.items():
                found += _excluded_donors(problem, constraint, group, sequence)
            if isinstance(constraint, OnlyFrom):
                found += _unsatisfiable(problem, constraint)
    return found


def _excluded_donors(
    problem: SearchProblem, constraint: Constraint, group: str, sequence: IntArray
) -> list[Violation]:
    """Return one violation for each position whose donor is excluded by the constraint."""
    segments, frames = problem.library.segments, problem.base_segments
    base, clips = segments[problem.scenario], problem.library.entries
    (amounts,) = origin_violations([constraint], group, base, segments[sequence], frames, clips)
    return [
        _violation(
            constraint,
            (int(frames.start[position]), int(frames.stop[position])),
            float(amounts[position]),
            constraint.describe_error(float(amounts[position]), problem.base_poses.height)
            + f"; no donor of {group} satisfies all constraints",
        )
        for position in np.flatnonzero(amounts > 1.0).tolist()
    ]


def _unsatisfiable(problem: SearchProblem, constraint: OnlyFrom) -> list[Violation]:
    """Return one violation if no candidate at any position is from the clips of `constraint`."""
    library, frames = problem.library, problem.base_segments
    positions = np.flatnonzero(overlaps(frames, constraint.frames)).tolist()
    if not positions:
        return []
    lists = [own[position] for own in problem.candidates.values() for position in positions]
    if constraint.selects(library.segments[np.concatenate(lists)], library.entries).any():
        return []
    span = (int(frames.start[positions[0]]), int(frames.stop[positions[-1]]))
    return [
        _violation(constraint, span, 2.0, f"no candidate is from {constraint.describe_selection()}")
    ]


def _violation(
    constraint: Constraint, frames: tuple[int, int], error: float, description: str
) -> Violation:
    name = type(constraint).__name__
    return Violation(
        constraint=constraint,
        frames=frames,
        worst=frames[0],
        error=error,
        joint="",
        message=f"{name} is violated in frames {frames[0]} to {frames[1]}: {description}",
    )
