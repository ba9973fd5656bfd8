"""The fields of `Config` as text: their values, and what they accept."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import fields
from typing import Any

from mograft.config import CHOICES, Config
from mograft.errors import suggest_name

_TYPES = {field.name: field.type for field in fields(Config)}
_BOOLEANS = {"true": True, "false": False}


def parse_fields(assignments: Iterable[tuple[str, str]]) -> dict[str, Any]:
    """Return values of fields of `Config` from pairs of a name and a text.

    A text that does not have the type of the field is returned unchanged: `Config` refuses it.

    Raises ValueError if a name is not a field.

    Examples
    --------
    >>> parse_fields([("seam", "offset"), ("max_stretch", "0.2"), ("self_repair", "false")])
    {'seam': 'offset', 'max_stretch': 0.2, 'self_repair': False}
    """
    values: dict[str, Any] = {}
    for name, text in assignments:
        if name not in _TYPES:
            hint = suggest_name(name, _TYPES) or f", one of {', '.join(_TYPES)}"
            if name == "variety":
                hint = "; `variety` sets `sigma_scale`: use `--variety` or `Config.with_variety`"
            raise ValueError(f"{name!r} is no field of Config{hint}")
        values[name] = _parse(_TYPES[name], text)
    return values


def _parse(kind: Any, text: str) -> Any:  # noqa: ANN401 - any type of a field
    if kind is bool:
        return _BOOLEANS.get(text.lower(), text)
    with suppress(ValueError):
        return kind(text) if kind in (int, float) else text
    return text


def field_choices() -> list[str]:
    """Return the beginnings of all assignments to fields, for shell completion."""
    choices = []
    for name, kind in _TYPES.items():
        values = CHOICES.get(name) or (tuple(_BOOLEANS) if kind is bool else ("",))
        choices += [f"{name}={value}" for value in values]
    return choices
