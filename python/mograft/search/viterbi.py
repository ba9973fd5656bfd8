"""Exact searches for paths through a trellis: cheapest, k cheapest, random and diverse paths.

A path takes one candidate index per position. Each search walks the trellis once from the end to
the start, accumulating the least cost (or the weight) of all continuations of each candidate, and
then once forwards to read off the path.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray


class ComputedMatrices(Sequence[FloatArray]):
    """Pairwise costs that are computed when they are read, a block of positions at a time.

    `compute` returns the matrices of the positions `start` to `stop` - 1. The last block is kept.
    `positions` are those of this sequence.
    """

    def __init__(
        self,
        compute: Callable[[int, int], list[FloatArray]],
        positions: range,
        block_length: int,
        block: tuple[int, list[FloatArray]] = (-1, []),
    ) -> None:
        self._compute, self._positions = compute, positions
        self._block_length, self._block = block_length, block

    def __len__(self) -> int:
        return len(self._positions)

    @overload
    def __getitem__(self, index: int) -> FloatArray: ...
    @overload
    def __getitem__(self, index: slice) -> "ComputedMatrices": ...
    def __getitem__(self, index: int | slice) -> "FloatArray | ComputedMatrices":
        chosen = self._positions[index]
        if isinstance(chosen, range):
            return ComputedMatrices(self._compute, chosen, self._block_length, self._block)
        number, row = divmod(chosen, self._block_length)
        known, matrices = self._block  # another thread may replace it
        if known != number:
            start = number * self._block_length
            matrices = self._compute(start, start + self._block_length)
            self._block = number, matrices
        return matrices[row]


@dataclass(frozen=True, eq=False)
class Trellis:
    """Unary costs of the candidates at each position, and pairwise costs to the next position."""

    unary: tuple[FloatArray, ...]  # for each position shape (n_candidates,); infinite if forbidden
    pairwise: Sequence[FloatArray]  # for each position but the last shape (n, n of the next)

    def __len__(self) -> int:
        return len(self.unary)

    def cost(self, path: IntArray) -> float:
        """Return the total cost of a path, which holds the candidate index at each position."""
        indices = path.tolist()
        unary = sum(float(costs[i]) for costs, i in zip(self.unary, indices, strict=True))
        pairs = zip(self.pairwise, indices[:-1], indices[1:], strict=True)
        return unary + sum(float(costs[i, j]) for costs, i, j in pairs)

    def add_unary(self, costs: Sequence[FloatArray]) -> "Trellis":
        """Return the trellis with `costs`, one array per position, added to the unary costs."""
        summed = (unary + further for unary, further in zip(self.unary, costs, strict=True))
        return replace(self, unary=tuple(summed))

    def charge(self, path: IntArray, cost: float) -> "Trellis":
        """Return the trellis with `cost` added to the unary cost of each candidate on a path."""
        unary = [costs.copy() for costs in self.unary]
        for costs, index in zip(unary, path.tolist(), strict=True):
            costs[index] += cost
        return replace(self, unary=tuple(unary))

    def scale_above(self, limit: float, factor: float) -> "Trellis":
        """Return the trellis in which costs of at least `limit` are multiplied by `factor`."""
        unary, pairwise = (
            tuple(np.where(own >= limit, factor * own, own) for own in costs)
            for costs in (self.unary, self.pairwise)
        )
        return replace(self, unary=unary, pairwise=pairwise)

    def slice(self, start: int, stop: int) -> "Trellis":
        """Return the trellis of the positions from `start` up to, not including, `stop`."""
        return Trellis(self.unary[start:stop], self.pairwise[start : stop - 1])

    def restrict_first(self, indices: IntArray) -> "Trellis":
        """Return the trellis with only the candidates `indices` at the first position."""
        first = [own[indices] for own in self.pairwise[:1]]
        return Trellis((self.unary[0][indices], *self.unary[1:]), (*first, *self.pairwise[1:]))

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
    if not len(trellis):
        return np.zeros(0, np.int64)
    to_end = [trellis.unary[-1]]
    for unary, pairwise in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
        to_end.append(unary + (pairwise + to_end[-1]).min(axis=1))
    to_end.reverse()
    path = [int(to_end[0].argmin())]
    for pairwise, onward in zip(trellis.pairwise, to_end[1:], strict=True):
        path.append(int((pairwise[path[-1]] + onward).argmin()))
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
    if not len(trellis):
        return [np.zeros(0, np.int64)] if count else []
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
    (Carter and Kohn, Biometrika 81, 1994) with both directions reversed, computed in logarithms.
    """
    if not len(trellis):
        return np.zeros(0, np.int64)
    if isinstance(trellis.pairwise, ComputedMatrices):
        return _sample_stepwise(trellis, temperature, rng.random(len(trellis)))
    counts = np.array([len(costs) for costs in trellis.unary])
    pairwise = np.concatenate([np.zeros(0), *(costs.ravel() for costs in trellis.pairwise)])
    draws = rng.random(len(trellis))
    return _core.sample(counts, np.concatenate(trellis.unary), pairwise, temperature, draws)


def _sample_stepwise(trellis: Trellis, temperature: float, draws: FloatArray) -> IntArray:
    """Draw a path as the kernel does, with the pairwise costs of few positions in memory."""
    weights = [-trellis.unary[-1] / temperature]
    with np.errstate(divide="ignore", invalid="ignore"):
        for unary, pairwise in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
            onward = weights[-1] - pairwise / temperature
            top = onward.max(axis=1)
            top = np.where(np.isfinite(top), top, 0.0)
            sums = np.exp(onward - top[:, None]).sum(axis=1)
            weights.append(-unary / temperature + (top + np.log(sums)))
        path: list[int] = []
        for position, (ends, draw) in enumerate(zip(reversed(weights), draws, strict=True)):
            if position:
                ends = ends - trellis.pairwise[position - 1][path[-1]] / temperature
            sums = np.cumsum(np.exp(ends - ends.max()))
            index = int(np.searchsorted(sums, draw * sums[-1], side="right"))
            path.append(min(index, len(ends) - 1))
    return np.array(path, np.int64)


def diverse(trellis: Trellis, count: int, penalty: float) -> list[IntArray]:
    """Return different paths; each is the cheapest when earlier use of candidates is penalised.

    `penalty` is added to the cost of a candidate for each earlier path through it. The first path
    is that of `viterbi`. If the cheapest path is an earlier one, the cheapest new path is returned
    instead. There are fewer than `count` paths if no new one exists.

    Examples
    --------
    >>> trellis = Trellis((np.array([0.0, 1.0]), np.array([0.0, 5.0])), (np.zeros((2, 2)),))
    >>> [path.tolist() for path in diverse(trellis, 2, penalty=9.0)]
    [[0, 0], [1, 1]]
    """
    paths: list[IntArray] = []
    seen: set[bytes] = set()
    while len(paths) < count:
        path = viterbi(trellis)
        if path.tobytes() in seen:
            # One more path than there are in `seen`, so at least one is new if any is left.
            others = (p for p in k_best(trellis, len(paths) + 1) if p.tobytes() not in seen)
            unseen = next(others, None)
            if unseen is None:
                break
            path = unseen
        paths.append(path)
        seen.add(path.tobytes())
        trellis = trellis.charge(path, penalty)
    return paths
