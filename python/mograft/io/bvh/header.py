"""Parsing of a BVH file up to its first frame: the hierarchy and the two lines of MOTION."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft.io.bvh.cursor import Cursor, describe_word
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
    frames_place: int  # of the declared number in the file
    frame_time: float  # seconds


@dataclass(slots=True)
class _Node:
    """A joint, or an end site, as the file has it."""

    name: bytes
    place: int  # of the name of a joint; of the word after End
    offset: list[float]
    channels: tuple[str, ...] = ()
    parent: int = -1  # index of a joint
    before: int = 0  # of an end site: number of joints of its parent that precede it
    n_children: int = 0
    n_end_sites: int = 0


def read_header(cursor: Cursor) -> Header:
    """Read the part of a file before the first number of the first frame."""
    skeleton = _read_hierarchy(cursor)
    if not skeleton.n_channels:
        cursor.fail("expected at least one channel, got none in the whole hierarchy")
    cursor.expect(b"MOTION")
    n_frames, frame_time, frames_place = None, None, 0
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
            frames_place = cursor.word_start
        else:
            expected = "Frames:" if n_frames is None else "Frame Time:"
            cursor.fail(f"expected {expected}, got {describe_word(cursor.take_word())}")
    return Header(skeleton, n_frames, frames_place, frame_time)


def _check_label(cursor: Cursor, label: bytes, expected: bytes) -> None:
    """List a label that is misspelt or not followed by white space as a repair.

    If the cursor is strict, raise BvhError instead.
    """
    words = b" ".join(label.split())
    text = describe_word(words)
    if words != expected:
        cursor.tolerate("label " + text, f"{text!r} read as {describe_word(expected)!r}")
    elif cursor.text[cursor.offset - 1 : cursor.offset] == b":":
        cursor.tolerate("label blank", f"no space after {text!r}")


_latest: tuple[bytes, Skeleton] | None = None
"""Text and skeleton of the last hierarchy that was read without a repair.

It is used again for a file that begins with the same text, as most files of one database do:
parsing this text takes longer than reading the frames.
"""


def _read_hierarchy(cursor: Cursor) -> Skeleton:
    global _latest
    latest = _latest
    if latest is not None and cursor.skip_text(latest[0]):
        return latest[1]
    start, repairs = cursor.offset, cursor.repairs()
    skeleton = _parse_hierarchy(cursor)
    if cursor.repairs() == repairs:
        _latest = cursor.text[start : cursor.offset], skeleton
    return skeleton


def _parse_hierarchy(cursor: Cursor) -> Skeleton:
    cursor.expect(b"HIERARCHY")
    cursor.expect(b"ROOT")
    joints, sites = [_read_joint(cursor, "ROOT")], list[_Node]()
    opened = [0]  # joints whose brace is open
    while opened:
        above = joints[opened[-1]]
        word = cursor.take_keyword()
        if word == b"JOINT":
            joint = _read_joint(cursor, "JOINT")
            try:
                limits.check_joints(len(joints) + 1)
                limits.check_levels(len(opened) + 1)
            except ValueError as error:
                cursor.fail(str(error), joint.place)
            joint.parent = opened[-1]
            above.n_children += 1
            opened.append(len(joints))
            joints.append(joint)
        elif word == b"End":
            site = _read_end_site(cursor)
            site.parent, site.before = opened[-1], above.n_children
            above.n_end_sites += 1
            sites.append(site)
        elif word == b"}":
            opened.pop()
            _check_end_sites(cursor, above)
        else:
            owner = f"{describe_word(above.name)} (line {cursor.line_and_column(above.place)[0]})"
            expected = f"JOINT, End Site or the }} of {owner}"
            cursor.fail(f"expected {expected}, got {describe_word(word)}")
    return _to_skeleton(cursor, joints, sites)


def _to_skeleton(cursor: Cursor, joints: Sequence[_Node], sites: Sequence[_Node]) -> Skeleton:
    names, site_names = _decode_names(cursor, joints), _decode_names(cursor, sites)
    _check_names(cursor, names, joints)
    pairs, channels = zip(sites, site_names, strict=True), tuple(own.channels for own in joints)
    parents = np.array([own.parent for own in joints])
    offsets = np.array([own.offset for own in joints])
    try:
        tips = [EndSite(own.parent, np.array(own.offset), own.before, name) for own, name in pairs]
        return Skeleton(names, parents, offsets, channels, tuple(tips))
    except ValueError as error:
        cursor.fail(str(error))


def _read_joint(cursor: Cursor, keyword: str) -> _Node:
    """Read a joint from its name up to its channels; the keyword ROOT or JOINT has been read."""
    start = cursor.word_start
    name = _take_name(cursor)
    place = cursor.word_start
    if not name:
        cursor.fail(f"expected a name after {keyword}, got {describe_word(cursor.take_word())}")
    _read_brace(cursor, keyword, start)
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
    return _Node(name, place, offset, tuple(channels))


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


def _read_end_site(cursor: Cursor) -> _Node:
    """Read an end site after its keyword End."""
    start = cursor.word_start
    keyword = cursor.take(_SITE)
    if keyword is None:
        cursor.fail(f"expected Site after End, got {describe_word(cursor.take_word())}")
    if keyword != b"Site":
        cursor.tolerate("case site", f"End {describe_word(keyword)} read as End Site", start)
    name = _take_name(cursor)
    if name:
        cursor.tolerate("end name", f"End Site with a name, {describe_word(name)}", start)
    _read_brace(cursor, "End Site", start)
    cursor.expect(b"OFFSET")
    offset = _read_offset(cursor)
    cursor.expect(b"}")
    return _Node(name, start, offset)


def _take_name(cursor: Cursor) -> bytes:
    return (cursor.take(_NAME) or b"").strip(b" \t\v\f")


def _read_offset(cursor: Cursor) -> list[float]:
    return [cursor.take_number("a number of OFFSET") for _ in range(3)]


def _read_brace(cursor: Cursor, keyword: str, start: int) -> None:
    """Read the brace of a joint or an end site whose keyword begins at `start`."""
    cursor.expect(b"{")
    if len(cursor.text[start : cursor.word_start + 1].splitlines()) == 1:
        cursor.tolerate("brace", f"'{{' on the line of {keyword}")


def _check_end_sites(cursor: Cursor, closed: _Node) -> None:
    """Add a repair if a leaf joint has no end site, or an end site has siblings.

    `closed` is the joint whose block has ended. If the cursor is strict, raise BvhError instead.
    """
    if closed.n_end_sites == (closed.n_children == 0):
        return
    text = describe_word(closed.name)
    if closed.n_children or closed.n_end_sites:
        cursor.tolerate("end beside", f"{text} has an End Site and other children", closed.place)
    else:
        cursor.tolerate("no end", f"{text} has neither JOINT nor End Site", closed.place)


def _decode_names(cursor: Cursor, nodes: Sequence[_Node]) -> tuple[str, ...]:
    """Decode all names as UTF-8, or as Windows-1252, or as Latin-1: the first that is possible."""
    for encoding in ("utf-8", "cp1252", "latin-1"):
        try:
            decoded = tuple([own.name.decode(encoding) for own in nodes])
        except UnicodeDecodeError:
            continue
        if encoding != "utf-8":
            place = next(own.place for own in nodes if not own.name.isascii())
            cursor.tolerate("encoding", f"names are not UTF-8; read as {encoding}", place)
        return decoded
    raise AssertionError("Latin-1 must decode any bytes")


def _check_names(cursor: Cursor, names: Sequence[str], joints: Sequence[_Node]) -> None:
    """List repeated names and names that contain white space as repairs.

    If the cursor is strict, raise BvhError instead.
    """
    known: set[str] = set()
    for name, joint in zip(names, joints, strict=True):
        if " " in name or "\t" in name:
            cursor.tolerate("blank name", f"a space in the name {name!r}", joint.place)
        if name in known:
            cursor.tolerate("repeated name", f"the name {name!r} is repeated", joint.place)
        known.add(name)
