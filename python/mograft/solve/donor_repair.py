"""Repair of donor sequences whose assembled motion violates hard constraints.

Seam treatment can introduce violations that the trellis does not contain. Repair penalises the
donors at violated positions and searches again; then it assembles the cheapest short sequences
around each remaining violation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.runs import dilate, find_runs
from mograft.search.costs import INFEASIBLE_PENALTY, is_infeasible
from mograft.search.trellis import DonorSequences, DonorTrellis
from mograft.search.viterbi import Trellis, k_best, viterbi
from mograft.solve.assembly import donor_excess, donor_excesses
from mograft.solve.donor_trellis import candidate_violations
from mograft.solve.search_problem import SearchProblem

_MAX_ROUNDS = 8  # searches with increased penalties
_REPAIR_RADIUS = 3  # positions beside a violated one that a restricted problem can change
_MAX_WINDOW_LENGTH = 8  # positions of the longest window whose sequences are assembled
_N_CHEAPEST_TRIALS = 48  # cheapest sequences of a window that are assembled
_N_NEAREST_TRIALS = 4 * _N_CHEAPEST_TRIALS  # those with the least violation before seam treatment
_TRIALS_PER_BATCH = 24  # sequences that are assembled together


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
    contains the root do not change: see `mograft.solve.root_tabu_search`.
    """
    if not any(constraint.is_hard for constraint in problem.constraints):
        return donors
    chosen = {
        group: replace_unlisted(donors[group], trellis) for group, trellis in trellises.items()
    }
    local = {group: own for group, own in trellises.items() if group != problem.root_group}
    if not local:
        return chosen
    penalties = {
        group: [np.zeros(len(own)) for own in trellis.candidates]
        for group, trellis in local.items()
    }
    least, best = np.inf, chosen
    for _ in range(_MAX_ROUNDS):
        excess = donor_excess(problem, chosen)
        total = sum(float(own.sum()) for own in excess.values())
        if total < least:
            least, best = total, dict(chosen)
        if total == 0:
            return best
        for group, trellis in local.items():
            worst = problem.greatest_at_positions(excess[group])
            chosen[group] = search_again(trellis, penalties[group], chosen[group], worst)
    return _try_sequences(problem, best, local)


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
        if limit_factor != 1.0:
            costs = costs.map_costs(
                lambda own: np.where(is_infeasible(own), limit_factor * own, own)
            )
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
            amounts = _kept_amounts(problem, group, chosen, trellis)
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


def _kept_amounts(
    problem: SearchProblem, group: str, chosen: DonorSequences, trellis: DonorTrellis
) -> list[FloatArray]:
    """Return, for each position, by how much candidates of a trellis violate hard constraints."""
    found = candidate_violations(problem, group, chosen)
    listed = zip(found, problem.candidates[group], trellis.candidates, strict=True)
    return [own.hard[np.searchsorted(everyone, kept)] for own, everyone, kept in listed]


def _least_violating(
    problem: SearchProblem, alternatives: Sequence[DonorSequences], first: int, stop: int
) -> DonorSequences:
    """Return the alternative with the smallest total violation in a range of positions.

    Ties go to the first.
    """
    least, best = np.inf, alternatives[0]
    for i in range(0, len(alternatives), _TRIALS_PER_BATCH):
        batch = alternatives[i : i + _TRIALS_PER_BATCH]
        excesses = donor_excesses(problem, batch, first, stop).values()
        totals = np.sum([own.sum(axis=1) for own in excesses], axis=0)
        if totals.min() < least:
            least, best = float(totals.min()), batch[int(totals.argmin())]
        if least == 0:
            break
    return best
