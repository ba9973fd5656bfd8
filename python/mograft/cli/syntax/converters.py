"""How texts of options become values, and what is said of texts that do not."""

import math
import re
from argparse import ArgumentTypeError
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

from mograft.errors import suggest_name

T = TypeVar("T")

_TIME = r"(\d*\.?\d+s?)"
_CORRECTIONS = (
    (rf"{_TIME}-{_TIME}(?=[^-.\d][^-]*$|$)", r"\2-\1"),  # the last range, in another order
    (r" ?(\.\.+|\u2013|\bto\b) ?", "-"),
    (r"(?<=\d) ?(s[ec]+\.?|seconds?)(?=\W|$)", "s"),
    (r"[; ]", ","),
    (rf"^([^@:=]+)[@:=]{_TIME}(?=[:=])", r"\2:\1"),  # parts in another order
    (rf"^({_TIME}-{_TIME}|\d+)[@:=]([^=]+)", r"\4@\1"),
    (r"^(.+)=(\d+)$", r"\2=\1"),
    (r":@(\w+):", r":@\1+"),
)
"""Patterns of typical mistakes, and what is meant."""

_MARK = re.compile(r"[:@=+~() ]+(?!$)|[=)]$|(?<=[A-Za-z])(?=-?\d)|(?<=\d)(?=[A-Z])")
"""Where a part of a value ends; the mark may be missing or a wrong one."""

_MAX_LENGTH = 100  # characters of a value that is corrected


def _correct(text: str) -> Iterator[str]:
    """Yield a text with each typical mistake corrected."""
    yield from (re.sub(*own, text) for own in _CORRECTIONS)
    for found in reversed([*_MARK.finditer(text)]):
        for mark in (":", "@", "=", "+", ":@", ""):
            yield text[: found.start()] + mark + text[found.end() :]


def _meaning(text: str) -> list[str]:
    """Return the numbers and words of a text: a correction that changes them would be a guess."""
    parts = re.findall(r"\d*\.?\d+|[^\W\d]+", re.sub(r"\.\.+|\bto\b", " ", text))
    return sorted("s" if own in ("sec", "secs", "second", "seconds") else own for own in parts)


@dataclass(frozen=True)
class Value:
    """How the text of an option is parsed, and what stands for it in help texts."""

    placeholder: str
    convert: Callable[[str], Any] = str
    is_path: bool = False  # Whether the shell completes it as a file name.
    choices: tuple[str, ...] = ()
    has_parts: bool = False  # Whether an error suggests another order of parts, or other marks.

    def read(self, text: str) -> Any:  # noqa: ANN401 - of any option
        """Convert a text; the error for one that cannot be read suggests a corrected one."""
        try:
            return self.convert(text)
        except ArgumentTypeError as error:
            is_corrected = self.has_parts and len(text) <= _MAX_LENGTH and text[:1] != "-"
            for other in _correct(text) if is_corrected else ():
                with suppress(ArgumentTypeError):
                    if _meaning(other) == _meaning(text):
                        self.convert(other)
                        error = ArgumentTypeError(f"{error}; did you mean {other!r}?")
                        break
            raise error from None


def parser(expected: str) -> Callable[[Callable[[str], T]], Callable[[str], T]]:
    """Return a decorator of converters: their errors become "`expected`, got TEXT"."""

    def decorate(convert: Callable[[str], T]) -> Callable[[str], T]:
        @wraps(convert)
        def parse(text: str) -> T:
            try:
                return convert(text)
            except (ArgumentTypeError, ValueError):
                raise ArgumentTypeError(f"{expected}, got {text}") from None

        return parse

    return decorate


def number(
    kind: Callable[[str], float], expected: str, low: float, high: float = math.inf
) -> Callable[[str], Any]:
    """Return a converter of text to a finite number of at least `low` and at most `high`."""

    @parser(f"must be {expected}")
    def convert(text: str) -> float:
        found = kind(text)
        if not (low <= found <= high and abs(found) < math.inf):
            raise ValueError
        return found

    return convert


def one_of(choices: Collection[str], more: str = "") -> Callable[[str], str]:
    """Return a converter that accepts only the words `choices` and suggests the nearest one.

    `more` begins the description of what is accepted.
    """

    def convert(text: str) -> str:
        if text not in choices:
            hint = suggest_name(text, choices)
            raise ArgumentTypeError(
                f"must be {more}one of {', '.join(choices)}; got {text!r}{hint}"
            )
        return text

    return convert


def choice(*words: str, placeholder: str | None = None) -> Value:
    """Return a value that is one of `words`."""
    return Value(placeholder or "|".join(words), one_of(words), choices=words)
