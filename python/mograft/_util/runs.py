"""Runs of consecutive marked positions."""

import numpy as np

from mograft._util.arrays import BoolArray, IntArray

__all__ = ["dilate", "find_runs"]


def find_runs(mask: BoolArray) -> IntArray:
    """Return the half-open ranges of consecutive true values.

    Parameters
    ----------
    mask : ndarray of bool, shape (n,)
        The marked positions.

    Returns
    -------
    ndarray of int, shape (n_runs, 2)
        First index of each run and the index after its last, ascending.

    Examples
    --------
    >>> find_runs(np.array([True, True, False, True])).tolist()
    [[0, 2], [3, 4]]
    """
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def dilate(mask: BoolArray, steps: int = 1) -> BoolArray:
    """Return a mask that also marks the neighbours of marked positions.

    Parameters
    ----------
    mask : ndarray of bool, shape (n,)
        The marked positions.
    steps : int
        Number of neighbours on either side.

    Returns
    -------
    ndarray of bool, shape (n,)
        A new array.

    Examples
    --------
    >>> dilate(np.array([False, False, True, False])).tolist()
    [False, True, True, True]
    """
    wide = mask.copy()
    for _ in range(steps):
        before = wide.copy()
        wide[1:] |= before[:-1]
        wide[:-1] |= before[1:]
    return wide
