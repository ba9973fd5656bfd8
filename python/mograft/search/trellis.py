"""Trellises of donors: the candidates at every position of a base motion and their costs."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.search.candidates import SegmentPool
from mograft.search.costs import CostModel
from mograft.search.viterbi import Trellis

__all__ = ["DonorSequences", "DonorTrellis"]

DonorSequences = dict[str, IntArray]
"""For every grafted group the donor sequence: the donor segment at each position."""


@dataclass(frozen=True, eq=False)
class DonorTrellis:
    """The candidates at each position of a base segment sequence, and their costs.

    Made by `DonorTrellis.build`.

    Attributes
    ----------
    scenario : ndarray of int, shape (n_positions,)
        The base segments.
    candidates : tuple of ndarray of int
        The considered segments at each position, ascending, the base segment among them.
    costs : Trellis
        Their unary and pairwise costs.
    """

    scenario: IntArray
    candidates: tuple[IntArray, ...]
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

        Parameters
        ----------
        pool : SegmentPool
            The segments.
        scenario : ndarray of int, shape (n_positions,)
            The base segments.
        candidates : sequence of ndarray of int
            The allowed segments at each position, ascending, the base segment among them.
        model : CostModel
            Gives unary and pairwise costs and the number of candidates to keep.
        constraint_costs : sequence of ndarray, optional
            Costs of each candidate for the constraints. Default: none.

        Returns
        -------
        DonorTrellis
            With the cheapest `max_candidates` at each position; ties go to the lowest index.
        """
        counts = [len(segments) for segments in candidates]
        costs = pool.unary_costs(np.repeat(scenario, counts), np.concatenate(candidates), model)
        if constraint_costs is not None:
            costs = costs + np.concatenate(constraint_costs)
        kept: list[IntArray] = []
        unary: list[FloatArray] = []
        for base, segments, own in zip(
            scenario.tolist(), candidates, np.split(costs, np.cumsum(counts)[:-1]), strict=True
        ):
            order = model.keep_cheapest(own, segments == base)
            kept.append(segments[order])
            unary.append(own[order])
        seams = [pool.pairwise_costs(left, right, model) for left, right in pairwise(kept)]
        return cls(scenario, tuple(kept), Trellis(tuple(unary), tuple(seams)))

    def donor_sequence(self, path: IntArray) -> IntArray:
        """Return the segments of a path, shape (n_positions,)."""
        pairs = zip(self.candidates, path.tolist(), strict=True)
        return np.array([segments[index] for segments, index in pairs], np.int64)

    def path(self, donors: IntArray) -> IntArray:
        """Return the path of a donor sequence; each donor must be among the candidates."""
        pairs = zip(self.candidates, donors.tolist(), strict=True)
        return np.array([np.searchsorted(segments, donor) for segments, donor in pairs], np.int64)
