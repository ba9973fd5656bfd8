"""A high percentile of columns of numbers, computed repeatedly without different rows."""

from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import FloatArray, IntArray

SLACK = 1024
"""Rows that can be left out before all numbers of a column are read again."""


@dataclass(frozen=True, eq=False)
class HighPercentile:
    """A high percentile of each column of `values`, computed without a given range of rows.

    The result equals that of ``numpy.percentile``, bit for bit. The rows of the greatest values are
    found once, so that the time of `without` does not grow with the number of rows.
    """

    values: FloatArray  # (n_rows, n_columns), finite
    percentile: float  # 0 to 100
    # Of columns that were used, the rows of the greatest values, in descending order of the values.
    _greatest: dict[int, IntArray] = field(init=False, default_factory=dict)

    def without(self, first: int, stop: int, columns: IntArray) -> FloatArray | None:
        """Return the percentiles of the given columns over the rows outside ``first:stop``.

        The result is None if there are no such rows.
        """
        first, stop = max(first, 0), min(stop, len(self.values))
        n_left = len(self.values) - max(stop - first, 0)
        if not n_left:
            return None
        return np.array([self._of_column(own, first, stop, n_left) for own in columns.tolist()])

    def _of_column(self, column: int, first: int, stop: int, n_left: int) -> float:
        """Interpolate between the two values next to the percentile, as NumPy does."""
        values, rows = self.values[:, column], self._rows_of_greatest(column)
        index = (n_left - 1) * (self.percentile / 100.0)
        below = min(int(index), max(n_left - 2, 0))
        rows = rows[(rows < first) | (rows >= stop)]
        ranks = n_left - 1 - np.minimum([below, below + 1], n_left - 1)
        if ranks[0] >= len(rows):
            others = np.concatenate([values[:first], values[max(stop, first) :]])
            return float(np.percentile(others, self.percentile))
        low, high = map(float, values[rows[ranks]])
        share = index - below
        if share < 0.5:
            return low + (high - low) * share
        return high - (high - low) * (1.0 - share)

    def _rows_of_greatest(self, column: int) -> IntArray:
        if column not in self._greatest:
            values, n = self.values[:, column], len(self.values)
            n_kept = min(int((1.0 - self.percentile / 100.0) * n) + 3 + SLACK, n)
            rows = np.argpartition(values, n - n_kept)[n - n_kept :]
            self._greatest[column] = rows[np.argsort(-values[rows], kind="stable")]
        return self._greatest[column]
