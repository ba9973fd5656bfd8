"""Patched nearest neighbour: the cheapest explanation of a motion by long pieces of others.

A motion is cut into pieces of at least a given length, and each piece is compared with a piece of
an example, frame by frame. The dynamic program finds the cut and the pieces of the smallest total
distance (the global diversity of GANimator: Li et al., ACM Transactions on Graphics 41, 2022).
"""

import numpy as np


def nearest_patches(track, examples, min_length):
    """Return the mean distance per frame of a motion from the nearest sequence of example pieces.

    Parameters
    ----------
    track : ndarray, shape (n_frames, n_features)
        The motion.
    examples : sequence of ndarray, shape (n_frames, n_features)
        Examples; a piece does not cross from one to the next. Those shorter than `min_length`
        have no effect.
    min_length : int
        Minimum number of frames of a piece.

    Returns
    -------
    float
        Euclidean distance, averaged over frames; 0 for a copy. NaN if the motion, or every
        example, is shorter than `min_length`.
    """
    examples = [example for example in examples if len(example) >= min_length]
    n = len(track)
    if not examples or n < min_length:
        return float("nan")
    distances = _distances(track, np.concatenate(examples))
    is_first = np.zeros(distances.shape[1], bool)
    is_first[np.cumsum([0, *(len(example) for example in examples[:-1])])] = True
    sums = _diagonal_sums(distances, min_length, is_first)
    best = np.full(n + 1, np.inf)  # total of the first frames, cut into whole pieces
    best[0] = 0.0
    totals = np.full(distances.shape[1], np.inf)  # of those that end at each example frame
    for frame in range(min_length - 1, n):
        longer = np.full_like(totals, np.inf)
        longer[1:] = totals[:-1]
        longer[is_first] = np.inf
        new = best[frame + 1 - min_length] + sums[frame]
        totals = np.minimum(longer + distances[frame], new)
        best[frame + 1] = totals.min()
    return float(best[n] / n)


def _distances(track, examples):
    squared = (track**2).sum(axis=1)[:, None] + (examples**2).sum(axis=1) - 2 * track @ examples.T
    return np.sqrt(np.maximum(squared, 0.0))


def _diagonal_sums(distances, length, is_first):
    """Return the sums of the `length` distances that end at each entry, along diagonals.

    A sum is infinite if it would cross the start of an example.
    """
    sums = distances.copy()
    reach = np.arange(distances.shape[1]) - np.maximum.accumulate(
        np.where(is_first, np.arange(distances.shape[1]), 0)
    )
    for back in range(1, length):
        sums[back:, back:] += distances[:-back, :-back]
    sums[: length - 1] = np.inf
    sums[:, reach < length - 1] = np.inf
    return sums
