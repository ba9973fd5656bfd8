"""Trellises of donors, and exact searches for paths through them.

A path takes one candidate index per position: the cheapest, the k cheapest, random and diverse
paths. Each search walks the trellis once from the end to the start, accumulating the least cost (or
the weight) of all continuations of each candidate, and then once forwards to read off the path.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.search.costs import PRESELECTION, CostModel
from mograft.search.segment_pool import POSITIONS_PER_BATCH, SegmentPool, list_pairs

_N_SEGMENT_BITS = 32
_SEGMENT_BITS = (1 << _N_SEGMENT_BITS) - 1

DonorSequences = dict[str, IntArray]
"""The donor sequence of each grafted group: the donor segment at each position."""


@dataclass(frozen=True, eq=False)
class Trellis:
    """Unary costs of the candidates at each position, and pairwise costs to the next position."""

    unary: tuple[FloatArray, ...]  # for each position shape (n_candidates,); infinite if forbidden
    pairwise: Sequence[FloatArray]  # for each position but the last shape (n, n of the next)

    def __len__(self) -> int:
        return len(self.unary)

    def add_unary(self, costs: Sequence[FloatArray]) -> "Trellis":
        """Return the trellis with `costs`, one array per position, added to the unary costs."""
        summed = (unary + further for unary, further in zip(self.unary, costs, strict=True))
        return replace(self, unary=tuple(summed))

    def map_costs(self, function: Callable[[FloatArray], FloatArray]) -> "Trellis":
        """Return the trellis with `function` applied to all unary and pairwise costs."""
        return Trellis(tuple(map(function, self.unary)), tuple(map(function, self.pairwise)))

    def slice(self, start: int, stop: int) -> "Trellis":
        """Return the trellis of the positions from `start` up to, not including, `stop`."""
        return Trellis(self.unary[start:stop], self.pairwise[start : stop - 1])

    def fix(self, position: int, index: int) -> "Trellis":
        """Return the trellis in which all other candidates of a position are forbidden."""
        unary = [*self.unary]
        unary[position] = np.full_like(unary[position], np.inf)
        unary[position][index] = self.unary[position][index]
        return Trellis(tuple(unary), self.pairwise)

    def slice_within(self, path: IntArray, start: int, stop: int) -> "Trellis":
        """Return the trellis of positions `start` to `stop - 1`; the others are fixed as in `path`.

        The unary costs of the first and last position include the pairwise costs to the fixed
        candidates beside them.
        """
        unary = list(self.unary[start:stop])
        if start > 0:
            unary[0] = unary[0] + self.pairwise[start - 1][path[start - 1]]
        if stop < len(self):
            unary[-1] = unary[-1] + self.pairwise[stop - 1][:, path[stop]]
        return Trellis(tuple(unary), self.pairwise[start : stop - 1])

    def conditional_costs(self, path: IntArray) -> list[FloatArray]:
        """Return the cost of each candidate at each position with all other positions as in `path`.

        The cost is the candidate's unary cost plus the pairwise costs with both neighbours on the
        path.
        """
        costs = list(self.unary)
        for position, pairwise in enumerate(self.pairwise):
            costs[position] = costs[position] + pairwise[:, path[position + 1]]
            costs[position + 1] = costs[position + 1] + pairwise[path[position]]
        return costs


def viterbi(trellis: Trellis) -> IntArray:
    """Return the cheapest path.

    Ties go to the path with the lowest first index, then the lowest second, and so on. Time is
    O(Σ n_p n_{p+1}) for n_p candidates at position p. The algorithm is that of Viterbi, IEEE Trans.
    Information Theory 13 (1967), run from the last position to the first.

    Examples
    --------
    >>> step = np.array([[0.0, 2.0], [2.0, 0.0]])
    >>> viterbi(Trellis((np.array([0.0, 1.0]), np.array([3.0, 0.0])), (step,)))
    array([1, 1])
    """
    to_end = [trellis.unary[-1]]
    for unary, pairwise in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
        to_end.append(unary + (pairwise + to_end[-1]).min(axis=1))
    to_end.reverse()
    path = [int(to_end[0].argmin())]
    for position, onward in enumerate(to_end[1:]):
        path.append(int((trellis.pairwise[position][path[-1]] + onward).argmin()))
    return np.array(path, np.int64)


def k_best(trellis: Trellis, count: int) -> list[IntArray]:
    """Return the `count` cheapest paths, in ascending order of cost; ties as in `viterbi`.

    There are fewer if fewer paths have a finite cost. The algorithm is the list Viterbi algorithm,
    in which every candidate keeps its `count` cheapest continuations (Seshadri and Sundberg, IEEE
    Trans. Communications 42, 1994).

    Examples
    --------
    >>> trellis = Trellis((np.array([0.0, 1.0]), np.array([0.0, 5.0])), (np.zeros((2, 2)),))
    >>> [path.tolist() for path in k_best(trellis, 3)]
    [[0, 0], [1, 0], [0, 1]]
    """
    # Row i of `to_end` holds the costs of the cheapest continuations of candidate i, ascending.
    to_end = trellis.unary[-1][:, None]
    links: list[tuple[IntArray, IntArray]] = []
    for unary, pairwise in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
        width = to_end.shape[1]
        through = (pairwise[:, :, None] + to_end).reshape(len(unary), -1)
        order = np.argsort(through, axis=1, kind="stable")[:, :count]
        links.append((order // width, order % width))
        to_end = unary[:, None] + np.take_along_axis(through, order, axis=1)
    width = to_end.shape[1]
    order = np.argsort(to_end.ravel(), kind="stable")[:count]
    paths = []
    for start in order[np.isfinite(to_end.ravel()[order])].tolist():
        index, rank = divmod(start, width)
        path = [index]
        for successors, ranks in reversed(links):
            index, rank = int(successors[index, rank]), int(ranks[index, rank])
            path.append(index)
        paths.append(np.array(path, np.int64))
    return paths


def sample(trellis: Trellis, temperature: float, rng: np.random.Generator) -> IntArray:
    """Draw a path with probability proportional to exp(-cost / temperature).

    One random number is drawn per position. The method is forward filtering, backward sampling
    (Carter and Kohn, Biometrika 81, 1994) with the directions exchanged: weights are summed from
    the last position to the first, in logarithms, and the path is drawn from the first to the last.
    """
    counts = np.array([len(costs) for costs in trellis.unary])
    pairwise = np.concatenate([np.zeros(0), *(costs.ravel() for costs in trellis.pairwise)])
    draws = rng.random(len(trellis))
    return _core.sample(counts, np.concatenate(trellis.unary), pairwise, temperature, draws)


def diverse(
    trellis: Trellis,
    charges: Callable[[IntArray], Sequence[FloatArray]],
    captured: IntArray | None = None,
    search: Callable[[Trellis], IntArray] = viterbi,
) -> Iterator[IntArray]:
    """Yield different paths; each is the cheapest after costs are added for the earlier ones.

    `charges` returns the costs to add to the unary costs of all candidates after a path. The first
    path is that of `search`; only it may be `captured`. If the path found is an earlier one,
    the cheapest new path is yielded instead.

    Examples
    --------
    >>> trellis = Trellis((np.array([0.0, 1.0]), np.array([0.0, 5.0])), (np.zeros((2, 2)),))
    >>> paths = diverse(trellis, lambda path: 9.0 * np.eye(2)[path])
    >>> next(paths).tolist(), next(paths).tolist()
    ([0, 0], [1, 1])
    """
    seen: set[bytes] = set()
    while True:
        path = search(trellis)
        if path.tobytes() in seen:
            # One more path than there are in `seen`, so at least one is new if any is left.
            others = [own for own in k_best(trellis, len(seen) + 1) if own.tobytes() not in seen]
            if not others:
                return
            path = others[0]
        yield path
        seen |= {own.tobytes() for own in (path, captured) if own is not None}
        trellis = trellis.add_unary(charges(path))


@dataclass(frozen=True, eq=False)
class DonorTrellis:
    """The candidates at each position of a sequence of base segments, and their costs."""

    scenario: IntArray  # the base segments, shape (n_positions,)
    candidates: tuple[IntArray, ...]  # at each position, ascending
    costs: Trellis
    # Costs of the seams from the last position to the first, if the base is a loop.
    join: FloatArray | None = None

    @classmethod
    def build(
        cls,
        pool: SegmentPool,
        scenario: IntArray,
        candidates: Sequence[IntArray],
        model: CostModel,
        constraint_costs: Sequence[FloatArray] | None = None,
    ) -> "DonorTrellis":
        """Return the trellis of the cheapest candidates at each position.

        `scenario` holds the base segments and `candidates` the allowed segments at each position,
        ascending. At most `max_candidates` are kept at a position, chosen from `PRESELECTION` times
        as many that have the lowest `preselection_costs`; the base segment is among them. Ties
        go to the lowest index.
        """
        kept: list[IntArray] = []
        unary: list[FloatArray] = []
        for start in range(0, len(scenario), POSITIONS_PER_BATCH):
            batch = slice(start, start + POSITIONS_PER_BATCH)
            base, found = scenario[batch], candidates[batch]
            costs = pool.preselection_costs(*list_pairs(base, found), model)
            if constraint_costs is not None:
                costs = costs + np.concatenate(constraint_costs[batch])
            found, own = model.keep_cheapest_of_each(base, found, costs, PRESELECTION)
            costs = np.concatenate(own) + pool.further_costs(*list_pairs(base, found), model)
            found, own = model.keep_cheapest_of_each(base, found, costs)
            kept += found
            unary += own
        seam_costs = tuple(pool.pairwise_costs_along(kept, model))
        return cls(scenario, tuple(kept), Trellis(tuple(unary), seam_costs))

    def find_path(self, costs: Trellis, search: Callable[[Trellis], IntArray]) -> IntArray:
        """Return the path that a search finds, given the costs of this trellis or changed ones.

        If the base is a loop, the search runs twice: the first time with the first position once
        more at the end, which selects its donor; then with this donor at both ends.
        """
        if self.join is None:
            return search(costs)
        around = Trellis(
            (*costs.unary, np.zeros_like(costs.unary[0])), (*costs.pairwise, self.join)
        )
        first = int(search(around)[-1])
        return search(around.fix(0, first).fix(-1, first))[:-1]

    def donor_sequence(self, path: IntArray) -> IntArray:
        """Return the donor segment at each position of a path, shape (n_positions,)."""
        starts, keys = self._flat
        return keys[starts + path] & _SEGMENT_BITS

    def path(self, donors: IntArray) -> IntArray:
        """Return the path that visits a donor sequence; each donor must be among the candidates."""
        starts, keys = self._flat
        return np.searchsorted(keys, self._keys(np.arange(len(donors)), donors)) - starts

    def is_listed(self, donors: IntArray) -> BoolArray:
        """Return whether the donor at each position is among the candidates."""
        keys, wanted = self._flat[1], self._keys(np.arange(len(donors)), donors)
        return keys[np.searchsorted(keys, wanted).clip(max=len(keys) - 1)] == wanted

    @cached_property
    def _flat(self) -> tuple[IntArray, IntArray]:
        """Where each position starts among all candidates, and the `_keys` of all candidates."""
        counts = np.array([len(own) for own in self.candidates], np.int64)
        positions = np.repeat(np.arange(len(counts)), counts)
        return np.cumsum(counts) - counts, self._keys(positions, np.concatenate(self.candidates))

    @staticmethod
    def _keys(positions: IntArray, segments: IntArray) -> IntArray:
        """Return one number per candidate; the numbers ascend by position, then by segment."""
        return (positions << _N_SEGMENT_BITS) + segments
