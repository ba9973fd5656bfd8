"""Trellises of donors: the candidates at every position of a base motion and their costs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.search.costs import PRESELECTION, CostModel
from mograft.search.segment_pool import POSITIONS_PER_BATCH, SegmentPool
from mograft.search.viterbi import ComputedMatrices, Trellis

_MAX_STORED_SEAM_COSTS = 1 << 24
"""Costs of seams that are stored: 128 MiB. More are computed again in each pass over a trellis."""

_N_SEGMENT_BITS = 32
_SEGMENT_BITS = (1 << _N_SEGMENT_BITS) - 1

DonorSequences = dict[str, IntArray]
"""The donor sequence of each grafted group: the donor segment at each position."""


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
            own = None if constraint_costs is None else constraint_costs[batch]
            found, costs = _keep_cheapest(pool, scenario[batch], candidates[batch], model, own)
            kept += found
            unary += costs
        return cls(scenario, tuple(kept), Trellis(tuple(unary), _seam_costs(pool, kept, model)))

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
        first = search(around)[-1:]
        path = search(around.restrict_first(first).restrict_last(first))
        return np.append(first, path[1:-1])

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
        keys = self._keys(
            np.repeat(np.arange(len(counts)), counts), np.concatenate(self.candidates)
        )
        return np.cumsum(counts) - counts, keys

    @staticmethod
    def _keys(positions: IntArray, segments: IntArray) -> IntArray:
        """Return one number per candidate; the numbers ascend by position, then by segment."""
        return (positions << _N_SEGMENT_BITS) + segments


def _keep_cheapest(
    pool: SegmentPool,
    scenario: IntArray,
    candidates: Sequence[IntArray],
    model: CostModel,
    constraint_costs: Sequence[FloatArray] | None,
) -> tuple[list[IntArray], list[FloatArray]]:
    """Return the cheapest candidates of some positions and their costs; see `DonorTrellis`."""

    def pair(lists: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
        return np.repeat(scenario, [len(own) for own in lists]), np.concatenate(lists)

    costs = pool.preselection_costs(*pair(candidates), model)
    if constraint_costs is not None:
        costs = costs + np.concatenate(constraint_costs)
    kept, unary = model.keep_cheapest_of_each(scenario, candidates, costs, PRESELECTION)
    costs = np.concatenate(unary) + pool.further_costs(*pair(kept), model)
    return model.keep_cheapest_of_each(scenario, kept, costs)


def _seam_costs(
    pool: SegmentPool, candidates: Sequence[IntArray], model: CostModel
) -> Sequence[FloatArray]:
    """Return the costs of seams; if they are many, they are computed whenever they are read."""
    counts = np.array([len(own) for own in candidates], np.int64)
    if (counts[:-1] * counts[1:]).sum() <= _MAX_STORED_SEAM_COSTS:
        return tuple(pool.pairwise_costs_along(candidates, model))

    def compute(start: int, stop: int) -> list[FloatArray]:
        return pool.pairwise_costs_along(candidates[start : stop + 1], model)

    def compute_row(position: int, index: int) -> FloatArray:
        left, right = candidates[position][index : index + 1], candidates[position + 1]
        return pool.pairwise_costs(left, right, model)[0]

    positions = range(len(candidates) - 1)
    return ComputedMatrices(compute, compute_row, positions, POSITIONS_PER_BATCH)
