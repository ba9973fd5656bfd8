"""Mean and scatter matrix of the first rows of a matrix, for a growing number of rows."""

import numpy as np

from mograft._util.arrays import FloatArray


class GrowingScatter:
    """Mean and scatter matrix of the first `n` rows of a matrix; `n` grows from 0.

    Every row is used once, so all scatter matrices together cost one product of the whole matrix.
    """

    def __init__(self, rows: FloatArray) -> None:
        self.n = 0
        self._rows = rows - rows[:1]  # small numbers, whose squares cancel less
        self._first = rows[:1].sum(axis=0)
        self._products = np.zeros((rows.shape[1],) * 2)
        self._sum = np.zeros(rows.shape[1])

    def grow_to(self, n: int) -> None:
        """Use the first `n` rows from now on; `n` must not decrease."""
        rows = self._rows[self.n : n]
        self._products += rows.T @ rows
        self._sum += rows.sum(axis=0)
        self.n = n

    @property
    def mean(self) -> FloatArray:
        """Mean of the rows, shape (n_columns,)."""
        mean: FloatArray = self._first + self._sum / self.n
        return mean

    @property
    def scatter(self) -> FloatArray:
        """The sum Σ (row - mean)(row - mean)ᵀ, shape (n_columns, n_columns)."""
        scatter: FloatArray = self._products - np.outer(self._sum, self._sum / self.n)
        return scatter
