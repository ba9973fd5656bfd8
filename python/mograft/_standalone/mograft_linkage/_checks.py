"""Checks of arguments: points, distances, trees, counts and amounts."""

import operator
from typing import Any, NoReturn, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float32] | npt.NDArray[np.float64]
FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]


def as_points(points: npt.ArrayLike, min_points: int) -> Floats:
    """Return points as a float32 or float64 array, in C or Fortran order; copy only if necessary.

    Raises TypeError if the elements are not real numbers, ValueError if the shape is not that of
    at least `min_points` points. The kernels check that the coordinates are finite.
    """
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


def as_floats(name: str, value: npt.ArrayLike) -> Floats:
    """Return real numbers as a contiguous float32 or float64 array; copy only if necessary."""
    if hasattr(value, "toarray"):
        raise TypeError(f"`{name}` must be dense, got a sparse matrix; `.toarray()` converts it")
    array = as_array(name, value)
    if array.size and array.dtype.kind not in "fiub":
        raise TypeError(f"`{name}` must be real numbers, got {array.dtype}")
    is_single = array.dtype in (np.float16, np.float32)
    floats: Floats = np.asarray(array, np.float32) if is_single else np.asarray(array, np.float64)
    is_contiguous = floats.flags.c_contiguous or floats.flags.f_contiguous
    return floats if is_contiguous else floats.copy(order="C")


def as_array(name: str, value: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return `value` as an array; raise ValueError if its rows have different lengths."""
    try:
        return np.asarray(value)
    except ValueError:
        raise ValueError(f"`{name}` must be an array, got rows of different lengths") from None


def as_count(name: str, value: object, minimum: int) -> int:
    """Return `value` as an int.

    Raises TypeError if it is not a whole number, ValueError if it is less than `minimum`.
    """
    try:
        count = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"`{name}` must be a whole number, got {value!r}") from None
    if count < minimum:
        raise ValueError(f"`{name}` must be {minimum} or more, got {value}")
    return count


def as_height(name: str, value: float) -> float:
    """Return `value` as a height, which may be infinite.

    Raises TypeError if it is not a number, ValueError if it is negative or NaN.
    """
    height = _as_number(name, value)
    if not height >= 0.0:
        raise ValueError(f"`{name}` must be 0 or more, got {value}")
    return height


def check_amount(name: str, value: float) -> None:
    """Raise TypeError unless `value` is a number, ValueError if it is negative or not finite."""
    if not 0.0 <= _as_number(name, value) < np.inf:
        raise ValueError(f"`{name}` must be a finite number of at least 0, got {value}")


def _as_number(name: str, value: float) -> float:
    # `float` also converts text, and the message of its errors does not name the argument.
    if np.ndim(value) == 0 and np.asarray(value).dtype.kind in "fiub":
        return float(value)
    raise TypeError(f"`{name}` must be a number, got {value!r}")


def raise_not_finite(points: Floats) -> NoReturn:
    """Raise the ValueError that the kernels raise, for the first coordinate that is not finite."""
    row, axis = (int(i) for i in np.argwhere(~np.isfinite(points))[0])
    value = str(points[row, axis]).replace("nan", "NaN")  # as the kernels print it
    raise ValueError(f"`points` must be finite, got {value} at [{row}, {axis}]")
