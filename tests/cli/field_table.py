"""The table of the fields of `Config` in docs/settings.md; run this module to write it."""

import inspect
import math
import re
from dataclasses import fields
from pathlib import Path

from mograft.config import CHOICES, Config

HEAD = "| field | default | values or meaning |\n|---|---|---|\n"
PAGE = Path(__file__).parents[2] / "docs" / "settings.md"


def field_table():
    """Return a table of all fields of `Config`, their defaults and meanings in Markdown."""
    meanings = dict(_meanings())
    return HEAD + "".join(
        f"| `{field.name}` | {_shown(getattr(Config(), field.name))} | {meanings[field.name]} |\n"
        for field in fields(Config)
    )


def _shown(value):
    if isinstance(value, float):
        return "inf" if math.isinf(value) else f"{value:.4g}"
    return "" if value == {} else str(value).lower()


def _meanings():
    """Yield each field with the first sentence of its description in the docstring of `Config`.

    The allowed words of a field follow in parentheses.
    """
    text = inspect.cleandoc(Config.__doc__).partition("Parameters\n")[2]
    for names, body in re.findall(r"^(\w[\w, ]*) :.*\n((?:    .*\n)+)", text, re.MULTILINE):
        sentence = re.split(r"(?<=[.:;])(?<!eq\.) (?=[A-Z\"\d`])", " ".join(body.split()))[0]
        for name in names.split(", "):
            words = CHOICES.get(name, ())
            allowed = f" ({', '.join(words)})" if words else ""
            yield name, sentence.rstrip(".:").replace("|", "\\|") + allowed


if __name__ == "__main__":
    before, table, after = re.split(
        rf"({re.escape(HEAD)}(?:\|.*\n)*)", PAGE.read_text(encoding="utf-8"), maxsplit=1
    )
    PAGE.write_text(before + field_table() + after, encoding="utf-8")
