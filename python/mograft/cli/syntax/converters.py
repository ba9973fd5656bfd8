"""How texts of options become values, and what is said of texts that do not."""

from argparse import ArgumentTypeError
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar

from mograft.errors import suggest_name

T = TypeVar("T")


@dataclass(frozen=True)
class Value:
    """How the text of an option is parsed, and what stands for it in help texts."""

    placeholder: str
    convert: Callable[[str], Any] = str
    is_path: bool = False  # Whether the shell completes it as a file name.
    choices: tuple[str, ...] = ()


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
    kind: Callable[[str], float], expected: str, is_valid: Callable[[float], bool]
) -> Callable[[str], Any]:
    """Return a converter of text to a number of which `is_valid` is true."""

    @parser(f"must be {expected}")
    def convert(text: str) -> float:
        if not is_valid(number := kind(text)):
            raise ValueError
        return number

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
