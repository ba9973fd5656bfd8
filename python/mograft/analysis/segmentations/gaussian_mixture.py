"""Mixtures of Gaussian distributions, fitted by expectation maximization.

Sums over points use `numpy.einsum`, whose order of additions does not depend on BLAS threads.
"""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray

_MAX_STEPS = 60
_MIN_GAIN = 1e-4  # of the mean log-likelihood, below which the fit ends
_MIN_VARIANCE_SHARE = 1e-3
"""Least variance of a component along any axis, as a share of the mean variance of all points. It
prevents components of a few nearly equal points, whose likelihood has no bound."""


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """Weights, means and covariances of k components in m dimensions."""

    weights: FloatArray  # (k,), their sum is 1
    means: FloatArray  # (k, m)
    covariances: FloatArray  # (k, m, m)

    def log_densities(self, points: FloatArray) -> FloatArray:
        """Return ln(weight · density) of every component at every point, shape (n, k)."""
        columns = []
        for weight, mean, covariance in zip(
            self.weights, self.means, self.covariances, strict=True
        ):
            factor = np.linalg.cholesky(covariance)
            whitened = np.einsum("ij,kj->ik", points - mean, np.linalg.inv(factor))
            constant = np.log(2 * np.pi * np.diag(factor) ** 2).sum()
            squares = np.einsum("ij,ij->i", whitened, whitened)
            columns.append(np.log(weight) - 0.5 * (constant + squares))
        return np.stack(columns, axis=1)

    def posteriors(self, points: FloatArray) -> tuple[FloatArray, float]:
        """Return the probability of each component at each point, (n, k), and the fit.

        The fit is the mean log-likelihood of the points.
        """
        logs = self.log_densities(points)
        largest = logs.max(axis=1, keepdims=True)
        shares = np.exp(logs - largest)
        sums = shares.sum(axis=1, keepdims=True)
        return shares / sums, float((largest + np.log(sums)).mean())

    def error(self, points: FloatArray) -> float:
        """Return the clustering error: Σ_i Σ_j p(j | x_i) |x_i - mean_j|²."""
        shares, _ = self.posteriors(points)
        squares = ((points[:, None] - self.means) ** 2).sum(axis=2)
        return float((shares * squares).sum())


def fit_mixture(points: FloatArray, n_components: int) -> GaussianMixture:
    """Fit a mixture to points in the order of time, shape (n, m), that are not all equal.

    The fit starts from components that are `n_components` consecutive parts of equal length, so
    that poses of one behaviour tend to belong to one component; it is deterministic.
    """
    labels = np.arange(len(points)) * n_components // len(points)
    floor = _MIN_VARIANCE_SHARE * float(points.var(axis=0).mean())
    mixture = _maximize(points, np.eye(n_components)[labels], floor)
    fit = -np.inf
    for _ in range(_MAX_STEPS):
        shares, latest = mixture.posteriors(points)
        if latest < fit + _MIN_GAIN:
            break
        fit = latest
        mixture = _maximize(points, shares, floor)
    return mixture


def _maximize(points: FloatArray, shares: FloatArray, floor: float) -> GaussianMixture:
    """Return the mixture of largest likelihood, given each component's share of each point."""
    totals = np.maximum(shares.sum(axis=0), 1e-9)
    means = np.einsum("ij,ik->jk", shares, points) / totals[:, None]
    covariances = np.stack(
        [
            np.einsum("ij,ik->jk", share[:, None] * (points - mean), points - mean) / total
            for share, mean, total in zip(shares.T, means, totals, strict=True)
        ]
    )
    covariances += floor * np.eye(points.shape[1])
    return GaussianMixture(totals / totals.sum(), means, covariances)
