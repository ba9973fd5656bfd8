"""The fields of `Config` as text: their values, and what they accept."""

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, get_args

from mograft._util.registry import CONFIG_OPTIONS
from mograft.config import Config
from mograft.errors import suggest_name

_TYPES = {field.name: field.type for field in fields(Config)}
_BOOLEANS = {"true": True, "false": False}
_PARAMETERS = "segmentation_parameters"


def parse_fields(assignments: Iterable[tuple[str, str]]) -> dict[str, Any]:
    """Return values of fields of `Config` from pairs of a name and a text.

    Names such as ``segmentation_parameters.min_depth`` set one entry of a mapping. A text that
    does not have the type of the field is returned unchanged: `Config` refuses it.

    Raises ValueError if a name is not a field.

    Examples
    --------
    >>> parse_fields([("seam", "offset"), ("max_stretch", "0.2"), ("self_repair", "false")])
    {'seam': 'offset', 'max_stretch': 0.2, 'self_repair': False}
    """
    values: dict[str, Any] = {}
    for name, text in assignments:
        field, _, key = name.partition(".")
        if field not in _TYPES or bool(key) != (field == _PARAMETERS):
            hint = suggest_name(name, _TYPES) or f", one of {', '.join(_TYPES)}"
            raise ValueError(f"{name!r} is no field of Config{hint}")
        if key:
            values.setdefault(field, {})[key] = _parse_plain(text)
        else:
            values[field] = _parse(_TYPES[field], text)
    return values


def _parse(kind: Any, text: str) -> Any:  # noqa: ANN401 - any type of a field
    if kind is bool:
        return _BOOLEANS.get(text.lower(), text)
    kinds = (kind, *get_args(kind))
    for own in (int, float):
        if own in kinds:
            try:
                return own(text)
            except ValueError:
                continue
    return text


def _parse_plain(text: str) -> float | bool | str:
    """Return the boolean or number that a text denotes; return any other text unchanged."""
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def field_choices() -> list[str]:
    """Return the beginnings of all assignments to fields, for shell completion."""
    choices = []
    for name, kind in _TYPES.items():
        values = CONFIG_OPTIONS[name].names if name in CONFIG_OPTIONS else ()
        values = values or (tuple(_BOOLEANS) if kind is bool else ("",))
        choices += [f"{name}={value}" for value in values]
    return choices
