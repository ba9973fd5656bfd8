"""Parsing of a BVH file up to its first frame: the hierarchy and the two lines of MOTION."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mograft.io.bvh.cursor import Cursor, Position, describe_word
from mograft.motion.skeleton import CHANNELS, EndSite, Skeleton

# Patterns for `Cursor.take`: one group, followed by white space.
_NAME = re.compile(rb"([^\r\n{]*)[ \t-\r]*")
_SITE = re.compile(rb"(site(?=[ \t-\r{]|\Z))[ \t-\r]*", re.IGNORECASE)
_FRAMES = re.compile(rb"(frames[ \t-\r]*:?)[ \t-\r]*", re.IGNORECASE)
_MAX_JOINTS = 1 << 16
"""Joints of a file: some seconds of reading, and far more than any figure has."""

_FRAME_TIME = re.compile(rb"(frames?[ \t-\r]*time[ \t-\r]*:?)[ \t-\r]*", re.IGNORECASE)

_CHANNEL_OF_WORD = {name.lower().encode(): name for name in CHANNELS}


@dataclass(frozen=True)
class Header:
    """The part of a BVH file before its first frame."""

    skeleton: Skeleton
    n_frames: int  # as declared
    frames_position: Position  # of the declared number in the file
    frame_time: float  # seconds


@dataclass
class _Joint:
    name: bytes
    parent: int
    position: Position
    offset: list[float] = field(default_factory=list)
    channels: list[str] | None = None
    n_children: int = 0
    n_end_sites: int = 0


@dataclass(frozen=True)
class _Site:
    parent: int
    before: int
    name: bytes
    position: Position
    offset: list[float]


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
            if frame_time <= 0:
                cursor.fail(f"expected a frame time above 0 seconds, got {frame_time:g}")
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
    """Tolerate a label that is misspelt or not followed by white space; list it as a repair.

    If the cursor is strict, raise BvhError instead.
    """
    words = b" ".join(label.split())
    text = describe_word(words)
    if words != expected:
        cursor.tolerate("label " + text, f"{text!r} read as {describe_word(expected)!r}")
    elif cursor.buffer[cursor.offset - 1 : cursor.offset] == b":":
        cursor.tolerate("label blank", f"no space after {text!r}")


def _read_hierarchy(cursor: Cursor) -> Skeleton:
    cursor.expect(b"HIERARCHY")
    cursor.expect(b"ROOT")
    joints = [_read_joint(cursor, "ROOT", -1)]
    sites: list[_Site] = []
    # Indices of the joints whose braces are open. An explicit stack reads chains that are deeper
    # than Python's recursion limit.
    stack = [0]
    while stack:
        joint = joints[stack[-1]]
        word = cursor.take_keyword()
        if word == b"JOINT":
            if len(joints) == _MAX_JOINTS:
                cursor.fail(f"expected at most {_MAX_JOINTS} joints, got more")
            joint.n_children += 1
            stack.append(len(joints))
            joints.append(_read_joint(cursor, "JOINT", stack[-2]))
        elif word == b"End":
            sites.append(_read_end_site(cursor, stack[-1], joint.n_children))
            joint.n_end_sites += 1
        elif word == b"}":
            _check_end_sites(cursor, joint)
            stack.pop()
        else:
            cursor.fail(
                f"expected JOINT, End Site or the }} of {describe_word(joint.name)} "
                f"(line {joint.position[0]}), got {describe_word(word)}"
            )
    names = _decode_names(cursor, [(joint.name, joint.position) for joint in joints])
    site_names = _decode_names(cursor, [(site.name, site.position) for site in sites])
    _check_names(cursor, names, [joint.position for joint in joints])
    return Skeleton(
        tuple(names),
        np.array([joint.parent for joint in joints]),
        np.array([joint.offset for joint in joints]),
        tuple(tuple(joint.channels or ()) for joint in joints),
        tuple(
            EndSite(site.parent, np.array(site.offset), site.before, name)
            for site, name in zip(sites, site_names, strict=True)
        ),
    )


def _read_joint(cursor: Cursor, keyword: str, parent: int) -> _Joint:
    """Read a joint from its name up to its channels; the keyword ROOT or JOINT has been read."""
    line = cursor.position()[0]
    name = _take_name(cursor)
    position = cursor.position()
    if not name:
        cursor.fail(f"expected a name after {keyword}, got {describe_word(cursor.take_word())}")
    _read_brace(cursor, keyword, line)
    joint = _Joint(name, parent, position)
    while not joint.offset or joint.channels is None:
        word = cursor.take_keyword()
        if word == b"OFFSET" and not joint.offset:
            joint.offset = _read_offset(cursor)
        elif word == b"CHANNELS" and joint.channels is None:
            if not joint.offset:
                cursor.tolerate("channels first", "CHANNELS before OFFSET")
            joint.channels = _read_channels(cursor, name)
        else:
            expected = "CHANNELS" if joint.offset else "OFFSET"
            cursor.fail(f"expected {expected}, got {describe_word(word)}")
    return joint


def _read_channels(cursor: Cursor, joint: bytes) -> list[str]:
    count = cursor.take_count("the number of channels")
    channels: list[str] = []
    for _ in range(count):
        word = cursor.take_word()
        name = _CHANNEL_OF_WORD.get(word.lower())
        if name is None:
            cursor.fail(
                f"expected {count} channels from {CHANNELS[0]} to {CHANNELS[-1]} for "
                f"{describe_word(joint)}, got {describe_word(word)} after {len(channels)}"
            )
        if name in channels:
            cursor.fail(f"expected each channel of {describe_word(joint)} once, got {name} again")
        if word != name.encode():
            cursor.tolerate("case " + name, f"{describe_word(word)} read as {name}")
        channels.append(name)
    return channels


def _read_end_site(cursor: Cursor, parent: int, before: int) -> _Site:
    """Read an end site after its keyword End.

    `before` is the number of children of the joint `parent` that precede the end site.
    """
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
    return _Site(parent=parent, before=before, name=name, position=position, offset=offset)


def _take_name(cursor: Cursor) -> bytes:
    return (cursor.take(_NAME) or b"").strip(b" \t\v\f")


def _read_offset(cursor: Cursor) -> list[float]:
    return [cursor.take_number("a number of OFFSET") for _ in range(3)]


def _read_brace(cursor: Cursor, keyword: str, line: int) -> None:
    cursor.expect(b"{")
    if cursor.position()[0] == line:
        cursor.tolerate("brace", f"'{{' on the line of {keyword}")


def _check_end_sites(cursor: Cursor, joint: _Joint) -> None:
    """Tolerate a leaf joint without end site, or an end site with siblings; list it as a repair.

    If the cursor is strict, raise BvhError instead.
    """
    text = describe_word(joint.name)
    if not joint.n_children and not joint.n_end_sites:
        cursor.tolerate("no end", f"{text} has neither JOINT nor End Site", joint.position)
    if joint.n_end_sites > 1 or (joint.n_children and joint.n_end_sites):
        cursor.tolerate("end beside", f"{text} has an End Site and other children", joint.position)


def _decode_names(cursor: Cursor, names: Sequence[tuple[bytes, Position]]) -> list[str]:
    """Decode names as UTF-8 or, if one of them is invalid, all as Windows-1252 or Latin-1."""
    for encoding in ("utf-8", "cp1252", "latin-1"):
        try:
            decoded = [name.decode(encoding) for name, _ in names]
        except UnicodeDecodeError:
            continue
        if encoding != "utf-8":
            position = next(position for name, position in names if not name.isascii())
            cursor.tolerate("encoding", f"names are not UTF-8; read as {encoding}", position)
        return decoded
    raise AssertionError("unreachable: Latin-1 decodes any bytes")


def _check_names(cursor: Cursor, names: Sequence[str], positions: Sequence[Position]) -> None:
    """Tolerate repeated names and names that contain white space; list them as repairs.

    If the cursor is strict, raise BvhError instead.
    """
    known: set[str] = set()
    for name, position in zip(names, positions, strict=True):
        if " " in name or "\t" in name:
            cursor.tolerate("blank name", f"a space in the name {name!r}", position)
        if name in known:
            cursor.tolerate("twin name", f"the name {name!r} is repeated", position)
        known.add(name)
