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
    """Return a table of all fields of `Config`, their defaults and meanings in Markdown.

    Fields with one description in the docstring of `Config` share a row.
    """
    return HEAD + "".join(
        f"| {', '.join(f'`{name}`' for name in names)} "
        f"| {', '.join(_shown(getattr(Config(), name)) for name in names)} | {meaning} |\n"
        for names, meaning in _meanings()
    )


def _shown(value):
    if isinstance(value, float):
        return "inf" if math.isinf(value) else f"{value:.4g}"
    return "" if value == {} else str(value).lower()


def _meanings():
    """Yield the names of fields and the first sentence of their description, in their order.

    The allowed words of a field follow in parentheses.
    """
    text = inspect.cleandoc(Config.__doc__).partition("Parameters\n")[2]
    documented = []
    for listed, body in re.findall(r"^(\w[\w, ]*) :.*\n((?:    .*\n)+)", text, re.MULTILINE):
        names = listed.split(", ")
        sentence = re.split(r"(?<=[.:;])(?<!eq\.) (?=[A-Z\"\d`])", " ".join(body.split()))[0]
        words = [word for name in names for word in CHOICES.get(name, ())]
        allowed = f" ({', '.join(words)})" if words else ""
        documented += names
        yield names, sentence.rstrip(".:").replace("|", "\\|") + allowed
    assert documented == [field.name for field in fields(Config)], documented


if __name__ == "__main__":
    before, table, after = re.split(
        rf"({re.escape(HEAD)}(?:\|.*\n)*)", PAGE.read_text(encoding="utf-8"), maxsplit=1
    )
    PAGE.write_text(before + field_table() + after, encoding="utf-8")
