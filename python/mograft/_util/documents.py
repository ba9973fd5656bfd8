"""Parse JSON and TOML, with limits of depth and of numbers."""

import json
from typing import Any, Literal

MAX_LEVELS = 100
"""Lists and tables in each other. Deeper ones exhaust the stack of Python, also in messages."""

MAX_TOML_CHARACTERS = 1 << 20
"""The parser of TOML takes seconds for longer texts."""

_MAX_INTEGER = 10**300  # larger ones are no floats


def parse_document(text: str | bytes, kind: Literal["JSON", "TOML"] = "JSON") -> Any:  # noqa: ANN401
    """Return the content of a text in JSON or TOML.

    Raises ValueError if it is not valid or exceeds a limit.
    """
    try:
        if kind == "JSON":
            document = json.loads(text)
        else:
            import tomllib

            if len(text) > MAX_TOML_CHARACTERS:
                raise ValueError(f"expected at most {MAX_TOML_CHARACTERS} characters")
            document = tomllib.loads(text if isinstance(text, str) else text.decode())
    except RecursionError:
        raise ValueError(f"expected at most {MAX_LEVELS} levels, got more") from None
    items, n_levels = [document], 0
    while items := [own for item in items for own in _inner_items(item)]:
        n_levels += 1
        if n_levels > MAX_LEVELS:
            raise ValueError(f"expected at most {MAX_LEVELS} levels, got more")
    return document


def _inner_items(item: object) -> list[object]:
    """Return the items of a list or table; raise ValueError for an integer beyond all floats."""
    if isinstance(item, int) and abs(item) > _MAX_INTEGER:
        raise ValueError("expected numbers of at most 300 digits, got an integer of more")
    if isinstance(item, dict):
        return list(item.values())
    return item if isinstance(item, list) else []
