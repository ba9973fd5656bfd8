"""Checks of the fields of frozen values, each by its name."""

from mograft._arrays import as_floats


def vector(owner: object, name: str) -> None:
    numbers = as_floats(name, getattr(owner, name), (3,))
    object.__setattr__(owner, name, tuple(numbers.tolist()))


def above_zero(owner: object, name: str) -> None:
    if not getattr(owner, name) > 0:
        raise ValueError(f"{name} must be above 0, got {getattr(owner, name)}")


def not_negative(owner: object, name: str) -> None:
    if not getattr(owner, name) >= 0:
        raise ValueError(f"{name} must not be negative, got {getattr(owner, name)}")
