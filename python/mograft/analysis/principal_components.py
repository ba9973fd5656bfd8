"""Principal components of the correlation matrix (paper, 4.2)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.linalg import eigenvectors

MIN_DEVIATION = 1e-6
"""Features with a smaller standard deviation are dropped. Samples are stored in single
precision, which rounds rotations by 6e-8."""

_MIN_VARIANCE_RATIO = 1e-6
"""Components with a smaller share of the largest variance are dropped. Their scores are below a
thousandth of the first component's, and the rounding of the samples decides their axes."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Mean and scatter matrix of the rows of a matrix.

    The bits of the mean and of the diagonal of the scatter matrix do not depend on the number of
    BLAS threads; the last bits of the other entries do.
    """

    n: int  # number of rows
    mean: FloatArray  # (n_features,)
    scatter: FloatArray  # Σ (row - mean)(row - mean)ᵀ, (n_features, n_features)

    @classmethod
    def of(cls, chunks: Iterable[FloatArray]) -> "Spread":
        """Compute mean and scatter matrix of a matrix, given as one or more chunks of its rows.

        The mean of each chunk is subtracted before products are computed, and the chunks are merged
        by the formula of Chan, Golub and LeVeque. This avoids the subtraction of nearly equal
        numbers, so the scatter of a constant feature is zero up to rounding.
        """
        n, mean, scatter = 0, np.zeros(0), np.zeros((0, 0))
        for rows in chunks:
            chunk_mean = rows.mean(axis=0)
            centred = rows - chunk_mean
            within = centred.T @ centred
            # numpy.einsum adds without BLAS, on whose threads the scales would depend otherwise.
            np.fill_diagonal(within, np.einsum("ij,ij->j", centred, centred))
            if not n:
                n, mean, scatter = len(rows), chunk_mean, within
                continue
            shift, total = chunk_mean - mean, n + len(rows)
            scatter += within
            scatter += np.outer(shift, shift) * (n * len(rows) / total)
            mean = mean + shift * (len(rows) / total)
            n = total
        return cls(n, mean, scatter)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of each feature, with divisor n - 1; 0 for a single row."""
        return np.sqrt(np.diag(self.scatter) / max(self.n - 1, 1))


def pca(
    spread: Spread, n_components: int, floors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the principal components of the correlation matrix (eq. 7 to 11).

    Returns three arrays. The first has the scale of each feature: the larger one of its standard
    deviation and its entry in `floors`, or infinity if the standard deviation is below 1e-6. The
    second, shape (n_features, at most n_components), has the loadings of one component in each
    column; see `eigenvectors`. The third has the variances along all components, descending.
    """
    deviation = spread.deviation
    scale = np.where(deviation < MIN_DEVIATION, np.inf, np.maximum(deviation, floors))
    correlation = spread.scatter / (spread.n - 1) / scale / scale[:, None]
    variances, components = eigenvectors(correlation, min(n_components, spread.n - 1))
    variances = np.maximum(variances, 0.0)
    rank = int((variances > _MIN_VARIANCE_RATIO * variances[0]).sum())
    return scale, components[:, :rank], variances
