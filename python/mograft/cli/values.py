"""Converters of option values, for the ``type`` of argparse."""

import argparse
import math
from collections.abc import Callable
from typing import TypeVar

__all__ = [
    "argument_type",
    "frame_range",
    "non_negative_integer",
    "non_negative_number",
    "positive_integer",
    "positive_number",
]

N = TypeVar("N", int, float)
T = TypeVar("T")


def non_negative_integer(text: str) -> int:
    """Read an integer of at least 0."""
    return _number(int, text, lambda number: number >= 0, "an integer of at least 0")


def positive_integer(text: str) -> int:
    """Read an integer of at least 1."""
    return _number(int, text, lambda number: number >= 1, "an integer of at least 1")


def positive_number(text: str) -> float:
    """Read a finite number above 0."""
    return _number(float, text, lambda number: 0 < number < math.inf, "a number above 0")


def non_negative_number(text: str) -> float:
    """Read a finite number of at least 0."""
    return _number(float, text, lambda number: 0 <= number < math.inf, "a number of at least 0")


def _number(kind: Callable[[str], N], text: str, is_valid: Callable[[N], bool], expected: str) -> N:
    try:
        number = kind(text)
    except ValueError:
        number = None
    if number is None or not is_valid(number):
        raise argparse.ArgumentTypeError(f"must be {expected}, got {text}")
    return number


def frame_range(text: str) -> tuple[int, int]:
    """Read the first and last frame of a range of at least two frames."""
    first, dash, last = text.partition("-")
    if not (dash and first.isdigit() and last.isdigit() and int(first) < int(last)):
        raise argparse.ArgumentTypeError(f"must be FIRST-LAST, as 100-400, got {text}")
    return int(first), int(last)


def argument_type(convert: Callable[[str], T]) -> Callable[[str], T]:
    """Return a converter whose `ValueError` argparse prints in full."""

    def convert_or_report(text: str) -> T:
        try:
            return convert(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return convert_or_report
