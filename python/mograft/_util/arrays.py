"""Conversion of array arguments: dtype, shape, finiteness and unit norm are checked here."""

import math
from collections.abc import Iterator
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
Packed: TypeAlias = npt.NDArray[np.float32]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
Item = TypeVar("Item", bound=np.generic)
Shape: TypeAlias = tuple[int | str, ...]

_ROWS_PER_BLOCK = 4096
_LARGEST = float(np.finfo(float).max)


def as_floats(
    name: str, value: npt.ArrayLike, shape: Shape | None = None, maximum: float = _LARGEST
) -> FloatArray:
    """Return `value` as a finite, C-contiguous float64 array; copy it only if necessary.

    `shape` has the expected length of each axis; a string stands for any length, and None accepts
    any shape. Raises TypeError if the elements are not real numbers, ValueError if the shape
    differs, an element is not finite or its amount exceeds `maximum`. Error messages call the
    argument `name`.
    """
    array = _as_real_array(name, value, shape)
    if not all((np.abs(block) <= maximum).all() for block in _blocks(array)):
        index = tuple(int(i) for i in np.argwhere(~(np.abs(array) <= maximum))[0])
        rule = f"at most {maximum:g}" if np.isfinite(array[index]) else "finite"
        raise ValueError(f"`{name}` must be {rule}, got {array[index]} at {list(index)}")
    return array


def as_quaternions(name: str, value: npt.ArrayLike, shape: Shape | None = None) -> FloatArray:
    """Return `value` as unit quaternions, scalar last, shape (*shape, 4).

    The errors are those of `as_floats`, and ValueError if a norm differs from 1 by more than 1e-6.
    """
    quats = _as_real_array(name, value, None if shape is None else (*shape, 4))
    if quats.shape[-1:] != (4,):
        as_floats(name, quats)
        raise ValueError(f"`{name}` must have shape (..., 4), got {quats.shape}")
    if not all(_is_unit(block).all() for block in _blocks(quats)):
        as_floats(name, quats)
        index = tuple(int(i) for i in np.argwhere(~_is_unit(quats))[0])
        norm = math.hypot(*quats[index].tolist())  # without a warning of an overflow
        raise ValueError(f"`{name}` must be unit quaternions, got norm {norm:.6g} at {list(index)}")
    return quats


def _is_unit(quats: FloatArray) -> BoolArray:
    # A norm within 1e-6 of 1 has a square within 2e-6 of 1. Non-finite values fail the test.
    return np.abs(np.einsum("...i,...i->...", quats, quats) - 1.0) <= 2e-6


def _blocks(array: FloatArray) -> Iterator[FloatArray]:
    """Yield views of consecutive rows, so that temporary arrays of a long motion stay small."""
    if array.ndim < 2:
        yield array
        return
    for start in range(0, len(array), _ROWS_PER_BLOCK):
        yield array[start : start + _ROWS_PER_BLOCK]


def as_vectors(name: str, value: npt.ArrayLike, shape: Shape | None = None) -> FloatArray:
    """Return `value` as finite vectors, shape (*shape, 3); the errors are those of `as_floats`."""
    vectors = as_floats(name, value, None if shape is None else (*shape, 3))
    if vectors.shape[-1:] != (3,):
        raise ValueError(f"`{name}` must have shape (..., 3), got {vectors.shape}")
    return vectors


def as_indices(name: str, value: npt.ArrayLike, shape: Shape | None = None) -> IntArray:
    """Return `value` as a C-contiguous int64 array; `shape` as for `as_floats`.

    Raises TypeError if the elements are not whole numbers, ValueError if the shape differs.
    """
    array = np.asarray(_as_array(name, value), order="C")
    if array.size and array.dtype.kind not in "iu":
        raise TypeError(f"`{name}` must be whole numbers, got {array.dtype}")
    indices = array.astype(np.int64, copy=False)
    _check_shape(name, indices.shape, shape)
    return indices


def split_by_counts(items: npt.NDArray[Item], counts: IntArray) -> list[npt.NDArray[Item]]:
    """Split an array into consecutive views; view i has `counts[i]` items.

    Examples
    --------
    >>> [view.tolist() for view in split_by_counts(np.arange(5), np.array([2, 0, 3]))]
    [[0, 1], [], [2, 3, 4]]
    """
    stops = np.cumsum(counts)
    return [items[own] for own in map(slice, (stops - counts).tolist(), stops.tolist())]


def set_fields(owner: object, state: dict[str, Any]) -> None:
    """Set the fields in `state` on the frozen dataclass `owner`, and make arrays read-only."""
    for value in state.values():
        if isinstance(value, np.ndarray):
            make_read_only(value)
    owner.__dict__.update(state)


class ReadOnlyArrays:
    """Base of frozen dataclasses whose arrays are read-only, also after they are unpickled."""

    def __post_init__(self) -> None:
        set_fields(self, vars(self).copy())

    def __setstate__(self, state: dict[str, Any]) -> None:
        set_fields(self, state)


def make_read_only(array: npt.NDArray[np.generic]) -> None:
    """Make an array read-only."""
    array.flags.writeable = False


def _as_array(name: str, value: npt.ArrayLike) -> npt.NDArray[Any]:
    try:
        return np.asarray(value)
    except ValueError:
        raise ValueError(f"`{name}` must be an array, got rows of different lengths") from None


def _as_real_array(name: str, value: npt.ArrayLike, shape: Shape | None) -> FloatArray:
    array = _as_array(name, value)
    if array.size and array.dtype.kind not in "fiu":
        raise TypeError(f"`{name}` must be real numbers, got {array.dtype}")
    floats = np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)
    _check_shape(name, floats.shape, shape)
    return floats


def fits_shape(got: tuple[int, ...], shape: Shape) -> bool:
    """Return whether lengths of axes are those of `shape`, as for `as_floats`."""
    return len(got) == len(shape) and all(
        isinstance(want, str) or want == length for want, length in zip(shape, got, strict=True)
    )


def _check_shape(name: str, got: tuple[int, ...], shape: Shape | None) -> None:
    if shape is not None and not fits_shape(got, shape):
        wanted = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise ValueError(f"`{name}` must have shape ({wanted}), got {got}")
