"""Checks of single arguments and dataclass fields; messages name the argument."""

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeGuard

import numpy as np

from mograft._util.arrays import as_floats
from mograft._util.containers import FrozenMapping
from mograft.errors import suggest_name


def is_integer(value: object) -> TypeGuard[int]:
    """Return whether a value is an integer of Python or NumPy; bool does not count."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def as_integer(name: str, value: object, minimum: int = 0) -> int:
    """Return `value` as an int; raise ValueError unless it is an integer of at least `minimum`."""
    if not is_integer(value) or value < minimum:
        raise ValueError(f"`{name}` must be a whole number of at least {minimum}, got {value!r}")
    return int(value)


def check_type(name: str, value: object, kind: type) -> None:
    """Raise TypeError unless `value` is an instance of `kind`."""
    if not isinstance(value, kind):
        raise TypeError(f"`{name}` must be a {kind.__name__}, got {type(value).__name__}")


def check_choice(name: str, value: object, accepted: Collection[str]) -> None:
    """Raise ValueError unless `value` is one of the `accepted` words; suggest the nearest one."""
    if not isinstance(value, str) or value not in accepted:
        listed, hint = ", ".join(map(repr, accepted)), suggest_name(value, accepted)
        raise ValueError(f"`{name}` must be one of {listed}, got {value!r}{hint}")


def coerce_vector(owner: object, name: str) -> None:
    """Convert the field `name` of the frozen dataclass `owner` to a tuple of three floats."""
    numbers = as_floats(name, getattr(owner, name), (3,))
    object.__setattr__(owner, name, tuple(numbers.tolist()))


def check_positive(owner: object, name: str) -> None:
    """Raise ValueError unless the field `name` is above 0, TypeError if it is not a number."""
    _require(owner, name, "be above 0", lambda value: value > 0)


def check_not_negative(owner: object, name: str) -> None:
    """Raise ValueError unless the field `name` is at least 0, TypeError if it is not a number."""
    _require(owner, name, "not be negative", lambda value: value >= 0)


def check_finite(owner: object, name: str) -> None:
    """Raise ValueError unless the field `name` is finite, TypeError if it is not a number."""
    _require(owner, name, "be finite", math.isfinite)


def python_scalar(owner: object, name: str) -> Any:  # noqa: ANN401 - whatever the field holds
    """Return the field `name` of `owner`; replace a NumPy scalar in it by a Python scalar."""
    value = getattr(owner, name)
    if isinstance(value, np.generic):
        value = value.item()
        object.__setattr__(owner, name, value)
    return value


def _require(owner: object, name: str, rule: str, is_valid: Callable[[float], bool]) -> None:
    value = python_scalar(owner, name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"`{name}` must be a number, got {value!r}")
    if not is_valid(value):
        raise ValueError(f"`{name}` must {rule}, got {value}")


def freeze_cut_frames(clips: Mapping[Any, Any]) -> FrozenMapping[str, tuple[int, ...]]:
    """Return an immutable copy of a mapping from clip name to cut frames.

    Raises ValueError unless every key is a string and its value holds ascending whole numbers of at
    least 0.
    """
    for name in clips:
        if not isinstance(name, str):
            raise ValueError(f"`segmentation` must map names of clips to frames, got {name!r}")
    about = "of `segmentation` for the clip"
    return FrozenMapping({key: as_cut_frames(clips[key], f"{about} {key!r}") for key in clips})


def as_cut_frames(frames: object, source: str) -> tuple[int, ...]:
    """Return cut frames as a tuple; `source` follows "cut frames" in the message of an error.

    Raises ValueError unless they are ascending whole numbers of at least 0.
    """
    try:
        array = np.asarray(frames)
    except ValueError:
        array = np.asarray(frames, object)
    is_whole = array.ndim == 1 and (array.dtype.kind in "iu" or not array.size)
    if not is_whole or (array < 0).any() or (np.diff(array.astype(np.int64)) <= 0).any():
        expected = "ascending whole numbers of at least 0"
        raise ValueError(f"cut frames {source} must be {expected}, got {frames!r}")
    return tuple(int(frame) for frame in array)
