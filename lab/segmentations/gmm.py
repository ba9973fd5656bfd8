"""Cuts between clusters of poses (Barbič et al. 2004, Gaussian mixture model)."""

import warnings
from dataclasses import dataclass

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from lab.segmentations.poses import frames_of, pose_features, principal_scores

_MIN_VARIANCE_SHARE = 1e-3
"""Least variance of a component along any axis, as a share of the mean variance of all points."""


@dataclass(frozen=True)
class GmmParameters:
    """Parameters of the segmentation "gmm".

    Parameters
    ----------
    energy : float
        Share of the variance, between 0 and 1, that the principal axes preserve. The poses are
        clustered in these axes.
    max_clusters : int
        Greatest number of clusters.
    ratio : float
        The number of clusters k is the smallest one at which another cluster reduces the
        clustering error by less than this share of the reduction from one to two clusters.
    cycle : float
        Seconds over which the probabilities of the clusters are averaged, and duration of the
        shortest behaviour: about one cycle of a gait. It prevents cuts within a cycle whose poses
        belong to two clusters.
    step : float
        Seconds between the poses to which the clusters are fitted.
    """

    energy: float = 0.95
    max_clusters: int = 12
    ratio: float = 0.05
    cycle: float = 1.0
    step: float = 0.1


def cut_frames(motion, parameters):
    """Return the frames at which the most probable cluster of poses changes.

    Parameters
    ----------
    motion : Motion
        The motion.
    parameters : GmmParameters
        Number of clusters and durations.

    Returns
    -------
    ndarray of int, shape (n_cuts,)
        The inner cut frames, ascending. There are none if the motion is shorter than two cycles,
        constant, or without joints below the root.

    Notes
    -----
    Barbič et al. 2004, "Segmenting Motion Capture Data into Distinct Behaviors", GMM approach. A
    pose is the vector of the quaternions of all joints below the root, projected onto the principal
    axes of the whole motion that hold `energy` of its variance. Expectation maximization fits k
    Gaussian distributions, starting from k consecutive parts of the motion. With the clustering
    error E_k = Σ_i Σ_j p(j | x_i) |x_i - m_j|², k is the smallest number with
    (E_k - E_{k+1}) / (E_1 - E_2) < `ratio`. A cut is placed where the cluster with the highest
    probability, averaged over one `cycle`, changes; clusters that last less than a `cycle` are
    merged with a neighbour. The average, the merging and the start are not in the source. The cost
    is O(n k D²) for each of at most 60 steps of a fit to n poses.
    """
    cycle = frames_of(parameters.cycle, motion.rate)
    scores = principal_scores(pose_features(motion), parameters.energy)
    if motion.n_frames <= 2 * cycle or not scores.shape[1]:
        return np.zeros(0, np.int64)
    mixture = _fit(scores[:: frames_of(parameters.step, motion.rate)], parameters)
    probabilities = mixture.predict_proba(scores)
    labels = _centred_means(probabilities, cycle).argmax(axis=1)
    return np.flatnonzero(np.diff(merge_short_runs(labels, cycle))) + 1


def _fit(points, parameters):
    """Return the mixture with the number of clusters that `ratio` selects."""
    mixture = _fit_mixture(points, 1)
    errors = [_error(mixture, points)]
    for n_clusters in range(2, min(parameters.max_clusters, len(points)) + 1):
        further = _fit_mixture(points, n_clusters)
        errors.append(_error(further, points))
        if errors[-2] - errors[-1] < parameters.ratio * (errors[0] - errors[1]):
            break
        mixture = further
    return mixture


def _fit_mixture(points, n_components):
    """Fit a mixture, starting from components that are consecutive parts of equal length."""
    labels = np.arange(len(points)) * n_components // len(points)
    floor = _MIN_VARIANCE_SHARE * float(points.var(axis=0).mean())
    parts = [points[labels == k] for k in range(n_components)]
    spreads = [np.atleast_2d(np.cov(part, rowvar=False, bias=True)) for part in parts]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return GaussianMixture(
            n_components,
            weights_init=[len(part) / len(points) for part in parts],
            means_init=[part.mean(axis=0) for part in parts],
            precisions_init=[np.linalg.inv(own + floor * np.eye(len(own))) for own in spreads],
            reg_covar=floor,
            tol=1e-4,
            max_iter=60,
        ).fit(points)


def _error(mixture, points):
    """Return the clustering error: Σ_i Σ_j p(j | x_i) |x_i - mean_j|²."""
    squares = ((points[:, None] - mixture.means_) ** 2).sum(axis=2)
    return float((mixture.predict_proba(points) * squares).sum())


def _centred_means(values, width):
    """Return the mean of the `width` rows around each row; at the ends there are fewer rows."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    first = np.maximum(rows - width // 2, 0)
    stop = np.minimum(rows - width // 2 + width, len(values))
    return (sums[stop] - sums[first]) / (stop - first)[:, None]


def merge_short_runs(labels, min_length):
    """Return labels without runs of equal labels that are shorter than `min_length`.

    The shortest run is merged first: it takes the label of the longer neighbour. Of equal runs or
    neighbours, the first is selected. If only one run is left, it may be shorter.
    """
    values = labels.copy()
    while True:
        bounds = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
        lengths = np.diff(bounds)
        run = int(np.argmin(lengths))
        if len(lengths) == 1 or lengths[run] >= min_length:
            return values
        beside = [k for k in (run - 1, run + 1) if 0 <= k < len(lengths)]
        longer = max(beside, key=lambda k: lengths[k])
        values[bounds[run] : bounds[run + 1]] = values[bounds[longer]]
