"""The candidates of a single base segment, with the reasons against the refused ones."""

from collections.abc import Sequence

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.validate import is_integer
from mograft.errors import join_names
from mograft.library.library import Library
from mograft.search.candidates import Candidates, ConstraintVerdicts, list_candidates
from mograft.search.constraints import Constraint
from mograft.search.costs import ConstraintViolations, infeasible_costs
from mograft.search.donor_choice import cost_model
from mograft.search.donor_constraints import limit_config
from mograft.solve.donor_trellis import candidate_poses, pose_amounts
from mograft.solve.search_problem import SearchProblem, used_donors


def candidates(
    library: Library, segment: int, group: str, constraints: Sequence[Constraint] = ()
) -> Candidates:
    """Return the donors for a group of a segment, and why other similar segments are refused.

    Parameters
    ----------
    library : Library
        The library that contains the base segment and its donors.
    segment : int
        Index of the base segment.
    group : str
        The group to replace.
    constraints : sequence of Constraint, optional
        Donors that would violate a hard constraint at the segment are refused.

    Returns
    -------
    Candidates
        All members of the base segment's neighbourhood (see `Config.neighbourhood`), with
        costs.

    Raises
    ------
    ValueError
        If the segment or the group does not exist, or the group is the base.
    """
    if not is_integer(segment) or not 0 <= segment < len(library.segments):
        raise ValueError(f"`segment` must be 0 to {len(library.segments) - 1}, got {segment!r}")
    if group == library.groups.base:
        others = [own for own in library.groups.names if own != group]
        raise ValueError(
            f"`group` must be one of {join_names(others)}, not the base group, which is kept; "
            f"got {group!r}"
        )
    pool, config, verdicts = library.pool(group), library.config, None
    if constraints:
        verdicts = judge_candidates(library, segment, group, constraints)
        config = limit_config(config, constraints)
    return list_candidates(pool, segment, cost_model(config, pool), verdicts)


def judge_candidates(
    library: Library, segment: int, group: str, constraints: Sequence[Constraint]
) -> ConstraintVerdicts:
    """Evaluate constraints for every member of the neighbourhood of a base segment.

    The result has the constraint costs and the violated hard constraints of every member, in
    ascending order of the members. The base motion is the clip of `segment`. If the group contains
    the root, every member is moved to the root transform with which the base segment starts.
    """
    clip = int(library.segments.clip[segment])
    scenario = library.segments.of_clip(clip)
    base, base_segments = library.clips[clip], library.segments[scenario]
    if not isinstance(constraints, Constraint):
        constraints = [
            own
            for own in constraints
            if not isinstance(own, Constraint) or own.applies_to_group(group)
        ]
    problem = SearchProblem.build(library, base, scenario, base_segments, [group], constraints)
    position = int(np.searchsorted(scenario, segment))
    hard = [own for own in problem.constraints if own.is_hard]
    used = used_donors(hard, base_segments, library)[position]
    neighbours = problem.pools[group].neighbours(np.array([segment]), problem.config)[0]
    members = np.union1d(neighbours, used)
    positions = np.full(len(members), position)
    origin = problem.origin_amounts(problem.constraints, group, positions, members)
    poses = candidate_poses(problem, group, positions, members)
    pose = pose_amounts(problem, group, positions, poses, problem.constraints)
    by_origin, by_pose = (
        ConstraintViolations.from_amounts(problem.constraints, amounts, len(members))
        for amounts in (origin, pose)
    )
    # As in the trellis, hard constraints cost once, for the greatest violation amount.
    amounts = np.maximum(by_origin.hard, by_pose.hard)
    costs = infeasible_costs(amounts) + (by_origin.soft + by_pose.soft)
    reasons = _reasons(problem, origin, pose, len(members))
    return ConstraintVerdicts(members, costs, reasons, np.isin(members, used))


def _reasons(
    problem: SearchProblem, origin: Sequence[FloatArray], pose: Sequence[FloatArray], n: int
) -> list[list[str]]:
    """Return for each candidate a description of every hard constraint that it violates."""
    reasons: list[list[str]] = [[] for _ in range(n)]
    for constraint, *amounts in zip(problem.constraints, origin, pose, strict=True):
        if not constraint.is_hard:
            continue
        worst = np.maximum(*amounts)
        for i in np.flatnonzero(worst > 1.0).tolist():
            message = constraint.describe_error(float(worst[i]), problem.base_poses.height)
            reasons[i].append(f"{type(constraint).__name__}: {message}")
    return reasons
