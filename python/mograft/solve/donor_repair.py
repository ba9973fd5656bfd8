"""Repair of donor sequences whose assembled motion violates hard constraints.

Seam treatment can introduce violations that the trellis does not contain. Repair penalises the
donors at violated positions and searches again; then it assembles the cheapest short sequences
around each remaining violation.

If a grafted group holds the root, replacing one donor moves all later frames rigidly over the
floor. A tabu search therefore ranks each single substitution by the violation of the whole moved
motion, and assembles the best-ranked ones.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.cancel import check_cancelled
from mograft._util.runs import dilate, find_runs
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.body.capsules import Poses
from mograft.motion.motion import Motion
from mograft.search.costs import INFEASIBLE_PENALTY, is_infeasible
from mograft.search.trellis import DonorSequences, DonorTrellis, Trellis, k_best, viterbi
from mograft.solve.assembly import assemble, donor_excess, donor_excesses, pose_excess
from mograft.solve.donor_trellis import (
    advance_root,
    candidate_poses,
    candidate_violations,
    group_trellis,
    split_by_count,
)
from mograft.solve.search_problem import SearchProblem

_MAX_ROUNDS = 8  # searches with increased penalties
_MAX_ROUNDS_NEAR = 4
_REPAIR_RADIUS = 3  # positions beside a violated one that a restricted problem can change
_MAX_WINDOW_LENGTH = 8  # positions of the longest window whose sequences are assembled
_N_CHEAPEST_TRIALS = 48  # cheapest sequences of a window that are assembled
_N_NEAREST_TRIALS = 4 * _N_CHEAPEST_TRIALS  # those with the least violation before seam treatment
_TRIALS_PER_BATCH = 24  # sequences that are assembled together
_MAX_ITERATIONS = 64  # substitutions that are made, at most
_MAX_ITERATIONS_WITHOUT_GAIN = 16  # consecutive substitutions without a new best result, at most
_MAX_TENURE = 6  # iterations during which a changed position stays fixed, at most
_N_ASSEMBLED = 2  # best-ranked substitutions that are assembled in each iteration
_MAX_RANKING_POSES = 200_000  # approximate, for one ranking; larger motions are sampled at a stride


def restrict_to_violations(problem: SearchProblem, donors: DonorSequences) -> SearchProblem:
    """Restrict the candidates of a problem to changes near the violations of `donors`.

    More than 3 positions from a violation, the only candidates are the donor in `donors` and the
    base segment. Positions at which constraints exclude the base segment keep all candidates.
    """
    excess = donor_excess(problem, donors)
    candidates = {}
    for group, lists in problem.candidates.items():
        near = dilate(problem.positions_with(excess[group]), _REPAIR_RADIUS)
        candidates[group] = [
            segments if is_near or base not in segments else np.unique([base, donor])
            for segments, is_near, base, donor in zip(
                lists, near, problem.scenario, donors[group], strict=True
            )
        ]
    return replace(problem, candidates=candidates)


def repair_donors(
    problem: SearchProblem, donors: DonorSequences, trellises: Mapping[str, DonorTrellis]
) -> DonorSequences:
    """Change donors until the assembled motion satisfies the hard constraints, if possible.

    Return the sequences with the smallest total violation among all that were tried; ties go to the
    first. Only donors at violated positions and next to them change. The donors of a group that
    contains the root do not change: see `tabu_search`.
    """
    chosen = {
        group: replace_unlisted(donors[group], trellis) for group, trellis in trellises.items()
    }
    local = {group: own for group, own in trellises.items() if group != problem.root_group}
    if not local:
        return chosen
    whole = 0, len(problem.base_segments)
    best, least = _search_repeatedly(problem, chosen, local, _MAX_ROUNDS, *whole)
    return best if least == 0 else _try_sequences(problem, best, local)


def repair_near(
    problem: SearchProblem,
    donors: DonorSequences,
    trellises: Mapping[str, DonorTrellis],
    first: int,
    stop: int,
) -> DonorSequences:
    """Change donors as `repair_donors`, but without assembling the sequences around a violation.

    Violations count in the positions `first` to `stop` - 1. No group may contain the root. This
    takes a tenth of the time of `repair_donors`, and satisfies the constraints less often.
    """
    return _search_repeatedly(problem, donors, trellises, _MAX_ROUNDS_NEAR, first, stop)[0]


def _search_repeatedly(
    problem: SearchProblem,
    donors: DonorSequences,
    trellises: Mapping[str, DonorTrellis],
    n_rounds: int,
    first: int,
    stop: int,
) -> tuple[DonorSequences, float]:
    """Penalise the donors at violations and search again, until there are none or for `n_rounds`.

    Return the sequences with the smallest total violation in the positions `first` to `stop` - 1,
    and this violation; ties go to the first.
    """
    chosen = dict(donors)
    penalties = {
        group: [np.zeros(len(own)) for own in trellis.candidates]
        for group, trellis in trellises.items()
    }
    least, best = np.inf, chosen
    begin, end = problem.base_segments.start[first], problem.base_segments.stop[stop - 1]
    for _ in range(n_rounds):
        check_cancelled()
        excess = donor_excesses(problem, [chosen], first, stop)
        total = sum(float(own.sum()) for own in excess.values())
        if total < least:
            least, best = total, dict(chosen)
        if total == 0:
            break
        for group, trellis in trellises.items():
            frames = np.zeros(problem.base.n_frames)
            frames[begin : end + 1] = excess[group][0]
            worst = problem.greatest_at_positions(frames)
            chosen[group] = search_again(trellis, penalties[group], chosen[group], worst)
    return best, least


def replace_unlisted(donors: IntArray, trellis: DonorTrellis) -> IntArray:
    """Replace donors that are not candidates of a trellis.

    The base segment replaces them; if it is not a candidate either, the cheapest candidate does.
    """
    replaced = donors.copy()
    for position in np.flatnonzero(~trellis.is_listed(donors)).tolist():
        base, candidates = trellis.scenario[position], trellis.candidates[position]
        cheapest = candidates[trellis.costs.unary[position].argmin()]
        replaced[position] = base if base in candidates else cheapest
    return replaced


def search_again(
    trellis: DonorTrellis,
    penalties: list[FloatArray],
    donors: IntArray,
    excess: FloatArray,
    limit_factor: float = 1.0,
) -> IntArray:
    """Penalise the donors at violated positions, and search again at and next to these positions.

    Return the new donor sequence. `excess`, shape (n_positions,), is above 0 at violated positions.
    The penalties are added to `penalties`, in place. `limit_factor` multiplies the costs of the
    trellis that contain an infeasible penalty, but not `penalties`.
    """
    violated = excess > 0
    if not violated.any():
        return donors
    path = trellis.path(donors)
    for position in np.flatnonzero(violated).tolist():
        penalties[position][path[position]] += INFEASIBLE_PENALTY * (1.0 + excess[position])
    for start, stop in find_runs(dilate(violated)).tolist():
        costs = trellis.costs.slice_within(path, start, stop)
        costs = costs.map_costs(lambda own: np.where(is_infeasible(own), limit_factor * own, own))
        path[start:stop] = viterbi(costs.add_unary(penalties[start:stop]))
    return trellis.donor_sequence(path)


def _try_sequences(
    problem: SearchProblem, donors: DonorSequences, trellises: Mapping[str, DonorTrellis]
) -> DonorSequences:
    """Assemble many sequences around each remaining violation; keep that of smallest violation.

    The cheapest sequences come first. Then follow those for which the violation amounts before seam
    treatment plus the seam costs are smallest. Seam costs count because seam treatment changes
    poses more at a wider gap. If violations remain, the base segments replace the donors on both
    sides, because the treatment of their seams can cause violations too.
    """
    chosen = dict(donors)
    for group, trellis in trellises.items():
        for radius, list_trials in _TRIALS:
            violated = problem.positions_with(donor_excess(problem, chosen)[group])
            windows = [
                (start, stop)
                for start, stop in find_runs(dilate(violated, radius)).tolist()
                if stop - start <= _MAX_WINDOW_LENGTH
            ]
            if not windows:
                break
            found = candidate_violations(problem, group, chosen)
            listed = zip(found, problem.candidates[group], trellis.candidates, strict=True)
            # By how much the candidates of the trellis violate hard constraints, at each position.
            amounts = [own.hard[np.searchsorted(every, kept)] for own, every, kept in listed]
            for start, stop in windows:
                first, last, trials = list_trials(
                    trellis, amounts, trellis.path(chosen[group]), start, stop
                )
                alternatives = [{**chosen, group: trellis.donor_sequence(own)} for own in trials]
                chosen = _least_violating(problem, alternatives, first, last)
    return chosen


def _trials_within(
    trellis: DonorTrellis, amounts: Sequence[FloatArray], path: IntArray, start: int, stop: int
) -> tuple[int, int, list[IntArray]]:
    """Return the positions to evaluate, first and stop, and the paths to try in this order.

    The paths are `path` itself, and those with other donors from position `start` to `stop` - 1.
    The positions to evaluate are these and one on either side. `amounts` has for each position by
    how much its candidates violate hard constraints.
    """
    by_amount = Trellis(tuple(amounts), trellis.costs.pairwise)
    cheapest = k_best(trellis.costs.slice_within(path, start, stop), _N_CHEAPEST_TRIALS)
    nearest = k_best(by_amount.slice(start, stop), _N_NEAREST_TRIALS)
    trials = [path, *(_replaced(path, start, own) for own in (*cheapest, *nearest))]
    return max(start - 1, 0), min(stop + 1, len(path)), trials


def _trials_between_base_segments(
    trellis: DonorTrellis, amounts: Sequence[FloatArray], path: IntArray, start: int, stop: int
) -> tuple[int, int, list[IntArray]]:
    """As `_trials_within`, but with the base segment at the 3 positions on either side.

    The last paths have a single donor that is not the base segment. The positions to evaluate are
    the six and those between them.
    """
    first, last = max(start - _REPAIR_RADIUS, 0), min(stop + _REPAIR_RADIUS, len(path))
    captured, unary = path.copy(), list(amounts[first:last])
    for position in range(first, last):
        is_base = trellis.candidates[position] == trellis.scenario[position]
        if not is_base.any():
            continue
        captured[position] = is_base.argmax()
        if not start <= position < stop:
            unary[position - first] = np.where(is_base, unary[position - first], np.inf)
    between = Trellis(tuple(unary), trellis.costs.slice(first, last).pairwise)
    nearest = k_best(between, _N_CHEAPEST_TRIALS)
    trials = [path, *(_replaced(path, first, own) for own in nearest)]
    for position in range(start, stop):
        indices = np.arange(len(trellis.candidates[position]))
        trials += [_replaced(captured, position, indices[k : k + 1]) for k in indices]
    return first, last, trials


def _replaced(path: IntArray, start: int, window: IntArray) -> IntArray:
    replaced = path.copy()
    replaced[start : start + len(window)] = window
    return replaced


# Kinds of trials in their order, each with the number of positions by which the range of changes
# extends on either side of a violation.
_TRIALS = (
    (1, _trials_within),
    (0, _trials_between_base_segments),
    (1, _trials_between_base_segments),
)


def _least_violating(
    problem: SearchProblem, alternatives: Sequence[DonorSequences], first: int, stop: int
) -> DonorSequences:
    """Return the alternative with the smallest total violation in a range of positions.

    Ties go to the first.
    """
    least, best = np.inf, alternatives[0]
    for i in range(0, len(alternatives), _TRIALS_PER_BATCH):
        check_cancelled()
        batch = alternatives[i : i + _TRIALS_PER_BATCH]
        excesses = donor_excesses(problem, batch, first, stop).values()
        totals = np.sum([own.sum(axis=1) for own in excesses], axis=0)
        if totals.min() < least:
            least, best = float(totals.min()), batch[int(totals.argmin())]
        if least == 0:
            break
    return best


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
    trellis = group_trellis(problem, group, trellises[group].candidates)
    tenure = min(_MAX_TENURE, sum(len(own) > 1 for own in trellis.candidates) // 2)

    def evaluate(sequences: DonorSequences) -> tuple[float, Motion]:
        motion = finish(assemble(problem, sequences), sequences)
        return float(pose_excess(problem, problem.poses_of(motion)).sum()), motion

    best, current = donors, donors
    least, motion = evaluate(donors)
    free_from, idle = np.zeros(len(problem.base_segments), np.int64), 0
    for iteration in range(_MAX_ITERATIONS):
        if least == 0 or idle == _MAX_ITERATIONS_WITHOUT_GAIN:
            break
        check_cancelled()
        positions, given, _ = rank_substitutions(
            problem, trellis, current, motion, free_from <= iteration
        )
        tried: list[tuple[float, Motion, DonorSequences, int]] = []
        pairs = zip(positions.tolist(), given.tolist(), strict=True)
        for position, donor in islice(pairs, _N_ASSEMBLED):
            changed = {**current, group: current[group].copy()}
            changed[group][position] = donor
            tried.append((*evaluate(changed), changed, position))
            if tried[-1][0] < least:
                break
        if not tried:
            break
        violation, motion, current, position = min(tried, key=lambda one: one[0])
        free_from[position] = iteration + 1 + tenure
        idle += 1
        if violation < least:
            least, best, idle = violation, current, 0
    return best


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
        moved = pose_excess(problem, moves[index[chunk]].apply_to_poses(poses[at]))
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
