"""Converters of option values, for the ``type`` of argparse."""

import math
from argparse import ArgumentTypeError
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mograft._util.names import AUTOMATIC, automatic_number, is_automatic
from mograft.cli.syntax.frames import (
    Range,
    ban,
    frame,
    frame_count,
    frame_or_frames,
    frames,
    segment_value,
    take,
)
from mograft.errors import suggest_name


@dataclass(frozen=True)
class Value:
    """How the text of an option is parsed, and what stands for it in help texts."""

    placeholder: str
    convert: Callable[[str], Any] = str
    is_path: bool = False  # Whether the shell completes it as a file name.
    choices: tuple[str, ...] = ()


SHAPE_NUMBERS = {"sphere": 4, "capsule": 7, "box": 6, "wall": 6}
"""How many numbers describe each shape of ``--avoid``."""

REACH_TOLERANCE = 0.03
"""Default tolerance of ``--reach`` in skeleton heights."""

Point = tuple[float, float, float]

UNITS = ("m", "cm", "mm", "inch", "CMU")


def _number(
    kind: Callable[[str], float], expected: str, is_valid: Callable[[float], bool]
) -> Callable[[str], float]:
    """Return a converter of text to a number of which `is_valid` is true."""

    def convert(text: str) -> float:
        try:
            number = kind(text)
        except ValueError:
            number = math.nan
        if not is_valid(number):
            raise ArgumentTypeError(f"must be {expected}, got {text}")
        return number

    return convert


positive_integer = _number(int, "an integer of at least 1", lambda n: n >= 1)
non_negative_integer = _number(int, "an integer of at least 0", lambda n: n >= 0)
decimals = _number(int, "an integer from 1 to 12", lambda n: 1 <= n <= 12)
port = _number(int, "an integer from 0 to 65535", lambda n: 0 <= n <= 65535)
positive_number = _number(float, "a number above 0", lambda x: 0 < x < math.inf)
non_negative_number = _number(float, "a number of at least 0", lambda x: 0 <= x < math.inf)
share = _number(float, "a number from 0 to 1", lambda x: 0 <= x <= 1)


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


def names(text: str) -> tuple[str, ...]:
    """Parse words that are separated by commas."""
    return tuple(text.split(","))


def assignment(text: str) -> tuple[str, str]:
    """Parse ``NAME=VALUE`` into the name and the text of the value."""
    name, separator, value = text.partition("=")
    if not (name and separator and value):
        raise ArgumentTypeError(f"expected FIELD=VALUE, such as seam=offset, got {text!r}")
    return name, value


def true_rate(text: str) -> tuple[str, float]:
    """Parse ``CLIP=FPS`` into the name of a clip and its frame rate."""
    clip, _, rate = text.rpartition("=")
    try:
        if clip:
            return clip, positive_number(rate)
    except ArgumentTypeError:
        pass
    raise ArgumentTypeError(f"must be CLIP=FPS, got {text}")


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


def picture_size(text: str) -> tuple[int, int]:
    """Parse ``WIDTHxHEIGHT``, a size in pixels."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ArgumentTypeError(f"must be WIDTHxHEIGHT, such as 720x480, got {text}")
    return int(width), int(height)


def _numbers(text: str, *counts: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in counts:
        expected = " or ".join(str(count) for count in counts)
        raise ArgumentTypeError(f"expected {expected} numbers separated by commas, got {text!r}")
    return numbers


def _point(text: str) -> Point:
    x, y, z = _numbers(text, 3)
    return x, y, z


def corners(text: str) -> list[tuple[float, ...]]:
    """Parse ``X,Z:X,Z:...``, at least two positions on the floor, into pairs of numbers."""
    try:
        found = [_numbers(pair, 2) for pair in text.split(":")]
    except ArgumentTypeError:
        found = []
    if len(found) < 2:
        raise ArgumentTypeError(f"must be at least two corners, such as 0,0:300,0; got {text}")
    return found


def obstacle(text: str) -> tuple[str, tuple[float, ...], Range | None]:
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


def _shape(text: str) -> tuple[str, tuple[float, ...]]:
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
        return text, (0.0,) * 4
    return name, (*_numbers(place, 3, 4), 0.0)[:4]


def reach(text: str) -> tuple[Range, str, Point, float]:
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
    return span, joint, _point(place), within


def face(text: str) -> tuple[Point, Range | None]:
    """Parse ``X,Y,Z[@FIRST-LAST]`` into a position, and a range of frames or None."""
    place, separator, range_text = text.partition("@")
    return _point(place), frames(range_text) if separator else None


def choice(*words: str, placeholder: str | None = None) -> Value:
    """Return a value that is one of `words`."""
    return Value(placeholder or "|".join(words), one_of(words), choices=words)


TEXT = Value("TEXT")
NAME = Value("NAME")
COUNT = Value("N", positive_integer)
INDEX = Value("N", non_negative_integer)
NUMBER = Value("X", positive_number)
RATE = Value("FPS", positive_number)
SECONDS = Value("S", positive_number)
FILES = Value("FILE", is_path=True)
LIBRARY_OR_FILES = Value("LIB|FILE", is_path=True)
PATH = Value("PATH", Path, is_path=True)
DIR = Value("DIR", Path, is_path=True)
FILE = Value("FILE", Path, is_path=True)
SOURCE = Value("FILE", is_path=True)
CLIPS = Value("CLIP,...", names)
TAGS = Value("TAG,...", names)
FRAME = Value("N|S", frame)
FRAMES = Value("FIRST-LAST", frames)
LENGTH = Value("N|S", frame_count)
SEGMENT = Value("SEGMENT", segment_value)
TAKE = Value("SEGMENT=CLIP:FIRST-LAST", take)
BAN = Value("SEGMENT[=CLIP[:FIRST-LAST]]", ban)
