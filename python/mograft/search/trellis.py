"""Trellises of donors: the candidates at every position of a base motion and their costs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, join_views
from mograft.search.candidates import POSITIONS_PER_BATCH, SegmentPool
from mograft.search.costs import PRESELECTION, CostModel
from mograft.search.viterbi import ComputedMatrices, Trellis

_MAX_STORED_SEAM_COSTS = 1 << 24
"""Costs of seams that are stored: 128 MiB. More are computed again in each pass over a trellis."""

DonorSequences = dict[str, IntArray]
"""The donor sequence of each grafted group: the donor segment at each position."""


@dataclass(frozen=True, eq=False)
class DonorTrellis:
    """The candidates at each position of a sequence of base segments, and their costs."""

    scenario: IntArray  # the base segments, shape (n_positions,)
    candidates: tuple[IntArray, ...]  # at each position, ascending
    costs: Trellis

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
        as many that are cheapest without the cost of balance; the base segment is among them. Ties
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

    def donor_sequence(self, path: IntArray) -> IntArray:
        """Return the donor segment at each position of a path, shape (n_positions,)."""
        segments, starts, _ = self._flat
        donors: IntArray = segments[starts + path]
        return donors

    def path(self, donors: IntArray) -> IntArray:
        """Return the path that visits a donor sequence; each donor must be among the candidates."""
        _, starts, keys = self._flat
        return np.searchsorted(keys, self._keys(np.arange(len(donors)), donors)) - starts

    def is_listed(self, donors: IntArray) -> BoolArray:
        """Return whether the donor at each position is among the candidates."""
        return np.isin(self._keys(np.arange(len(donors)), donors), self._flat[2])

    @cached_property
    def _flat(self) -> tuple[IntArray, IntArray, IntArray]:
        """All candidates, the index of the first one of each position, and the `_keys` of all."""
        counts = np.array([len(own) for own in self.candidates], np.int64)
        segments = np.concatenate(self.candidates)
        keys = self._keys(np.repeat(np.arange(len(counts)), counts), segments)
        return segments, np.cumsum(counts) - counts, keys

    @staticmethod
    def _keys(positions: IntArray, segments: IntArray) -> IntArray:
        """Return one number per candidate; the numbers ascend by position, then by segment."""
        return (positions << 32) + segments


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

    costs = pool.costs_without_balance(*pair(candidates), model)
    if constraint_costs is not None:
        costs = costs + np.concatenate(constraint_costs)
    kept, unary = model.keep_cheapest_of_each(scenario, candidates, costs, PRESELECTION)
    costs = np.concatenate(unary) + pool.balance_costs(*pair(kept), model)
    kept, unary = model.keep_cheapest_of_each(scenario, kept, costs)
    return join_views(kept), join_views(unary)


def _seam_costs(
    pool: SegmentPool, candidates: Sequence[IntArray], model: CostModel
) -> Sequence[FloatArray]:
    """Return the costs of seams, computed when they are read if they are many."""
    counts = np.array([len(own) for own in candidates], np.int64)
    if (counts[:-1] * counts[1:]).sum() <= _MAX_STORED_SEAM_COSTS:
        return tuple(pool.pairwise_costs_along(candidates, model))

    def compute(start: int, stop: int) -> list[FloatArray]:
        return pool.pairwise_costs_along(candidates[start : stop + 1], model)

    return ComputedMatrices(compute, range(len(candidates) - 1), POSITIONS_PER_BATCH)
