"""The effect of donors on the balance of base segments."""

import numpy as np

from mograft.analysis import zero_moment


def zero_moment_shifts(base, donors, seconds):
    """Return d - (z/g) d̈ at the samples of n base segments, shape (n, n_samples, 2).

    d is the difference of two tracks, shape (n, n_samples, 2), smoothed by a Gaussian: a line and a
    sine polynomial.
    """
    gaps = donors - base
    times = np.linspace(0.0, 1.0, gaps.shape[1])[:, None]
    line = gaps[:, :1] * (1.0 - times) + gaps[:, -1:] * times
    modes = np.arange(1, len(times) - 1)
    sines = np.sin(np.pi * times * modes)
    squared_frequencies = np.square(np.pi * modes / seconds[:, None])
    gains = np.exp(-0.5 * zero_moment.SMOOTHING_SECONDS**2 * squared_frequencies)
    gains *= 1.0 + zero_moment.PENDULUM_TIME_SQUARED * squared_frequencies
    amplitudes = np.linalg.inv(sines[1:-1]) @ (gaps - line)[:, 1:-1]
    return line + sines @ (gains[:, :, None] * amplitudes)


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
