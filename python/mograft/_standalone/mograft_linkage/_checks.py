"""Checks of arguments: points, distances, counts and amounts."""

import operator
import os
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]


def as_floats(name: str, value: npt.ArrayLike) -> FloatArray:
    """Return `value` as a finite, C-contiguous float64 array; copy it only if necessary.

    Raises TypeError if the elements are not real numbers, ValueError if one is not finite. Error
    messages call the argument `name`.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(f"`{name}` must be an array, got rows of different lengths") from None
    if array.size and array.dtype.kind not in "fiu":
        raise TypeError(f"`{name}` must be real numbers, got {array.dtype}")
    floats = np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)
    finite = np.isfinite(floats)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(f"`{name}` must be finite, got {floats[index]} at {list(index)}")
    return floats


def as_points(points: npt.ArrayLike, min_points: int = 1) -> FloatArray:
    array = as_floats("points", points)
    if array.ndim == 1:
        raise ValueError(
            "`points` must have shape (n, n_axes), got one dimension; linkage_condensed takes the "
            "distances of scipy.spatial.distance.pdist"
        )
    if array.ndim != 2 or array.shape[0] < min_points or array.shape[1] < 1:
        raise ValueError(
            f"`points` must have shape (n >= {min_points}, n_axes >= 1), got {array.shape}"
        )
    return array


def as_threads(threads: int | None) -> int:
    return os.cpu_count() or 1 if threads is None else _as_count("threads", threads, 1)


def as_memory(limit: int | None, default: int) -> int:
    return default if limit is None else _as_count("memory_limit", limit, 0)


def _as_count(name: str, value: int, minimum: int) -> int:
    count = operator.index(value)
    if count < minimum:
        raise ValueError(f"`{name}` must be {minimum} or more, got {value}")
    return count


def check_amount(name: str, value: float) -> None:
    if not 0.0 <= value < np.inf:
        raise ValueError(f"`{name}` must be a finite number of at least 0, got {value}")
