"""Frames and base segments in option values.

A frame is a number or, with the suffix ``s``, a time in seconds.
"""

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

Taken = tuple[str, Frame, Frame]
"""A clip with a first and a last frame."""


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


@dataclass(frozen=True)
class SegmentValue:
    """A base segment, given by its index or by its frames, and optionally a joint group."""

    number: int | None  # Index of the segment, or None if its frames are given.
    span: Range | None  # First and last frame, or None if the index is given.
    group: str | None = None

    def resolve_span(self, rate: float) -> tuple[int, int] | None:
        """Return the first and last frame; None if the segment is given by its number.

        `rate` is in frames per second.
        """
        return None if self.span is None else resolve_frames(self.span, rate)


def segment_value(text: str) -> SegmentValue:
    """Parse a base segment: its index ``N`` or its frames ``FIRST-LAST``."""
    if text.isdecimal():
        return SegmentValue(int(text), None)
    try:
        return SegmentValue(None, frames(text))
    except ArgumentTypeError:
        raise ArgumentTypeError(
            f"expected a segment such as 24, or frames such as 100-400 or 10s-12.5s, got {text!r}"
        ) from None


def take(text: str) -> tuple[SegmentValue, Taken]:
    """Parse a value of ``--take``: ``[GROUP:]SEGMENT=CLIP:FIRST-LAST``.

    Return the base segment, and the clip, first frame and last frame of the donor.
    """
    segment, _, donor = text.partition("=")
    clip, colon, span = donor.rpartition(":")  # The name of a clip may contain colons.
    try:
        if colon and clip:
            return _group_segment(segment), (clip, *frames(span))
    except ArgumentTypeError:
        pass
    raise ArgumentTypeError(
        f"expected SEGMENT=CLIP:FIRST-LAST, such as 24=walk:242-275, got {text!r}"
    )


def ban(text: str) -> tuple[SegmentValue, str | Taken | None]:
    """Parse a value of ``--ban``: ``[GROUP:]SEGMENT[=CLIP[:FIRST-LAST]]``.

    Return the base segment, and the donors: None, a clip, or a clip with its first and last frame.
    """
    segment, equals, clip = text.partition("=")
    try:
        if equals and clip:
            value = _group_segment(segment)
            name, colon, clip_frames = clip.rpartition(":")
            if colon and name and clip_frames[:1].isdecimal():
                return value, (name, *frames(clip_frames))
            return value, clip
        if not equals:
            return _group_segment(segment), None
    except ArgumentTypeError:
        pass
    raise ArgumentTypeError(
        f"expected SEGMENT, SEGMENT=CLIP or SEGMENT=CLIP:FIRST-LAST, such as 24=walk, got {text!r}"
    )


def _group_segment(text: str) -> SegmentValue:
    """Parse a segment, optionally after the name of a group and a colon."""
    group, colon, segment = text.rpartition(":")
    value = segment_value(segment)
    if colon and not group:
        raise ArgumentTypeError("expected the name of a group before the colon")
    return SegmentValue(value.number, value.span, group or None)
