"""Frames that options give as numbers or, with the suffix ``s``, as times in seconds."""

from argparse import ArgumentTypeError
from dataclasses import dataclass

_MAX_SECONDS = 1e9  # times the frame rate of any file, this is a finite number of frames


@dataclass(frozen=True)
class Seconds:
    """A time from the start of a motion."""

    value: float


Frame = int | Seconds
"""Number of a frame, from 0, or its time."""

Range = tuple[Frame, Frame]
"""First and last frame, both included."""


def frame(text: str) -> Frame:
    """Read a frame, such as ``315`` or ``10.5s``."""
    if text.isdecimal():
        return int(text)
    number = text.removesuffix("s")
    # Only digits and one point: float() also accepts signs, blanks, "inf" and "1e9".
    if text != number and number.replace(".", "", 1).isdecimal():
        if float(number) > _MAX_SECONDS:
            raise ArgumentTypeError(f"must be at most {_MAX_SECONDS:g} s, got {text!r}")
        return Seconds(float(number))
    raise ArgumentTypeError(f"must be a frame such as 315 or a time such as 10.5s, got {text!r}")


def frames(text: str) -> Range:
    """Read ``FIRST-LAST``, such as ``100-400`` or ``3.3s-13.3s``; FIRST is not above LAST."""
    first, _, last = text.partition("-")
    try:
        ends = frame(first), frame(last)
    except ArgumentTypeError:
        ends = (1, 0)
    low, high = (end.value if isinstance(end, Seconds) else end for end in ends)
    if isinstance(ends[0], Seconds) != isinstance(ends[1], Seconds) or low > high:
        raise ArgumentTypeError(
            "expected FIRST-LAST with FIRST not above LAST, both frames or both seconds, such as "
            f"100-400 or 3.3s-13.3s, got {text!r}"
        )
    return ends


def frame_or_frames(text: str) -> Range:
    """Read a frame or a range of frames; return a single frame as a range of one frame."""
    if "-" in text:
        return frames(text)
    return frame(text), frame(text)


def frame_count(text: str) -> Frame:
    """Read a number of frames of at least 2, such as ``900``, or a duration such as ``30s``."""
    try:
        count = frame(text)
    except ArgumentTypeError:
        count = 0
    if (count.value <= 0) if isinstance(count, Seconds) else (count < 2):
        raise ArgumentTypeError(f"must be at least 2 frames or a time such as 30s, got {text!r}")
    return count


def resolve_frame(given: Frame, rate: float) -> int:
    """Return the index of a frame; a time is rounded to a frame at `rate` frames per second."""
    return round(given.value * rate) if isinstance(given, Seconds) else given


def resolve_frames(given: Range, rate: float) -> tuple[int, int]:
    """Return the indices of the first and last frame of a range; see `resolve_frame`."""
    return resolve_frame(given[0], rate), resolve_frame(given[1], rate)
