"""Converters of option values that select base segments and their donors."""

from argparse import ArgumentTypeError
from dataclasses import dataclass

from mograft.cli.syntax.frame_times import Frame, Range, frames, resolve_frames


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


def take(text: str) -> tuple[SegmentValue, tuple[str, Frame, Frame]]:
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


def ban(text: str) -> tuple[SegmentValue, str | tuple[str, Frame, Frame] | None]:
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
