"""Runs of consecutive marked positions."""

import numpy as np

from mograft._util.arrays import BoolArray, IntArray


def find_runs(mask: BoolArray) -> IntArray:
    """Return the half-open index ranges of consecutive true values, ascending, shape (n_runs, 2).

    Examples
    --------
    >>> find_runs(np.array([True, True, False, True])).tolist()
    [[0, 2], [3, 4]]
    """
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def extend_runs(mask: BoolArray, allowed: BoolArray) -> BoolArray:
    """Return a new mask in which each run extends over adjacent positions that are allowed.

    Examples
    --------
    >>> extend_runs(np.array([0, 1, 0, 0], bool), np.array([0, 0, 1, 0], bool)).tolist()
    [False, True, True, False]
    """
    extended = mask.copy()
    for start, stop in find_runs(allowed | mask).tolist():
        extended[start:stop] |= mask[start:stop].any()
    return extended


def dilate(mask: BoolArray, steps: int = 1) -> BoolArray:
    """Return a new mask that also marks `steps` neighbours on either side of marked positions.

    Examples
    --------
    >>> dilate(np.array([False, False, True, False])).tolist()
    [False, True, True, True]
    """
    steps = min(steps, len(mask))  # more would take memory only
    width = 2 * steps + 1
    counts = np.cumsum(np.pad(mask, (steps + 1, steps)))
    return counts[width:] > counts[:-width]
