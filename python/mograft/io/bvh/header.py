"""Parsing of a BVH file up to its first frame: the hierarchy and the two lines of MOTION."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mograft.io.bvh.cursor import Cursor, Position, describe_word
from mograft.motion import limits
from mograft.motion.skeleton import CHANNELS, EndSite, Skeleton

# Patterns for `Cursor.take`: one group, followed by white space.
_NAME = re.compile(rb"([^\r\n{]*)[ \t-\r]*")
_SITE = re.compile(rb"(site(?=[ \t-\r{]|\Z))[ \t-\r]*", re.IGNORECASE)
_FRAMES = re.compile(rb"(frames[ \t-\r]*:?)[ \t-\r]*", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"(frames?[ \t-\r]*time[ \t-\r]*:?)[ \t-\r]*", re.IGNORECASE)

_CHANNEL_OF_WORD = {name.lower().encode(): name for name in CHANNELS}


@dataclass(frozen=True)
class Header:
    """The part of a BVH file before its first frame."""

    skeleton: Skeleton
    n_frames: int  # as declared
    frames_position: Position  # of the declared number in the file
    frame_time: float  # seconds


@dataclass(slots=True)
class _Open:
    """A joint whose brace is open, and how many children and end sites it has so far."""

    joint: int
    n_children: int = 0
    n_end_sites: int = 0


class _Joint(NamedTuple):
    name: bytes
    position: Position
    offset: Sequence[float]
    channels: tuple[str, ...]


@dataclass(frozen=True)
class _Tree:
    """The joints and end sites that were read, and the joints with open braces."""

    joints: list[_Joint] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    # Name, position, offset, index of the joint, and `EndSite.before`.
    sites: list[tuple[bytes, Position, Sequence[float], int, int]] = field(default_factory=list)
    open: list[_Open] = field(default_factory=list)

    def add_site(self, name: bytes, position: Position, offset: Sequence[float]) -> None:
        """Add an end site to the last open joint."""
        above = self.open[-1]
        self.sites.append((name, position, offset, above.joint, above.n_children))
        above.n_end_sites += 1


def read_header(cursor: Cursor) -> Header:
    """Read the part of a file before the first number of the first frame."""
    skeleton = _read_hierarchy(cursor)
    if not skeleton.n_channels:
        cursor.fail("expected at least one channel, got none in the whole hierarchy")
    cursor.expect(b"MOTION")
    n_frames, frame_time, frames_position = None, None, (1, 1)
    while n_frames is None or frame_time is None:
        cursor.skip_comments()
        if frame_time is None and (label := cursor.take(_FRAME_TIME)) is not None:
            _check_label(cursor, label, b"Frame Time:")
            frame_time = cursor.take_number("the frame time in seconds")
            try:
                limits.check_frame_time(frame_time)
            except ValueError as error:
                cursor.fail(str(error))
            if n_frames is None:
                cursor.tolerate("order", "Frame Time before Frames")
        elif n_frames is None and (label := cursor.take(_FRAMES)) is not None:
            _check_label(cursor, label, b"Frames:")
            n_frames = cursor.take_count("the number of frames")
            frames_position = cursor.position()
        else:
            expected = "Frames:" if n_frames is None else "Frame Time:"
            cursor.fail(f"expected {expected}, got {describe_word(cursor.take_word())}")
    return Header(skeleton, n_frames, frames_position, frame_time)


def _check_label(cursor: Cursor, label: bytes, expected: bytes) -> None:
    """List a label that is misspelt or not followed by white space as a repair.

    If the cursor is strict, raise BvhError instead.
    """
    words = b" ".join(label.split())
    text = describe_word(words)
    if words != expected:
        cursor.tolerate("label " + text, f"{text!r} read as {describe_word(expected)!r}")
    elif cursor.buffer[cursor.offset - 1 : cursor.offset] == b":":
        cursor.tolerate("label blank", f"no space after {text!r}")


_latest: tuple[bytes, Skeleton] | None = None
"""Text and skeleton of the last hierarchy that was read without a repair.

Files of one database mostly begin with the same text, whose parsing takes longer than their frames.
"""


def _read_hierarchy(cursor: Cursor) -> Skeleton:
    global _latest
    latest = _latest
    if latest is not None and cursor.skip_text(latest[0]):
        return latest[1]
    buffer, start, repairs = cursor.buffer, cursor.offset, cursor.repairs()
    skeleton = _parse_hierarchy(cursor)
    if cursor.buffer is buffer and cursor.repairs() == repairs:
        _latest = buffer[start : cursor.offset], skeleton
    return skeleton


def _parse_hierarchy(cursor: Cursor) -> Skeleton:
    cursor.expect(b"HIERARCHY")
    cursor.expect(b"ROOT")
    tree = _Tree()
    _add_joint(cursor, tree, _read_joint(cursor, "ROOT"))
    while tree.open:
        _read_item(cursor, tree)
    words, positions, offsets, channels = zip(*tree.joints, strict=True)
    names = _decode_names(cursor, words, positions)
    site_words, places, ends, parents, ranks = [*zip(*tree.sites, strict=True)] or [()] * 5
    site_names = _decode_names(cursor, site_words, places)
    _check_names(cursor, names, positions)
    try:
        sites = tuple(map(EndSite, parents, ends, ranks, site_names))
        return Skeleton(names, np.array(tree.parents), np.array(offsets), channels, sites)
    except ValueError as error:
        cursor.fail(str(error))


def _add_joint(cursor: Cursor, tree: _Tree, joint: _Joint) -> None:
    """Add a joint whose brace is open."""
    try:
        limits.check_joints(len(tree.joints) + 1)
        limits.check_levels(len(tree.open) + 1)
    except ValueError as error:
        cursor.fail(str(error), joint.position)
    tree.parents.append(tree.open[-1].joint if tree.open else -1)
    if tree.open:
        tree.open[-1].n_children += 1
    tree.open.append(_Open(len(tree.joints)))
    tree.joints.append(joint)


def _read_item(cursor: Cursor, tree: _Tree) -> None:
    """Read the start of a joint, an end site, or the closing brace of a joint."""
    word = cursor.take_keyword()
    if word == b"JOINT":
        _add_joint(cursor, tree, _read_joint(cursor, "JOINT"))
    elif word == b"End":
        tree.add_site(*_read_end_site(cursor))
    elif word == b"}":
        _check_end_sites(cursor, tree, tree.open.pop())
    else:
        last = tree.joints[tree.open[-1].joint]
        owner = f"{describe_word(last.name)} (line {last.position[0]})"
        expected = f"JOINT, End Site or the }} of {owner}"
        cursor.fail(f"expected {expected}, got {describe_word(word)}")


def _read_joint(cursor: Cursor, keyword: str) -> _Joint:
    """Read a joint from its name up to its channels; the keyword ROOT or JOINT has been read."""
    line = cursor.position()[0]
    name = _take_name(cursor)
    position = cursor.position()
    if not name:
        cursor.fail(f"expected a name after {keyword}, got {describe_word(cursor.take_word())}")
    _read_brace(cursor, keyword, line)
    offset: list[float] = []
    channels: list[str] | None = None
    while not offset or channels is None:
        word = cursor.take_keyword()
        if word == b"OFFSET" and not offset:
            offset = _read_offset(cursor)
        elif word == b"CHANNELS" and channels is None:
            if not offset:
                cursor.tolerate("channels first", "CHANNELS before OFFSET")
            channels = _read_channels(cursor, name)
        else:
            expected = "CHANNELS" if offset else "OFFSET"
            cursor.fail(f"expected {expected}, got {describe_word(word)}")
    return _Joint(name, position, offset, tuple(channels))


def _read_channels(cursor: Cursor, joint: bytes) -> list[str]:
    count = cursor.take_count("the number of channels")
    channels: list[str] = []
    for _ in range(count):
        word = cursor.take_word()
        name = _CHANNEL_OF_WORD.get(word.lower())
        if name is None:
            expected = f"{count} channels from {CHANNELS[0]} to {CHANNELS[-1]}"
            owner, got = describe_word(joint), describe_word(word)
            cursor.fail(f"expected {expected} for {owner}, got {got} after {len(channels)}")
        if name in channels:
            cursor.fail(f"expected each channel of {describe_word(joint)} once, got {name} again")
        if word != name.encode():
            cursor.tolerate("case " + name, f"{describe_word(word)} read as {name}")
        channels.append(name)
    return channels


def _read_end_site(cursor: Cursor) -> tuple[bytes, Position, list[float]]:
    """Read an end site after its keyword End; return its name, position and offset."""
    position = cursor.position()
    keyword = cursor.take(_SITE)
    if keyword is None:
        cursor.fail(f"expected Site after End, got {describe_word(cursor.take_word())}")
    if keyword != b"Site":
        cursor.tolerate("case site", f"End {describe_word(keyword)} read as End Site", position)
    name = _take_name(cursor)
    if name:
        cursor.tolerate("end name", f"End Site with a name, {describe_word(name)}", position)
    _read_brace(cursor, "End Site", position[0])
    cursor.expect(b"OFFSET")
    offset = _read_offset(cursor)
    cursor.expect(b"}")
    return name, position, offset


def _take_name(cursor: Cursor) -> bytes:
    return (cursor.take(_NAME) or b"").strip(b" \t\v\f")


def _read_offset(cursor: Cursor) -> list[float]:
    return [cursor.take_number("a number of OFFSET") for _ in range(3)]


def _read_brace(cursor: Cursor, keyword: str, line: int) -> None:
    cursor.expect(b"{")
    if cursor.position()[0] == line:
        cursor.tolerate("brace", f"'{{' on the line of {keyword}")


def _check_end_sites(cursor: Cursor, tree: _Tree, closed: _Open) -> None:
    """Add a repair if a leaf joint has no end site, or an end site has siblings.

    `closed` is the joint whose block has ended. If the cursor is strict, raise BvhError instead.
    """
    if closed.n_end_sites == (closed.n_children == 0):
        return
    name, position, *_ = tree.joints[closed.joint]
    text = describe_word(name)
    if closed.n_children or closed.n_end_sites:
        cursor.tolerate("end beside", f"{text} has an End Site and other children", position)
    else:
        cursor.tolerate("no end", f"{text} has neither JOINT nor End Site", position)


def _decode_names(
    cursor: Cursor, names: Sequence[bytes], positions: Sequence[Position]
) -> tuple[str, ...]:
    """Decode all names as UTF-8, or as Windows-1252, or as Latin-1: the first that is possible."""
    for encoding in ("utf-8", "cp1252", "latin-1"):
        try:
            decoded = tuple([name.decode(encoding) for name in names])
        except UnicodeDecodeError:
            continue
        if encoding != "utf-8":
            pairs = zip(names, positions, strict=True)
            position = next(position for name, position in pairs if not name.isascii())
            cursor.tolerate("encoding", f"names are not UTF-8; read as {encoding}", position)
        return decoded
    raise AssertionError("Latin-1 must decode any bytes")


def _check_names(cursor: Cursor, names: Sequence[str], positions: Sequence[Position]) -> None:
    """List repeated names and names that contain white space as repairs.

    If the cursor is strict, raise BvhError instead.
    """
    known: set[str] = set()
    for name, position in zip(names, positions, strict=True):
        if " " in name or "\t" in name:
            cursor.tolerate("blank name", f"a space in the name {name!r}", position)
        if name in known:
            cursor.tolerate("repeated name", f"the name {name!r} is repeated", position)
        known.add(name)
