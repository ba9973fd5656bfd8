"""Parse JSON and TOML, with limits of depth and of numbers."""

import json
import re
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, TypeVar

T = TypeVar("T")

MAX_LEVELS = 100
"""Lists and tables in each other. Deeper ones exhaust the stack of Python, also in messages."""

MAX_TOML_CHARACTERS = 1 << 20
_DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{MAX_LEVELS}}}""")
"""A key such as ``a.b.c`` of more levels: Python parses it in quadratic time."""

_MAX_INTEGER = 10**300  # larger ones are no floats


def parse_document(text: str | bytes, kind: Literal["JSON", "TOML"] = "JSON") -> Any:  # noqa: ANN401
    """Return the content of a text in JSON, or of a str in TOML.

    Raises ValueError if it is not valid or exceeds a limit.
    """
    if kind == "TOML" and len(text) > MAX_TOML_CHARACTERS:
        raise ValueError(f"expected at most {MAX_TOML_CHARACTERS} characters, got {len(text)}")
    with suppress(RecursionError):
        if kind == "TOML" and _DEEP_KEY.search(str(text)):
            raise RecursionError
        document = (json if kind == "JSON" else import_module("tomllib")).loads(text)
        items = [document]
        for _ in range(MAX_LEVELS + 1):
            if any(isinstance(own, int) and abs(own) > _MAX_INTEGER for own in items):
                raise ValueError("expected numbers of at most 300 digits, got an integer of more")
            lists = [list(own.values()) if isinstance(own, dict) else own for own in items]
            items = [own for inner in lists if isinstance(inner, list) for own in inner]
            if not items:
                return document
    raise ValueError(f"expected at most {MAX_LEVELS} levels, got more")


def read_document(path: Path, kind: Literal["JSON", "TOML"] = "JSON") -> Any:  # noqa: ANN401
    """Parse a JSON or TOML file as `parse_document` does; errors name the file."""
    try:
        return parse_document(path.read_text(encoding="utf-8"), kind)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def optional(convert: Callable[[Any], T], value: Any) -> T | None:  # noqa: ANN401 - of JSON
    """Return a converted value of a document; None for null."""
    return None if value is None else convert(value)
