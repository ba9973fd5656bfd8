"""The effect of donors on the balance of base segments, kept for repeated searches."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, make_read_only
from mograft.analysis.zero_moment import added_imbalances, zero_moment_shifts

_PAIRS_PER_BATCH = 1 << 15  # base segments and donors whose zero-moment points are in memory
_MAX_KNOWN_PAIRS = 1 << 22  # base segments and donors whose effect is kept


@dataclass(frozen=True, eq=False)
class SegmentBalance:
    """Functions of segment indices, shape (n,), to compute the effect of donors on balance.

    They return what the functions of `mograft.analysis.zero_moment` with these names return.
    """

    mass_offsets: Callable[[IntArray], FloatArray]  # of the grafted group
    support_margins: Callable[[IntArray], FloatArray]  # of the whole body
    # The last results of `added_imbalances`, by the hash of the arguments: all grafts on one base
    # evaluate the same candidates.
    _known: dict[bytes, FloatArray] = field(init=False, default_factory=dict)

    def added_imbalances(self, base: IntArray, donors: IntArray, seconds: FloatArray) -> FloatArray:
        """Return by how much donors raise the unbalanced share of base segments, shape (n,).

        See `mograft.analysis.zero_moment.added_imbalances`. `base` and `donors` have shape (n,).
        `seconds` has the durations of all segments.
        """
        key = hashlib.sha256(np.stack([base, donors]).data).digest()
        known = self._known.get(key)
        if known is not None:
            return known
        added = np.zeros(len(base))
        others = np.flatnonzero(donors != base)
        for start in range(0, len(others), _PAIRS_PER_BATCH):
            batch = others[start : start + _PAIRS_PER_BATCH]
            added[batch] = self._compute(np.stack([base[batch], donors[batch]]), seconds)
        make_read_only(added)
        keys = list(self._known)  # other threads may add results
        self._known[key] = added
        n_known = sum(map(len, list(self._known.values())))
        while n_known > _MAX_KNOWN_PAIRS and keys:
            n_known -= len(self._known.pop(keys.pop(0), ()))
        return added

    def _compute(self, pairs: IntArray, seconds: FloatArray) -> FloatArray:
        """Return the `added_imbalances` of pairs of a base segment and another donor, (2, n)."""
        segments, members = np.unique(pairs, return_inverse=True)
        of_base, of_donors = self.mass_offsets(segments)[members.reshape(pairs.shape)]
        shifts = zero_moment_shifts(of_base, of_donors, seconds[pairs[0]])
        positions, rows = np.unique(pairs[0], return_inverse=True)
        return added_imbalances(shifts, self.support_margins(positions), rows)
