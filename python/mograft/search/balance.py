"""The effect of donors on the balance of base segments, kept for repeated searches."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, make_read_only
from mograft.analysis.zero_moment import added_imbalances, zero_moment_operators

_SEGMENTS_PER_BATCH = 1 << 12  # base segments whose support margins are in memory
_MAX_KNOWN_PAIRS = 1 << 22  # base segments and donors whose effect is kept


@dataclass(frozen=True, eq=False)
class SegmentBalance:
    """The effect of donors on the balance of base segments, computed from two functions.

    Both functions take indices of segments, shape (n,). They return the results for these segments
    of the functions of `mograft.analysis.zero_moment` that have the same names.
    """

    mass_offsets: Callable[[IntArray], FloatArray]  # of the grafted group
    support_margins: Callable[[IntArray], FloatArray]  # of the whole body
    # The last results of `added_imbalances`, by the hash of the arguments: all grafts on one base
    # evaluate the same candidates.
    _known: dict[bytes, FloatArray] = field(init=False, default_factory=dict)

    def added_imbalances(self, base: IntArray, donors: IntArray, seconds: FloatArray) -> FloatArray:
        """Return by how much donors raise the imbalance of base segments, shape (n,).

        See `mograft.analysis.zero_moment.added_imbalances`. `base` and `donors` have shape (n,).
        `seconds` has the durations of all segments.
        """
        key = hashlib.sha256(np.stack([base, donors]).data).digest()
        known = self._known.get(key)
        if known is not None:
            return known
        added = np.zeros(len(base))
        others = np.flatnonzero(donors != base)
        starts = np.flatnonzero(np.diff(base[others], prepend=-1))
        for first in range(0, len(starts), _SEGMENTS_PER_BATCH):
            bounds = np.append(starts, len(others))[first : first + _SEGMENTS_PER_BATCH + 1]
            batch = others[bounds[0] : bounds[-1]]
            counts = np.diff(bounds)
            added[batch] = self._compute(base[others[bounds[:-1]]], donors[batch], counts, seconds)
        make_read_only(added)
        keys = list(self._known)  # other threads may add results
        self._known[key] = added
        n_known = sum(map(len, list(self._known.values())))
        while n_known > _MAX_KNOWN_PAIRS and keys:
            n_known -= len(self._known.pop(keys.pop(0), ()))
        return added

    def _compute(
        self, bases: IntArray, donors: IntArray, counts: IntArray, seconds: FloatArray
    ) -> FloatArray:
        """Return the `added_imbalances` of donors.

        `donors` holds the donors of the first of `bases`, then those of the next, and so on;
        `counts` are their numbers.
        """
        is_needed = np.zeros(len(seconds), bool)
        is_needed[bases] = is_needed[donors] = True
        rows = np.cumsum(is_needed) - 1
        offsets = self.mass_offsets(np.flatnonzero(is_needed))
        operators = zero_moment_operators(offsets.shape[1], seconds[bases])
        margins = self.support_margins(bases)
        return added_imbalances(offsets, (rows[bases], operators, margins), rows[donors], counts)
