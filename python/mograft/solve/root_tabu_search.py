"""Tabu search for donor sequences that drive the root so that all hard constraints hold.

If a grafted group holds the root, replacing one donor moves all later frames rigidly over the
floor. Each single substitution is therefore ranked by the violation of the whole moved motion, and
the best-ranked ones are assembled.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.body.world_poses import Poses
from mograft.motion.motion import Motion
from mograft.search.costs import is_infeasible
from mograft.search.trellis import DonorSequences, DonorTrellis
from mograft.solve.assembly import assemble, pose_excess
from mograft.solve.donor_trellis import advance_root, candidate_poses, split_by_count
from mograft.solve.search_problem import SearchProblem

_MAX_ITERATIONS = 64  # substitutions that are made, at most
_MAX_ITERATIONS_WITHOUT_GAIN = 16  # consecutive substitutions without a new best result, at most
_MAX_TENURE = 6  # iterations during which a changed position stays fixed, at most
_N_ASSEMBLED = 2  # best-ranked substitutions that are assembled in each iteration
_MAX_RANKING_POSES = 200_000  # approximate, for one ranking; larger motions are sampled at a stride


@dataclass(frozen=True, eq=False)
class _Solution:
    """Donor sequences, their motion after `finish` of `tabu_search`, and its total violation."""

    violation: float
    donors: DonorSequences
    motion: Motion


def tabu_search(
    problem: SearchProblem,
    donors: DonorSequences,
    trellises: Mapping[str, DonorTrellis],
    finish: Callable[[Motion, DonorSequences], Motion],
) -> DonorSequences:
    """Substitute donors that drive the root, one at a time, until hard constraints hold.

    Return the sequences with the smallest total violation of the finished motion; ties go to the
    first. They are `donors` if no group contains the root or nothing is violated. `finish`, such as
    foot planting, is applied to each assembled motion and its donor sequences.

    The best-ranked substitution is made even if it increases the violation, and its position is
    then fixed for some iterations, so that the search leaves local minima (Glover, ORSA J.
    Computing 1, 1989).
    """
    group = problem.root_group
    if group is None or group not in trellises or not problem.is_constrained_frame.any():
        return donors
    trellis = DonorTrellis.build(
        problem.pools[group],
        problem.scenario,
        trellises[group].candidates,
        problem.cost_models[group],
    )
    tenure = min(_MAX_TENURE, sum(len(own) > 1 for own in trellis.candidates) // 2)

    def evaluate(sequences: DonorSequences) -> _Solution:
        motion = finish(assemble(problem, sequences), sequences)
        violation = float(pose_excess(problem, problem.poses_of(motion)).sum())
        return _Solution(violation, sequences, motion)

    current = evaluate(donors)
    best = current
    free_from, idle = np.zeros(len(problem.base_segments), np.int64), 0
    for iteration in range(_MAX_ITERATIONS):
        if best.violation == 0 or idle == _MAX_ITERATIONS_WITHOUT_GAIN:
            break
        positions, given, _ = rank_substitutions(
            problem, trellis, current.donors, current.motion, free_from <= iteration
        )
        tried: list[tuple[_Solution, int]] = []
        for position, donor in zip(
            positions[:_N_ASSEMBLED].tolist(), given[:_N_ASSEMBLED].tolist(), strict=True
        ):
            sequence = current.donors[group].copy()
            sequence[position] = donor
            tried.append((evaluate({**current.donors, group: sequence}), position))
            if tried[-1][0].violation < best.violation:
                break
        if not tried:
            break
        current, changed = min(tried, key=lambda one: one[0].violation)
        free_from[changed] = iteration + 1 + tenure
        idle += 1
        if current.violation < best.violation:
            best, idle = current, 0
    return best.donors


def rank_substitutions(
    problem: SearchProblem,
    trellis: DonorTrellis,
    chosen: DonorSequences,
    motion: Motion,
    is_free: BoolArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return single substitutions of donors that drive the root, the most promising first.

    `trellis` has no constraint costs. `motion` is the motion of the donor sequences `chosen` and
    must violate a hard constraint. `is_free`, shape (n_positions,), marks the positions that can
    change.

    The results, each of shape (n,), are positions that start before the last violating frame, a new
    donor for each, and the predicted total violations in tolerances, ascending; ties are in order
    of cost. No substitution adds a seam above `max_angle`. The prediction omits seam treatment, and
    evaluates large motions only at every k-th frame.
    """
    group, segments = problem.root_group, problem.base_segments
    assert group is not None
    poses = problem.poses_of(motion)
    root = RootTransforms.from_motion(motion, problem.library.root)
    excess = pose_excess(problem, poses)
    positions, indices, cost = _feasible_changes(trellis, trellis.path(chosen[group]))
    useful = (is_free & (segments.start < np.flatnonzero(excess)[-1]))[positions]
    positions, indices, cost = positions[useful], indices[useful], cost[useful]
    pairs = zip(positions, indices, strict=True)
    donors = np.array([trellis.candidates[p][i] for p, i in pairs], np.int64)
    begins, ends = segments.start[positions], segments.stop[positions]
    # Frames before a substitution stay unchanged; the frames of its position are the donor's;
    violations = np.concatenate([[0.0], np.cumsum(excess)])[begins]
    root_start = root[begins]
    active = np.flatnonzero(problem.is_constrained_position[positions])
    counts = segments.lengths[positions] + 1
    for chunk in split_by_count(active, counts[active]):
        own = candidate_poses(
            problem, group, positions[chunk], donors[chunk], motion, root_start[chunk]
        )
        starts = np.cumsum(counts[chunk]) - counts[chunk]
        violations[chunk] += np.add.reduceat(pose_excess(problem, own), starts)
    # and all later frames move rigidly with the root.
    moves = AlignmentTransform.from_roots(
        root[ends], advance_root(problem, donors, root_start), problem.library.up
    )
    _add_excess_after(problem, poses, ends, moves, violations)
    order = np.lexsort([cost, violations])
    return positions[order], donors[order], violations[order]


def _add_excess_after(
    problem: SearchProblem,
    poses: Poses,
    ends: IntArray,
    moves: AlignmentTransform,
    violations: FloatArray,
) -> None:
    """Add to each of `violations` the estimated excess in all frames after a substitution.

    `ends` are the last frames of the substitutions, `moves` the transforms of all later frames.
    """
    frames = np.flatnonzero(problem.is_constrained_frame)
    stride = max(1, int(np.ceil(len(frames) * len(ends) / (2 * _MAX_RANKING_POSES))))
    frames = frames[::stride]
    index, later = np.nonzero(frames > ends[:, None])
    for chunk in split_by_count(np.arange(len(index)), np.ones(len(index), np.int64)):
        at = frames[later[chunk]]
        still = poses.with_poses(at, poses.rotations[at], poses.positions[at])
        moved = pose_excess(problem, moves[index[chunk]].apply_to_poses(still))
        violations += stride * np.bincount(index[chunk], moved, len(ends))


def _feasible_changes(
    trellis: DonorTrellis, path: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all changes of one donor in a path that add no infeasible penalty.

    The results are positions, indices of the new candidates there, and the added costs.
    """
    costs = trellis.costs.conditional_costs(path)
    added = [own - own[index] for own, index in zip(costs, path.tolist(), strict=True)]
    positions = np.repeat(np.arange(len(added)), [len(own) for own in added])
    indices = np.concatenate([np.arange(len(own)) for own in added])
    cost = np.concatenate(added)
    feasible = (indices != path[positions]) & ~is_infeasible(cost)
    return positions[feasible], indices[feasible], cost[feasible]
