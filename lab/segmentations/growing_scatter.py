"""Mean and scatter matrix of the first rows of a matrix, for a growing number of rows."""

import numpy as np


class GrowingScatter:
    """Mean and scatter matrix of the first `n` rows of a matrix; `n` grows from 0.

    Every row is used once, so all scatter matrices together cost one product of the whole matrix.
    """

    def __init__(self, rows):
        self.n = 0
        self._rows = rows - rows[:1]  # small numbers, whose squares cancel less
        self._first = rows[:1].sum(axis=0)
        self._products = np.zeros((rows.shape[1],) * 2)
        self._sum = np.zeros(rows.shape[1])

    def grow_through(self, counts):
        """Return means and scatter matrices of the first n rows, for each n of `counts`.

        `counts` are ascending, above 0, and not below those of the last call. The shapes are
        (n_counts, n_columns) and (n_counts, n_columns, n_columns). A scatter matrix is the sum
        Σ (row - mean)(row - mean)ᵀ.
        """
        products = np.empty((len(counts), *self._products.shape))
        sums = np.empty((len(counts), len(self._sum)))
        for index, count in enumerate(counts.tolist()):
            rows = self._rows[self.n : count]
            self._products += rows.T @ rows
            self._sum += rows.sum(axis=0)
            self.n = count
            products[index], sums[index] = self._products, self._sum
        means = sums / counts[:, None]
        products -= sums[:, :, None] * means[:, None, :]
        return self._first + means, products
