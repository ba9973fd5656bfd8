"""Trellises of donors with constraint costs: every candidate is evaluated in its position.

Candidates of most groups are evaluated as they are, before seam treatment. A group that holds
the root drives it with its donors, one after the other: each of its candidates is evaluated at
the root transform to which the cheapest path that ends in the candidate leads.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.rigid_alignment import RootTransforms
from mograft.body.world_poses import Poses
from mograft.search.constraints import Constraint
from mograft.search.costs import ConstraintViolations
from mograft.search.trellis import DonorSequences, DonorTrellis
from mograft.solve.assembly import assemble
from mograft.solve.donor_poses import advance_root, candidate_poses, split_by_count
from mograft.solve.error_bounds import find_evaluated_positions
from mograft.solve.search_problem import SearchProblem


def build_trellis(problem: SearchProblem, group: str, chosen: DonorSequences) -> DonorTrellis:
    """Return the candidates of a group with their costs, constraint costs included.

    `chosen` has the donor sequences of groups whose donors are chosen already. Groups without one
    move as in the base.
    """
    if group == problem.root_group:
        return _build_root_trellis(problem, group, chosen)
    if not problem.constraints:
        return _trellis(problem, group, None)
    costs = [own.costs() for own in candidate_violations(problem, group, chosen)]
    return _trellis(problem, group, costs)


def candidate_violations(
    problem: SearchProblem, group: str, chosen: DonorSequences
) -> list[ConstraintViolations]:
    """Return for each position how far the candidates of a group violate constraints.

    `chosen` is as for `build_trellis`. All candidates satisfy the hard constraints on clips and
    lengths of donors, so `hard` contains violations of pose constraints only.
    """
    lists = problem.candidates[group]
    violations = [
        ConstraintViolations(np.zeros(len(costs)), costs) for costs in problem.origin_costs(group)
    ]
    if not problem.is_constrained_position.any():
        return violations
    context = assemble(problem, chosen) if chosen else problem.base
    active = np.flatnonzero(find_evaluated_positions(problem, group, context))
    intervals = problem.base_segments.lengths[active]
    n_poses = np.array([len(lists[p]) for p in active.tolist()]) * (intervals + 1)
    for positions in split_by_count(active, n_poses):
        counts = [len(lists[p]) for p in positions.tolist()]
        repeated = np.repeat(positions, counts)
        donors = np.concatenate([lists[p] for p in positions.tolist()])
        poses = candidate_poses(problem, group, repeated, donors, context)
        found = candidate_pose_violations(problem, group, repeated, poses)
        for position, own in zip(positions.tolist(), found.split(counts), strict=True):
            origin = violations[position].soft
            violations[position] = ConstraintViolations(own.hard, origin + own.soft)
    return violations


def candidate_pose_violations(
    problem: SearchProblem, group: str, positions: IntArray, poses: Poses
) -> ConstraintViolations:
    """Return how far candidates violate pose constraints; arguments as for `pose_amounts`."""
    constraints = problem.pose_constraints
    amounts = pose_amounts(problem, group, positions, poses, constraints)
    return ConstraintViolations.from_amounts(constraints, amounts, len(positions))


def pose_amounts(
    problem: SearchProblem,
    group: str,
    positions: IntArray,
    poses: Poses,
    constraints: Sequence[Constraint],
) -> list[FloatArray]:
    """Return for each constraint the greatest error of every candidate of a group, in tolerances.

    `positions` has the position of each candidate; `poses` is the result of `candidate_poses`.
    """
    counts = problem.base_segments.lengths[positions] + 1
    starts, joints = np.cumsum(counts) - counts, problem.driven_joints[group]
    return [np.maximum.reduceat(own.errors(poses, joints)[0], starts) for own in constraints]


def _build_root_trellis(problem: SearchProblem, group: str, chosen: DonorSequences) -> DonorTrellis:
    """Return the trellis of the group that contains the root.

    Each candidate is evaluated at the root transform to which the cheapest path before it leads.
    """
    trellis = _trellis(problem, group, problem.origin_costs(group))
    if not problem.is_constrained_position.any():
        return trellis
    context = assemble(problem, chosen) if chosen else problem.base
    roots = RootTransforms.from_motion(context, problem.library.root)
    start = roots[problem.base_segments.start[:1]]
    constraint_costs: list[FloatArray] = []
    total, ends = np.zeros(1), start
    for position, donors in enumerate(trellis.candidates):
        root_start = start[np.zeros(len(donors), np.int64)]
        if position:
            through = total[:, None] + trellis.costs.pairwise[position - 1]
            total, root_start = through.min(axis=0), ends[through.argmin(axis=0)]
        costs = np.zeros(len(donors))
        if problem.is_constrained_position[position]:
            positions = np.full(len(donors), position)
            poses = candidate_poses(problem, group, positions, donors, context, root_start)
            costs = candidate_pose_violations(problem, group, positions, poses).costs()
        constraint_costs.append(costs)
        total = total + trellis.costs.unary[position] + costs
        ends = advance_root(problem, donors, root_start)
    return replace(trellis, costs=trellis.costs.add_unary(constraint_costs))


def _trellis(
    problem: SearchProblem, group: str, constraint_costs: list[FloatArray] | None
) -> DonorTrellis:
    pool, model = problem.pools[group], problem.cost_models[group]
    trellis = DonorTrellis.build(
        pool, problem.scenario, problem.candidates[group], model, constraint_costs
    )
    if not problem.is_loop or not isinstance(trellis.costs.pairwise, tuple):
        return trellis
    ends = trellis.candidates[-1], trellis.candidates[0]
    return replace(trellis, join=pool.pairwise_costs(*ends, model))
