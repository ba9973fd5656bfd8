"""Converters of option values, for the ``type`` of argparse."""

import math
from argparse import ArgumentTypeError
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from mograft._util.automatic_groups import AUTOMATIC, automatic_number, is_automatic
from mograft._util.registry import AUTOMATIC_SCALE, CONFIG_OPTIONS
from mograft.cli.syntax.frame_times import Range, frame_or_frames, frames
from mograft.errors import suggest_name

SHAPE_NUMBERS = {"sphere": 4, "capsule": 7, "box": 6, "wall": 6}
"""How many numbers describe each shape of ``--avoid``."""

REACH_TOLERANCE = 0.03
"""Default tolerance of ``--reach`` in skeleton heights."""

UNITS = ("m", "cm", "mm", "inch", "CMU")

N = TypeVar("N", int, float)


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


def decimals(text: str) -> int:
    """Read a number of decimals, an integer from 1 to 12."""
    return _number(int, text, lambda number: 1 <= number <= 12, "an integer from 1 to 12")


def port(text: str) -> int:
    """Read the number of a TCP port, from 0 to 65535."""
    return _number(int, text, lambda number: 0 <= number <= 65535, "an integer from 0 to 65535")


def share(text: str) -> float:
    """Read a number from 0 to 1."""
    return _number(float, text, lambda number: 0 <= number <= 1, "a number from 0 to 1")


def _number(kind: Callable[[str], N], text: str, is_valid: Callable[[N], bool], expected: str) -> N:
    try:
        number = kind(text)
    except ValueError:
        number = None
    if number is None or not is_valid(number):
        raise ArgumentTypeError(f"must be {expected}, got {text}")
    return number


def unit(text: str) -> float | str:
    """Parse a unit of length: one of the names `UNITS`, or a number of metres."""
    try:
        return text if text in UNITS else positive_number(text)
    except ArgumentTypeError:
        raise ArgumentTypeError(
            f"must be {', '.join(UNITS)} or a number above 0, got {text}"
        ) from None


def one_of(choices: Collection[str]) -> Callable[[str], str]:
    """Return a converter that accepts only the words `choices` and suggests the nearest one."""

    def convert(text: str) -> str:
        if text not in choices:
            hint = suggest_name(text, choices)
            raise ArgumentTypeError(f"must be one of {', '.join(choices)}; got {text!r}{hint}")
        return text

    return convert


def segmentation(text: str) -> Path | tuple[str, dict[str, float | bool | str]]:
    """Parse ``NAME[:PARAMETER=VALUE,...]`` or the name of a .json file.

    Return the path of the file, or the name of the method and its parameters.
    """
    if text.lower().endswith(".json"):
        return Path(text)
    name, _, rest = text.partition(":")
    names = CONFIG_OPTIONS["segmentation"].names
    if name not in names:
        hint = suggest_name(name, names)
        raise ArgumentTypeError(
            f"must be one of {', '.join(names)} or the name of a .json file with cut frames; "
            f"got {name!r}{hint}"
        )
    parameters: dict[str, float | bool | str] = {}
    for word in rest.split(",") if rest else []:
        key, separator, value = word.partition("=")
        if not (key and separator and value) or key in parameters:
            raise ArgumentTypeError(
                f"must be NAME:PARAMETER=VALUE,... with different parameters, got {text!r}"
            )
        parameters[key] = _plain_value(value)
    return name, parameters


def _plain_value(text: str) -> float | bool | str:
    """Return the number, True or False that a text denotes; return any other text unchanged."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def preset_or_automatic(presets: Collection[str]) -> Callable[[str], str]:
    """Return a converter that accepts the names `presets`, ``auto`` and ``auto:N``."""

    def convert(text: str) -> str:
        if not is_automatic(text):
            return one_of((*presets, AUTOMATIC))(text)
        try:
            automatic_number(text)
        except ValueError as error:
            raise ArgumentTypeError(str(error).removeprefix("`groups` ")) from None
        return text

    return convert


def positive_number_or_auto(text: str) -> float | str:
    """Read a number above 0, or the word `AUTOMATIC_SCALE`."""
    if text == AUTOMATIC_SCALE:
        return text
    expected = f"a number above 0, or {AUTOMATIC_SCALE}"
    return _number(float, text, lambda number: 0 < number < math.inf, expected)


def picture_size(text: str) -> tuple[int, int]:
    """Parse ``WIDTHxHEIGHT``, a size in pixels."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 720x480, got {text}")
    return int(width), int(height)


def _numbers(text: str, *counts: int) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        expected = " or ".join(str(count) for count in counts)
        raise ArgumentTypeError(f"expected {expected} numbers separated by commas, got {text!r}")
    return numbers


def corners(text: str) -> list[list[float]]:
    """Parse ``X,Z:X,Z:...``, at least two positions on the floor, into pairs of numbers."""
    try:
        found = [_numbers(pair, 2) for pair in text.split(":")]
    except ArgumentTypeError:
        found = []
    if len(found) < 2:
        raise ArgumentTypeError(f"must be at least two corners, such as 0,0:300,0; got {text}")
    return found


def obstacle(text: str) -> tuple[str, list[float], Range | None]:
    """Parse a value of ``--avoid``: ``SHAPE:NUMBERS`` or ``FILE[@X,Y,Z[,YAW]]``, then ``@FRAMES``.

    Return the name of the shape with its numbers, or the file with x, y, z and yaw in degrees; and
    the first and last frame in which it is avoided, or None.
    """
    what, span = text, None
    if not Path(text).exists():
        before, separator, range_text = text.rpartition("@")
        if separator and "," not in range_text and range_text[:1].isdecimal():
            what, span = before, frames(range_text)
    return (*_shape(what), span)


def _shape(text: str) -> tuple[str, list[float]]:
    """Parse a shape or the file of a character into its name and numbers."""
    kind, colon, rest = text.partition(":")
    if colon and kind in SHAPE_NUMBERS:
        return kind, _numbers(rest, SHAPE_NUMBERS[kind])
    if colon and len(kind) > 1 and kind.isalpha() and not Path(text).exists():
        raise ArgumentTypeError(
            f"expected a file or one of the shapes {', '.join(SHAPE_NUMBERS)}, got {kind}"
            f"{suggest_name(kind, SHAPE_NUMBERS)}"
        )
    name, separator, place = text.rpartition("@")
    if not separator or Path(text).exists():
        return text, [0.0] * 4
    return name, [*_numbers(place, 3, 4), 0.0][:4]


def reach(text: str) -> tuple[Range, str, tuple[float, ...], float]:
    """Parse ``FRAMES:JOINT:X,Y,Z[~TOL]``; the tolerance TOL is in skeleton heights."""
    when, _, rest = text.partition(":")
    joint, colon, place = rest.rpartition(":")  # The name of a joint may contain colons.
    try:
        span = frame_or_frames(when)
    except ArgumentTypeError:
        colon = ""
    if not colon:
        raise ArgumentTypeError(
            "expected FRAME:JOINT:X,Y,Z[~TOL] or FIRST-LAST:JOINT:X,Y,Z[~TOL], with frames such as "
            f"315 or 10.5s, got {text!r}"
        )
    place, tilde, tolerance = place.partition("~")
    within = positive_number(tolerance) if tilde else REACH_TOLERANCE
    return span, joint, tuple(_numbers(place, 3)), within


def face(text: str) -> tuple[tuple[float, ...], Range | None]:
    """Parse ``X,Y,Z[@FIRST-LAST]`` into a position, and a range of frames or None."""
    place, separator, range_text = text.partition("@")
    return tuple(_numbers(place, 3)), frames(range_text) if separator else None
