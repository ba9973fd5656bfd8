"""Types of options: each annotation has the `Value` that parses the text of the option.

A frame is a number or, with the suffix ``s``, a time in seconds.
"""

import math
import re
from argparse import ArgumentTypeError
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

from mograft._util.names import AUTOMATIC, automatic_number, is_automatic
from mograft.cli.syntax.converters import Value, number, one_of, parser
from mograft.errors import suggest_name

_MAX_SECONDS = 1e9  # times the frame rate of any file, this is a finite number of frames

SHAPES = {
    "sphere": ("Sphere", "X,Y,Z,RADIUS"),
    "capsule": ("Capsule", "X,Y,Z,X,Y,Z,RADIUS"),
    "box": ("Box", "X,Y,Z,HX,HY,HZ"),
    "wall": ("HalfSpace", "X,Y,Z,NX,NY,NZ"),
}
"""The class of each shape of ``--avoid`` in `mograft.constraints`, and its numbers."""

VMC_PORT = "39539"
"""Port at which receivers of VMC listen."""

REACH_TOLERANCE = 0.03
"""Default tolerance of ``--reach`` in skeleton heights."""

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")
UNITS = ("m", "cm", "mm", "inch", "CMU")


ABOVE_ZERO = math.ulp(0.0)
"""The smallest number above 0."""

_positive = number(float, "a number above 0", ABOVE_ZERO)
_port = number(int, "an integer from 0 to 65535", 0, 65535)


Frame = int | float
"""Number of a frame, from 0, as int; or its time in seconds, as float."""

Range = tuple[Frame, Frame]
"""First and last frame, both included."""

Taken = tuple[str, Frame, Frame]
"""A clip with a first and a last frame."""

Point = tuple[float, float, float]


@parser("must be a frame such as 315 or a time such as 10.5s, at most 1e+09 s")
def frame(text: str) -> Frame:
    """Read a frame, such as ``315`` or ``10.5s``."""
    if text.isdecimal():
        return int(text)
    # Only digits and one point: float() also accepts signs, blanks, "inf" and "1e9".
    seconds = float(text[:-1]) if re.fullmatch(r"(\d+\.?\d*|\.\d+)s", text) else math.inf
    if seconds > _MAX_SECONDS:
        raise ValueError
    return seconds


@parser(
    "expected FIRST-LAST with FIRST not above LAST, both frames or both seconds, such as 100-400 "
    "or 3.3s-13.3s"
)
def frames(text: str) -> Range:
    """Read ``FIRST-LAST``, such as ``100-400`` or ``3.3s-13.3s``; FIRST is not above LAST."""
    first, last = map(frame, text.split("-"))
    if type(first) is not type(last) or first > last:
        raise ValueError
    return first, last


def frame_or_frames(text: str) -> Range:
    """Read a frame or a range of frames; return a single frame as a range of one frame."""
    return frames(text) if "-" in text else (frame(text),) * 2


@parser("must be at least 2 frames or a time such as 30s")
def frame_count(text: str) -> Frame:
    """Read a number of frames of at least 2, such as ``900``, or a duration such as ``30s``."""
    count = frame(text)
    if count == 0 or (isinstance(count, int) and count < 2):
        raise ValueError
    return count


def resolve_frames(given: Any, rate: float) -> Any:  # noqa: ANN401 - a frame, or what holds some
    """Return frames in place of times, which are rounded at `rate` frames per second.

    `given` is a frame, a time, a tuple with any of them, or a value without them, such as None.
    """
    if isinstance(given, tuple):
        return tuple(resolve_frames(own, rate) for own in given)
    return round(given * rate) if isinstance(given, float) else given


def _parts(pattern: str, text: str) -> tuple[Any, ...]:
    """Return the groups of a pattern of the whole text; raise ValueError for another text."""
    found = re.fullmatch(pattern, text, re.DOTALL)
    if found is None:
        raise ValueError
    return found.groups()


BaseSegment = tuple[int | None, Range | None, str | None]
"""A base segment: its index, or its first and last frame, and optionally a joint group."""


def _segment(text: str) -> BaseSegment:
    """Parse ``[GROUP:]N`` or ``[GROUP:]FIRST-LAST``."""
    group, number, span = _parts(r"(?:(.+):)?(?:(\d+)|([^:]*))", text)
    return (int(number), None, group) if number else (None, frames(span), group)


Donor = str | Taken | None
"""A clip, a clip with its first and last frame, or none."""


def _donor(text: str) -> Donor:
    """Parse ``CLIP``, ``CLIP:FIRST-LAST`` or an empty text."""
    if re.search(r"@[\d.]+s?-[\d.]+s?$", text):
        raise ValueError("expected CLIP:FIRST-LAST")
    clip, _, span = text.rpartition(":")  # The name of a clip may contain colons.
    return (clip, *frames(span)) if clip and span[:1].isdecimal() else text or None


@parser("expected SEGMENT, SEGMENT=CLIP or SEGMENT=CLIP:FIRST-LAST, such as 24=walk")
def ban(text: str) -> tuple[BaseSegment, Donor]:
    """Parse a value of ``--ban``: ``[GROUP:]SEGMENT[=CLIP[:FIRST-LAST]]``."""
    segment, donor = _parts("([^=]*)(?:=(.+))?", text)
    return _segment(segment), _donor(donor or "")


@parser("expected SEGMENT=CLIP:FIRST-LAST as mograft candidates lists it, such as 24=walk:242-275")
def take(text: str) -> tuple[BaseSegment, Taken]:
    """Parse a value of ``--take``: ``[GROUP:]SEGMENT=CLIP:FIRST-LAST``."""
    segment, donor = ban(text)
    if not isinstance(donor, tuple):
        raise ValueError
    return segment, donor


Changed = tuple[str, tuple[Frame, Frame | None], Donor]
"""A group, its first and last frame, or None for the last of the motion, and a donor."""


@parser(
    "expected GROUP@FIRST-LAST, optionally with =CLIP or =CLIP:FIRST-LAST, such as "
    "upper@100-160=wave, upper@4s-6s or, to the end, upper@100-"
)
def change(text: str) -> Changed:
    """Parse a value of ``--change``: ``GROUP@FIRST-[LAST][=CLIP[:FIRST-LAST]]``."""
    group, span, donor = _parts("([^@=]+)@([^@=]*)(?:=(.+))?", text)
    within = (frame(span[:-1]), None) if span.endswith("-") else frames(span)
    return group, within, _donor(donor or "")


@parser(f"must be {', '.join(UNITS)} or the metres of a unit, such as 0.3048")
def unit(text: str) -> float | str:
    """Parse a unit of length: one of the names `UNITS`, or a number of metres."""
    return text if text in UNITS else _positive(text)


@parser("must be seconds above 0, or no value, after FILE, for the shortest cycle")
def cycle_seconds(text: str) -> float | str:
    """Parse the duration of a cycle, or ``auto`` for the shortest one."""
    return text if text == AUTOMATIC else _positive(text)


def _parse_share(text: str) -> float:
    return float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)


percentage = number(_parse_share, "a share from 0 to 1, or a percentage such as 10%", 0, 1)


def names(text: str) -> tuple[str, ...]:
    """Parse words that are separated by commas."""
    return tuple(text.split(","))


@parser("expected FIELD=VALUE, such as seam=offset, with a field of docs/settings.md")
def assignment(text: str) -> tuple[str, str]:
    """Parse ``NAME=VALUE`` into the name and the text of the value."""
    name, value = _parts("([^=]+)=(.+)", text)
    return name, value


@parser("must be CLIP=FPS")
def true_rate(text: str) -> tuple[str, float]:
    """Parse ``CLIP=FPS`` into the name of a clip and its frame rate."""
    clip, rate = _parts("(.+)=(.*)", text)
    return clip, _positive(rate)


@parser("must be FPS or GLOB=FPS")
def file_rate(text: str) -> tuple[str, float]:
    """Parse ``[GLOB=]FPS`` into a glob of names of files, by default ``*``, and a frame rate."""
    pattern, _, rate = text.rpartition("=")
    return pattern or "*", _positive(rate)


def preset(text: str, more: str = "") -> str:
    """Parse the name of a preset of joint groups, ``auto`` or ``auto:N``."""
    members = text.split(",")
    fitting = next((name for name in PRESETS if {*members} <= {*name.split("_")}), None)
    if fitting is not None:
        way = f"--groups {fitting} --swap {text}" if more else fitting
        raise ArgumentTypeError(f"{text} is no preset: use {way}")
    if not is_automatic(text):
        return one_of((*PRESETS, AUTOMATIC), more)(text)
    try:
        automatic_number(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error).removeprefix("`groups` ")) from None
    return text


def groups(text: str) -> str:
    """Parse the path of a TOML file with joint groups, or a name as `preset` does."""
    is_file = Path(text).suffix.lower() == ".toml" or Path(text).exists()
    return text if is_file else preset(text, "a TOML file, auto:N or ")


def _address(host: str, port: str) -> tuple[str, int]:
    """Return host and port; brackets around an IPv6 address are removed."""
    if not host or not 0 < _port(port) < 65536:
        raise ValueError
    return host.removeprefix("[").removesuffix("]"), _port(port)


@parser("must be HOST or HOST:PORT, such as 127.0.0.1:39539")
def receiver(text: str) -> tuple[str, int]:
    """Parse ``HOST[:PORT]``; the default port is that of receivers of VMC."""
    host, colon, port = text.rpartition(":")
    if text.isdecimal():
        raise ValueError  # a port
    is_whole = not colon or text.endswith("]") or (text.count(":") > 1 and text[:1] != "[")
    return _address(text, VMC_PORT) if is_whole else _address(host, port)


@parser("must be PORT or HOST:PORT, such as 39540")
def listener(text: str) -> tuple[str, int]:
    """Parse ``[HOST:]PORT``; the default is an address that only this computer reaches."""
    host, _, port = text.rpartition(":")
    return _address(host or "127.0.0.1", port)


_TRACKERS = ("mjlab", "beyondmimic")
tracker = parser("must be mjlab or beyondmimic, for a motion of a robot that --model gives")(
    one_of(_TRACKERS)
)


@parser("must be WIDTHxHEIGHT, such as 720x480")
def picture_size(text: str) -> tuple[int, int]:
    """Parse ``WIDTHxHEIGHT``, a size in pixels."""
    width, height = _parts(r"(\d+)x(\d+)", text)
    return int(width), int(height)


def _numbers(text: str, *forms: str, prefix: str = "") -> tuple[float, ...]:
    """Parse as many numbers as one of `forms`, such as ``X,Y,Z``, has; `prefix` is before them."""
    numbers, words = tuple[float, ...](), text.split(",")
    if len(words) in [len(form.split(",")) for form in forms]:
        with suppress(ValueError):
            numbers = tuple(map(float, words))
    if not numbers:
        raise ArgumentTypeError(f"expected {prefix}{' or '.join(forms)}, got {prefix}{text}")
    return numbers


def _point(text: str) -> Point:
    x, y, z = _numbers(text, "a point X,Y,Z")
    return x, y, z


@parser("must be at least two corners, such as 0,0:300,0")
def corners(text: str) -> list[tuple[float, ...]]:
    """Parse ``X,Z:X,Z:...``, at least two positions on the floor, into pairs of numbers."""
    found = [_numbers(pair, "X,Z") for pair in text.split(":")]
    if len(found) < 2:
        raise ValueError
    return found


def obstacle(text: str) -> tuple[str, tuple[float, ...], Range | None]:
    """Parse a value of ``--avoid``: ``SHAPE:NUMBERS`` or ``FILE[@X,Y,Z[,YAW]]``, then ``@FRAMES``.

    Return the name of the shape with its numbers, or the file with x, y, z and yaw in degrees; and
    the first and last frame in which it is avoided, or None.
    """
    found = None if Path(text).exists() else re.fullmatch(r"(.*)@(\d[^,@]*)", text, re.DOTALL)
    span = frames(found[2]) if found else None
    return (*_shape(found[1] if found else text), span)


def _shape(text: str) -> tuple[str, tuple[float, ...]]:
    """Parse a shape or the file of a character into its name and numbers."""
    kind, colon, rest = text.partition(":")
    if colon and kind in SHAPES:
        return kind, _numbers(rest, SHAPES[kind][1], prefix=f"{kind}:")
    name, separator, place = text.rpartition("@")
    path = Path((name or text).partition("#")[0])
    if not path.exists() and (not path.suffix or re.search("[,;=:]", str(path))):
        forms = ", ".join(f"{name}:{numbers}" for name, (_, numbers) in SHAPES.items())
        hint = suggest_name(kind, SHAPES, cutoff=0.8)
        raise ArgumentTypeError(f"expected a file, or one of {forms}, got {text}{hint}")
    if not separator or Path(text).exists():
        return text, (0.0,) * 4
    return name, (*_numbers(place, "X,Y,Z", "X,Y,Z,YAW"), 0.0)[:4]


Reached = tuple[Range, str, str | None, Point, float]
"""Frames, joint, part to which the position is relative, position and tolerance of a reach."""


@parser(
    "expected FRAME:JOINT:X,Y,Z[~TOL] or FRAME:JOINT:@PART+LEFT,UP,FORWARD[~TOL], with a frame "
    "such as 315 or 10.5s, or FIRST-LAST; TOL and LEFT,UP,FORWARD are in heights of the figure, "
    "without a unit: 3 cm is about 0.017"
)
def reach(text: str) -> Reached:
    """Parse ``FRAMES:JOINT:[@PART+]X,Y,Z[~TOL]``; TOL and offsets are in skeleton heights."""
    # The name of a joint may contain colons.
    pattern = r"([^:]*):((?:(?!:@).)+)(?::@([^+]+)\+|:)([^:~]*)(?:~(.*))?"
    when, joint, part, place, tolerance = _parts(pattern, text)
    within = REACH_TOLERANCE if tolerance is None else _positive(tolerance)
    return frame_or_frames(when), joint, part, _point(place), within


def face(text: str) -> tuple[Point, Range | None]:
    """Parse ``X,Y,Z[@FIRST-LAST]`` into a position, and a range of frames or None."""
    place, separator, range_text = text.partition("@")
    return _point(place), frames(range_text) if separator else None


_ANGLE = "an angle in degrees, above 0 and at most 180"
_TURN = "an angle in degrees, above 0 for left, such as 90"
_DISTANCE = "an angle from 0 to 180, such as 5 (different motions are some 5 to 20 degrees apart)"


def _integer(expected: str, low: float, high: float = math.inf) -> Value:
    return Value("N", number(int, expected, low, high))


def _number(placeholder: str, expected: str, low: float, high: float = math.inf) -> Value:
    return Value(placeholder, number(float, expected, low, high))


Name = Annotated[str, Value("NAME")]
Count = Annotated[int, _integer("an integer of at least 1", 1)]
Bases = Annotated[int, _integer("a number of clips, at least 1 (for one clip give its file)", 1)]
Motions = Annotated[int, _integer("from 1 to 100000 (other seeds give more)", 1, 100_000)]
Windows = Annotated[int, _integer("from 1 to 10000000", 1, 10_000_000)]
Index = Annotated[int, _integer("an integer of at least 0", 0)]
Decimals = Annotated[int, _integer("an integer from 1 to 12", 1, 12)]
Port = Annotated[int, Value("N", _port)]
Share = Annotated[float, _number("X", "a number from 0 to 1", 0, 1)]
Percentage = Annotated[float, Value("X|X%", percentage)]
NonNegative = Annotated[float, _number("X", "a number of at least 0", 0)]
Rate = Annotated[float, _number("FPS", "frames per second above 0", ABOVE_ZERO)]
Duration = Annotated[float, _number("S", "seconds above 0", ABOVE_ZERO)]
Delay = Annotated[float, _number("S", "seconds of at least 0, such as 0.5", 0)]
Tempo = Annotated[float, _number("BPM", "beats per minute above 0", ABOVE_ZERO)]
Speed = Annotated[float, _number("X", "a factor, such as 0.5, above 0", ABOVE_ZERO)]
Degrees = Annotated[float, _number("DEGREES", _ANGLE, ABOVE_ZERO, 180)]
Stretch = Annotated[float, _number("X", "a fraction from 0 to 3, such as 0.3 for 30 %", 0, 3)]
Turn = Annotated[float, _number("DEGREES", _TURN, -math.inf)]
Distance = Annotated[float, _number("DEGREES", _DISTANCE, 0, 180)]
Size = Annotated[tuple[int, int], Value("WIDTHxHEIGHT", picture_size)]
Receiver = Annotated[tuple[str, int], Value("HOST[:PORT]", receiver)]
Listener = Annotated[tuple[str, int], Value("[HOST:]PORT", listener)]
Tracker = Annotated[Literal["mjlab", "beyondmimic"], Value("NAME", tracker, choices=_TRACKERS)]
Unit = Annotated[float | str, Value("UNIT|X", unit)]
Cycle = Annotated[float | str, Value("S", cycle_seconds)]
Source = Annotated[str, Value("FILE", is_path=True)]
SourceOrFolder = Annotated[str, Value("FILE|DIR", is_path=True)]
LibraryOrFile = Annotated[str, Value("LIB|FILE", is_path=True)]
ClipOrFile = Annotated[str, Value("CLIP|FILE", is_path=True)]
Record = Annotated[str, Value("JSON", is_path=True)]
Table = Annotated[Path, Value("TABLE", Path, is_path=True)]
Columns = Annotated[tuple[str, ...], Value("COLUMN,...", names)]
OutputPath = Annotated[Path, Value("PATH", Path, is_path=True)]
Folder = Annotated[Path, Value("DIR", Path, is_path=True)]
File = Annotated[Path, Value("FILE", Path, is_path=True)]
LibraryFolder = Annotated[Path, Value("LIB", Path, is_path=True)]
Words = Annotated[tuple[str, ...], Value("GROUP,...", names)]
Preset = Annotated[str, Value("NAME", preset)]
Groups = Annotated[str, Value("NAME|FILE|auto:N", groups, is_path=True)]
Clips = Annotated[tuple[str, ...], Value("CLIP,...", names)]
Tags = Annotated[tuple[str, ...], Value("TAG,...", names)]
Assignment = Annotated[tuple[str, str], Value("FIELD=VALUE", assignment, has_parts=True)]
TrueRate = Annotated[tuple[str, float], Value("CLIP=FPS", true_rate)]
FileRate = Annotated[tuple[str, float], Value("[GLOB=]FPS", file_rate)]
FrameValue = Annotated[Frame, Value("N|S", frame)]
Frames = Annotated[Range, Value("FIRST-LAST", frames, has_parts=True)]
Length = Annotated[Frame, Value("N|S", frame_count)]
Take = Annotated[tuple[BaseSegment, Taken], Value("SEGMENT=CLIP:FIRST-LAST", take, has_parts=True)]
Ban = Annotated[
    tuple[BaseSegment, Donor], Value("SEGMENT[=CLIP[:FIRST-LAST]]", ban, has_parts=True)
]
Change = Annotated[Changed, Value("GROUP@FIRST-LAST[=CLIP[:FIRST-LAST]]", change, has_parts=True)]
Corners = Annotated[list[tuple[float, float]], Value("X,Z:X,Z:...", corners)]
Reach = Annotated[Reached, Value("FRAME[-LAST]:JOINT:[@PART+]X,Y,Z[~TOL]", reach, has_parts=True)]
Avoid = Annotated[
    tuple[str, tuple[float, ...], Range | None],
    Value("WHAT[@FIRST-LAST]", obstacle, has_parts=True),
]
Face = Annotated[tuple[Point, Range | None], Value("X,Y,Z[@FIRST-LAST]", face, has_parts=True)]
