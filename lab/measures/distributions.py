"""Distances between two sets of points: Fréchet distance, density and coverage."""

import numpy as np

N_NEIGHBOURS = 5  # of the balls of density and coverage, as in Naeem et al.


def frechet_distance(first, second, first_weights=None, second_weights=None):
    """Return the squared Fréchet distance of the normal distributions fitted to two sets.

    `first` and `second` have shape (n, n_features), the weights shape (n,). It is 0 for equal sets.
    The formula is that of the Fréchet inception distance (Heusel et al., NeurIPS 2017); the points
    are not those of its network, so that its published values are not comparable.
    """
    (mean, covariance), (mean_2, covariance_2) = (
        _moments(points, weights)
        for points, weights in ((first, first_weights), (second, second_weights))
    )
    root = _square_root(covariance)
    mixed = np.linalg.eigvalsh(root @ covariance_2 @ root)
    trace = np.trace(covariance) + np.trace(covariance_2)
    distance = ((mean - mean_2) ** 2).sum() + trace - 2 * np.sqrt(np.maximum(mixed, 0)).sum()
    return float(max(distance, 0.0))


def _moments(points, weights):
    weights = np.full(len(points), 1.0) if weights is None else np.asarray(weights, float)
    share = weights / weights.sum()
    mean = share @ points
    centred = points - mean
    return mean, (centred * share[:, None]).T @ centred


def _square_root(matrix):
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T


def pairwise(first, second):
    """Return the Euclidean distances between the rows of two arrays."""
    squared = (first**2).sum(axis=1)[:, None] + (second**2).sum(axis=1) - 2 * first @ second.T
    return np.sqrt(np.maximum(squared, 0.0))


def balls(real, fake):
    """Return which points `fake` lie in the balls of the points `real`, (n_real, n_fake).

    The ball of a real point reaches to its fifth-nearest real neighbour.
    """
    among = np.sort(pairwise(real, real), axis=1)
    radii = among[:, min(N_NEIGHBOURS, len(real) - 1)]
    return pairwise(real, fake) <= radii[:, None]


def density_and_coverage(real, fake):
    """Return density and coverage of the points `fake` for the points `real`.

    Density is the number of balls that contain a fake point, averaged over fake points and divided
    by the number of neighbours; coverage is the share of the balls that contain a fake point. For
    equal sets coverage is 1.
    Source: Naeem et al., Reliable fidelity and diversity metrics for generative models, ICML 2020.
    """
    is_inside = balls(real, fake)
    return float(is_inside.sum(axis=0).mean() / N_NEIGHBOURS), float(is_inside.any(axis=1).mean())
