"""The effect of donors on the balance of base segments."""

import numpy as np

from mograft.analysis import zero_moment


def zero_moment_shifts(base, donors, seconds):
    """Return the shifts of the zero-moment point by donors, shape (n, n_samples, 2).

    The operators are those that tests of `zero_moment` compare with a quadrature.
    """
    return zero_moment.zero_moment_operators(base.shape[1], seconds) @ (donors - base)


def added_imbalances(shifts, margins, rows):
    """Return by how much shifts raise the imbalance of base segments, shape (n,).

    `rows` are the indices in `margins` of the base segments of the shifts.
    """
    angles = 2.0 * np.pi * np.arange(zero_moment.N_DIRECTIONS) / zero_moment.N_DIRECTIONS
    axes = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    known = _imbalances(-margins)
    return np.maximum(_imbalances(shifts @ axes.T - margins[rows]) - known[rows], 0.0)


def _imbalances(excesses):
    distances = excesses.max(axis=2)
    return (0.5 + 0.5 * np.tanh(distances / (2.0 * zero_moment.DISTANCE_SCALE))).mean(axis=1)
