"""BVH files: text to Motion and back.

Reading is lenient about layout and strict about meaning. White space, blank lines and line
ends are free. What else is tolerated stands in `Motion.repairs` with its line, and
``strict=True`` refuses it; what has no clear meaning is a `BvhError` with its place. The
numbers as read stay in `Motion.channel_values`, so that a motion written again has them
digit for digit.

The file's angles are degrees, turned in the order of its channels, each about the axes
already turned; here alone they become quaternions. A position channel is the joint's place
relative to its parent and stands for that component of OFFSET, as in Blender; other tools
(three.js, fairmotion) add the two.
"""

import codecs
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NoReturn, TypeAlias

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.atomic import atomic_path
from mograft._util.validate import check_type
from mograft.errors import BvhError
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, EndSite, Skeleton

__all__ = ["BvhSummary", "read_bvh", "scan_bvh", "write_bvh"]

Source: TypeAlias = str | os.PathLike[str] | IO[Any]

# Bytes read at a time: what is held of the text, whatever the file's size; few enough to
# stay in the cache.
_PIECE = 1 << 18
# No word or name of a BVH file is this long; so far ahead is looked.
_AHEAD = 1 << 16
# Numbers turned into text, or looked through, at a time.
_BLOCK = 1 << 15
# Levels of indentation written: a chain of thousands of joints would be mostly tabs.
_DEEPEST = 40

# The marks that may stand before a text, and what it is then.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}

_WHITE = re.compile(rb"[ \t-\r]*")
# Each takes one group, and the white space after it.
_WORD = re.compile(rb"([^ \t-\r{}]+|[{}])[ \t-\r]*")
_NAME = re.compile(rb"([^\r\n{]*)[ \t-\r]*")
_COMMENT = re.compile(rb"((?:#|//)[^\r\n]*)[ \t-\r]*")
_SITE = re.compile(rb"(site(?=[ \t-\r{]|\Z))[ \t-\r]*", re.IGNORECASE)
_FRAMES = re.compile(rb"(frames[ \t-\r]*:?)[ \t-\r]*", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"(frames?[ \t-\r]*time[ \t-\r]*:?)[ \t-\r]*", re.IGNORECASE)
_PADDING = re.compile(rb"[\0\x1a \t-\r]*")
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NAN = re.compile(rb"[+-]?(?:nan.*|1\.?#(?:ind|[qs]?nan).*)", re.IGNORECASE)
_INFINITY = re.compile(rb"[+-]?(?:inf(?:inity)?|1\.?#inf.*)", re.IGNORECASE)
_COMMA = re.compile(rb"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?")

_CHANNEL_OF = {name.lower().encode(): name for name in CHANNELS}
_KEYWORDS = {
    word.upper(): word
    for word in (b"HIERARCHY", b"ROOT", b"JOINT", b"End", b"OFFSET", b"CHANNELS", b"MOTION")
}

_Place: TypeAlias = tuple[int, int]


@dataclass(frozen=True, eq=False)
class BvhSummary:
    """What a BVH file holds, without the motion itself.

    Parameters
    ----------
    path : str
        The file, or a name for what was read instead of one.
    skeleton : Skeleton
        Its joints and channels.
    frame_time : float
        Seconds from one frame to the next.
    n_frames : int
        Frames found.
    declared_frames : int
        Frames that the file says it has.
    repairs : tuple of str
        What was tolerated in the file, each with its place.
    """

    path: str
    skeleton: Skeleton
    frame_time: float
    n_frames: int
    declared_frames: int
    repairs: tuple[str, ...]

    @property
    def rate(self) -> float:
        """Frames per second."""
        return 1.0 / self.frame_time

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (self.n_frames - 1) * self.frame_time

    @property
    def counts_agree(self) -> bool:
        """Whether the file has as many frames as it says."""
        return self.n_frames == self.declared_frames


def read_bvh(source: Source, *, strict: bool = False, add_offsets: bool = False) -> Motion:
    """Read a motion from a BVH file.

    Parameters
    ----------
    source : path or file object
        The file; an open one may be text or binary.
    strict : bool
        Refuse whatever `Motion.repairs` would list.
    add_offsets : bool
        Add position channels to OFFSET instead of putting them in its place. The sums are
        then the motion's channel values, so that it is written in the way of the default.

    Returns
    -------
    Motion
        Its name is the file's without ending. It has all frames found, whatever number the
        file declares, and quaternions that do not change sign from frame to frame.

    Raises
    ------
    BvhError
        If the file is no BVH motion: with path, line and column, and what was expected.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import io
    >>> text = '''HIERARCHY
    ... ROOT Hips { OFFSET 0 0 0 CHANNELS 1 Yrotation End Site { OFFSET 0 9 0 } }
    ... MOTION
    ... Frames: 2
    ... Frame Time: 0.5
    ... 0
    ... 90
    ... '''
    >>> motion = read_bvh(io.StringIO(text))
    >>> motion
    Motion(1 joint, 2 frames, 2 fps, 0.50 s)
    >>> motion.repairs
    ("line 2: '{' on the line of ROOT (and 1 more like it)",)
    >>> read_bvh(io.StringIO(text.replace("90", "9O")))
    Traceback (most recent call last):
    mograft.errors.BvhError: <stream>:7:1: expected a number, got 9O
    """
    with _opened(source, strict=strict) as text:
        head = _read_head(text)
        values = _read_values(text, head)
    skeleton = head.skeleton
    rotated, placed = poses(skeleton, values, add_offsets=add_offsets)
    # An open file may bear the name of none, as standard input does.
    path = Path(text.label) if os.path.exists(text.label) else None
    return Motion(
        skeleton,
        head.frame_time,
        rotated,
        placed,
        channel_values=values,
        name="" if path is None else path.stem,
        path=path,
        repairs=text.repairs(),
    )


def scan_bvh(source: Source, *, strict: bool = False) -> BvhSummary:
    """Read through a BVH file and say what it holds; as strict as `read_bvh`.

    Memory does not grow with the number of frames.

    Parameters
    ----------
    source : path or file object
        The file; an open one may be text or binary.
    strict : bool
        Refuse whatever the summary's `repairs` would list.

    Returns
    -------
    BvhSummary
        What it holds.

    Raises
    ------
    BvhError
        If the file is no BVH motion: with path, line and column, and what was expected.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import io
    >>> from mograft.dancer import dance
    >>> file = io.BytesIO()
    >>> write_bvh(dance(strides=1).motion[:90], file)
    >>> _ = file.seek(0)
    >>> summary = scan_bvh(file)
    >>> summary.n_frames, summary.skeleton.n_joints
    (90, 18)
    """
    with _opened(source, strict=strict) as text:
        head = _read_head(text)
        lines, scratch = _Lines(text, head), np.empty(_BLOCK)
        while _fill(text, lines, scratch):
            pass
        n_frames, _ = lines.end()
    return BvhSummary(
        text.label, head.skeleton, head.frame_time, n_frames, head.n_frames, text.repairs()
    )


def write_bvh(motion: Motion, target: Source) -> None:
    r"""Write a motion to a BVH file.

    Names, hierarchy, offsets, end sites, channels and frame time are those of the motion.
    Numbers are those read where they are known, else the rotation in the joint's own order,
    each angle as near to the frame before as can be; all have the fewest digits that give
    them back exactly. A file already there is replaced in one step, once all is written.

    Parameters
    ----------
    motion : Motion
        The motion.
    target : path or file object
        Where to write; an open file may be text or binary.

    Raises
    ------
    ValueError
        If the format cannot hold the motion: a name that is empty, or has a line end, ``{``
        or outer blanks, or no channel at all.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import io
    >>> skeleton = Skeleton(["Hips"], [-1], [[0, 0, 0]], [["Yrotation"]])
    >>> motion = Motion(skeleton, 0.5, [[[0, 0, 0, 1]]] * 2, [[[0, 0, 0]]] * 2)
    >>> file = io.StringIO()
    >>> write_bvh(motion, file)
    >>> print(file.getvalue().replace("\t", "  "))
    HIERARCHY
    ROOT Hips
    {
      OFFSET 0.0 0.0 0.0
      CHANNELS 1 Yrotation
    }
    MOTION
    Frames: 2
    Frame Time: 0.5
    0.0
    0.0
    <BLANKLINE>
    """
    check_type("motion", motion, Motion)
    pieces = _written(motion)
    if not isinstance(target, str | os.PathLike):
        if not hasattr(target, "write"):
            kind = type(target).__name__
            raise TypeError(f"target must be a path or a file object, got {kind}")
        as_text = _takes_text(target)
        for piece in pieces:
            target.write(piece.decode() if as_text else piece)
        return
    path = Path(target)
    if path.exists() and not path.is_file():
        # A pipe or a device cannot be replaced.
        with path.open("wb") as stream:
            stream.writelines(pieces)
        return
    with atomic_path(path) as draft, draft.open("xb") as stream:
        stream.writelines(pieces)


# Text, a piece at a time.


class _Text:
    """The text of a file as UTF-8, a piece at a time, and the place reached in it."""

    def __init__(self, stream: IO[Any], label: str, *, strict: bool) -> None:
        self.label = label
        self.strict = strict
        self.buffer = b""
        self.at = 0
        self.ended = False
        self.size = _size(stream)
        self._stream = stream
        self._decoder: codecs.IncrementalDecoder | None = None
        self._repairs: dict[str, _Repair] = {}
        # Lines are counted up to here, where this line goes on, after so many characters.
        self._counted, self._line, self._column = 0, 1, 1
        self._token = 0
        start = self._raw()
        while len(start) < 4 and (more := self._raw()):
            start += more
        for mark, encoding in _MARKS.items():
            if start.startswith(mark):
                start = start[len(mark) :]
                if encoding != "utf-8":
                    self._decoder = codecs.getincrementaldecoder(encoding)()
                self.tolerate("mark", f"a byte-order mark: the text is {encoding.upper()}")
        self.buffer = self._decoded(start)
        if self.buffer.endswith(b"\r"):
            self.fill()
        self.skip_white()

    def fill(self) -> None:
        """Read on; what lies behind is forgotten."""
        self._count_to(self.at)
        pieces, size = [self.buffer[self.at :]], 0
        self._token -= self.at
        self._counted = self.at = 0
        # A CR that ends a piece waits for the LF that may follow.
        while size < _PIECE or pieces[-1].endswith(b"\r"):
            piece = self._raw()
            if not piece:
                self.ended = True
                pieces.append(self._decoded(b"", final=True))
                break
            size += len(piece)
            pieces.append(self._decoded(piece))
        self.buffer = b"".join(pieces)

    def _raw(self) -> bytes:
        piece = self._stream.read(_PIECE) or b""
        return piece.encode("utf-8", "surrogatepass") if isinstance(piece, str) else bytes(piece)

    def _decoded(self, piece: bytes, *, final: bool = False) -> bytes:
        if self._decoder is None:
            return piece
        try:
            return str(self._decoder.decode(piece, final)).encode()
        except UnicodeError as error:
            self.fail(f"expected text, got broken bytes: {error}")

    def skip_white(self) -> None:
        """Go on to the next word, and see that it is in the buffer as a whole."""
        while True:
            self.at = _end(_WHITE, self.buffer, self.at)
            if self.ended or len(self.buffer) - self.at >= _AHEAD:
                self._token = self.at
                return
            self.fill()

    def take(self, pattern: re.Pattern[bytes]) -> bytes | None:
        """Take what the pattern's group matches, if it does, and the white space after it."""
        self._look_ahead()
        self._token = self.at
        found = pattern.match(self.buffer, self.at)
        if found is None:
            return None
        if found.end(1) - self.at >= _AHEAD:
            self.fail(f"expected a word, got more than {_AHEAD} characters without an end")
        self.at = found.end()
        return found.group(1)

    def _look_ahead(self) -> None:
        if not self.ended and len(self.buffer) - self.at < _AHEAD:
            self.skip_white()

    def give_back(self) -> None:
        """Go back to the word taken last."""
        self.at = self._token

    def word(self) -> bytes:
        """Take the next word or brace; empty at the end of the file."""
        return self.take(_WORD) or b""

    def keyword(self) -> bytes:
        """Take the next word, a keyword in its own spelling."""
        self.skip_comments()
        word = self.word()
        wanted = _KEYWORDS.get(word.upper())
        if wanted is None:
            return word
        if word != wanted:
            self.tolerate(f"case {wanted!r}", f"{_shown(word)} read as {_shown(wanted)}")
        return wanted

    def skip_comments(self) -> None:
        """Go on to the next word that begins no comment."""
        self._look_ahead()
        while self.buffer.startswith((b"#", b"//"), self.at):
            self.take(_COMMENT)
            self.tolerate("comment", "a comment")

    def place(self) -> _Place:
        """Line and column of the word taken last, from 1."""
        self._count_to(self._token)
        return self._line, self._column

    def fail(self, message: str, place: _Place | None = None) -> NoReturn:
        """Refuse the file, at the word taken last or another place."""
        line, column = place or self.place()
        raise BvhError(message, self.label, line, column)

    def tolerate(self, kind: str, message: str, place: _Place | None = None) -> None:
        """List what is tolerated, the first of a kind in full."""
        where = place or self.place()
        if self.strict:
            self.fail(f"{message}: refused as strict", where)
        known = self._repairs.get(kind)
        if known is None:
            self._repairs[kind] = _Repair(where[0], message)
        else:
            known.more += 1

    def go_on(self, size: int, lines: int) -> None:
        """Go on by so many bytes of ASCII that are known to hold so many line ends."""
        self._count_to(self.at)
        end = self.at + size
        if lines:
            last = max(self.buffer.rfind(mark, self.at, end) for mark in (b"\n", b"\r"))
            self._line, self._column = self._line + lines, end - last
        else:
            self._column += size
        self.at = self._counted = end

    def repairs(self) -> tuple[str, ...]:
        """Return what was tolerated, in the order of lines."""
        ordered = sorted(self._repairs.values(), key=lambda repair: repair.line)
        return tuple(map(str, ordered))

    def _count_to(self, at: int) -> None:
        if at <= self._counted:
            return
        passed = self.buffer[self._counted : at]
        lines = passed.count(b"\n") + passed.count(b"\r") - passed.count(b"\r\n")
        if lines:
            self._line += lines
            self._column = 1
            passed = passed[max(passed.rfind(b"\n"), passed.rfind(b"\r")) + 1 :]
        self._column += len(passed.decode("utf-8", "replace"))
        self._counted = at


@dataclass
class _Repair:
    line: int
    message: str
    more: int = 0

    def __str__(self) -> str:
        more = f" (and {self.more} more like it)" if self.more else ""
        return f"line {self.line}: {self.message}{more}"


def _end(pattern: re.Pattern[bytes], buffer: bytes, at: int) -> int:
    """Return where a pattern that matches anywhere stops matching."""
    found = pattern.match(buffer, at)
    return at if found is None else found.end()


@contextmanager
def _opened(source: Source, *, strict: bool) -> Iterator[_Text]:
    if isinstance(source, str | os.PathLike):
        with open(source, "rb", buffering=0) as stream:
            yield _Text(stream, os.fspath(source), strict=strict)
    elif hasattr(source, "read"):
        name = getattr(source, "name", None)
        yield _Text(source, name if isinstance(name, str) else "<stream>", strict=strict)
    else:
        raise TypeError(f"source must be a path or a file object, got {type(source).__name__}")


def _size(stream: IO[Any]) -> int:
    """Return the bytes of a file; a guess where there is none."""
    try:
        return os.fstat(stream.fileno()).st_size
    except (AttributeError, OSError):
        return _PIECE


def _shown(word: bytes) -> str:
    """Return a word as a message shows it."""
    if not word:
        return "the end of the file"
    text = word.decode("utf-8", "replace")
    text = text if len(text) <= 40 else text[:40] + "..."
    return text if text.isprintable() else ascii(text)


def _explained(token: bytes) -> str:
    """Say what stands where a number should."""
    shown = _shown(token)
    first = _end(_NUMBER, token, 0)
    if _NAN.fullmatch(token) or _INFINITY.fullmatch(token):
        return f"{shown}, which is no finite number"
    if first and first == len(token):
        return f"{shown}, which is too large for a double"
    if _COMMA.fullmatch(token):
        return f"{shown} with a decimal comma, where a point is needed"
    if b"_" in token and _NUMBER.fullmatch(token.replace(b"_", b"")):
        return f"{shown} with an underscore"
    if first and _NUMBER.match(token, first):
        return f"glued numbers, {shown}: a blank is missing before {_shown(token[first:])}"
    return shown


# The parts before the numbers.


@dataclass
class _Joint:
    name: bytes
    parent: int
    place: _Place
    offset: list[float] = field(default_factory=list)
    channels: list[str] | None = None
    children: int = 0
    end_sites: int = 0


@dataclass(frozen=True)
class _Head:
    skeleton: Skeleton
    n_frames: int
    frames_place: _Place
    frame_time: float


def _read_head(text: _Text) -> _Head:
    """Read all that stands before the first number of the first frame."""
    skeleton = _read_hierarchy(text)
    if not skeleton.n_channels:
        text.fail("expected a channel in some joint, got none in the whole hierarchy")
    _expect(text, b"MOTION")
    n_frames, frame_time, frames_place = None, None, (1, 1)
    while n_frames is None or frame_time is None:
        text.skip_comments()
        if frame_time is None and (label := text.take(_FRAME_TIME)) is not None:
            _check_label(text, label, b"Frame Time:")
            frame_time = _read_number(text, "the frame time in seconds")
            if frame_time <= 0:
                text.fail(f"expected a frame time above 0 seconds, got {frame_time:g}")
            if n_frames is None:
                text.tolerate("order", "Frame Time before Frames")
        elif n_frames is None and (label := text.take(_FRAMES)) is not None:
            _check_label(text, label, b"Frames:")
            n_frames = _read_count(text, "the number of frames")
            frames_place = text.place()
        else:
            wanted = "Frames:" if n_frames is None else "Frame Time:"
            text.fail(f"expected {wanted}, got {_shown(text.word())}")
    return _Head(skeleton, n_frames, frames_place, frame_time)


def _check_label(text: _Text, label: bytes, wanted: bytes) -> None:
    found = _shown(b" ".join(label.split()))
    if b" ".join(label.split()) != wanted:
        text.tolerate("label " + found, f"{found!r} read as {_shown(wanted)!r}")
    elif text.buffer[text.at - 1 : text.at] == b":":
        text.tolerate("label blank", f"no blank after {found!r}")


def _read_hierarchy(text: _Text) -> Skeleton:
    _expect(text, b"HIERARCHY")
    _expect(text, b"ROOT")
    joints = [_read_joint(text, "ROOT", -1)]
    end_sites: list[tuple[int, list[float], int, bytes, _Place]] = []
    # The joints whose braces are open; a stack, for chains deeper than Python may recurse.
    inside = [0]
    while inside:
        joint = joints[inside[-1]]
        word = text.keyword()
        if word == b"JOINT":
            joint.children += 1
            inside.append(len(joints))
            joints.append(_read_joint(text, "JOINT", inside[-2]))
        elif word == b"End":
            place, name, offset = _read_end_site(text)
            end_sites.append((inside[-1], offset, joint.children, name, place))
            joint.end_sites += 1
        elif word == b"}":
            _check_ends(text, joint)
            inside.pop()
        else:
            text.fail(
                f"expected JOINT, End Site or the }} of {_shown(joint.name)} "
                f"(line {joint.place[0]}), got {_shown(word)}"
            )
    names = _decoded_names(text, [(joint.name, joint.place) for joint in joints])
    site_names = _decoded_names(text, [(name, place) for *_, name, place in end_sites])
    _note_names(text, names, [joint.place for joint in joints])
    return Skeleton(
        tuple(names),
        np.array([joint.parent for joint in joints]),
        np.array([joint.offset for joint in joints]),
        tuple(tuple(joint.channels or ()) for joint in joints),
        tuple(
            EndSite(parent, np.array(offset), before, name)
            for (parent, offset, before, *_), name in zip(end_sites, site_names, strict=True)
        ),
    )


def _read_joint(text: _Text, kind: str, parent: int) -> _Joint:
    line = text.place()[0]
    name = (text.take(_NAME) or b"").strip(b" \t\v\f")
    place = text.place()
    if not name:
        text.fail(f"expected a name after {kind}, got {_shown(text.word())}")
    _read_brace(text, kind, line)
    joint = _Joint(name, parent, place)
    while not joint.offset or joint.channels is None:
        word = text.keyword()
        if word == b"OFFSET" and not joint.offset:
            joint.offset = [_read_number(text, "a number of OFFSET") for _ in range(3)]
        elif word == b"CHANNELS" and joint.channels is None:
            if not joint.offset:
                text.tolerate("channels first", "CHANNELS before OFFSET")
            joint.channels = _read_channels(text, name)
        else:
            wanted = "CHANNELS" if joint.offset else "OFFSET"
            text.fail(f"expected {wanted}, got {_shown(word)}")
    return joint


def _read_channels(text: _Text, joint: bytes) -> list[str]:
    count = _read_count(text, "the number of channels")
    channels: list[str] = []
    for _ in range(count):
        word = text.word()
        name = _CHANNEL_OF.get(word.lower())
        if name is None:
            text.fail(
                f"expected {count} channels from {CHANNELS[0]} to {CHANNELS[-1]} for "
                f"{_shown(joint)}, got {_shown(word)} after {len(channels)}"
            )
        if name in channels:
            text.fail(f"expected each channel of {_shown(joint)} once, got {name} again")
        if word != name.encode():
            text.tolerate("case " + name, f"{_shown(word)} read as {name}")
        channels.append(name)
    return channels


def _read_end_site(text: _Text) -> tuple[_Place, bytes, list[float]]:
    place = text.place()
    site = text.take(_SITE)
    if site is None:
        text.fail(f"expected Site after End, got {_shown(text.word())}")
    if site != b"Site":
        text.tolerate("case site", f"End {_shown(site)} read as End Site", place)
    name = (text.take(_NAME) or b"").strip(b" \t\v\f")
    if name:
        text.tolerate("end name", f"End Site with a name, {_shown(name)}", place)
    _read_brace(text, "End Site", place[0])
    _expect(text, b"OFFSET")
    offset = [_read_number(text, "a number of OFFSET") for _ in range(3)]
    _expect(text, b"}")
    return place, name, offset


def _read_brace(text: _Text, kind: str, line: int) -> None:
    _expect(text, b"{")
    if text.place()[0] == line:
        text.tolerate("brace", f"'{{' on the line of {kind}")


def _check_ends(text: _Text, joint: _Joint) -> None:
    shown = _shown(joint.name)
    if not joint.children and not joint.end_sites:
        text.tolerate("no end", f"{shown} has neither JOINT nor End Site", joint.place)
    if joint.end_sites > 1 or (joint.children and joint.end_sites):
        text.tolerate("end beside", f"{shown} has End Sites beside others", joint.place)


def _decoded_names(text: _Text, names: Sequence[tuple[bytes, _Place]]) -> list[str]:
    """Decode names: as UTF-8, or else all alike in Windows' or ISO's Latin alphabet."""
    for encoding in ("utf-8", "cp1252", "latin-1"):
        try:
            decoded = [name.decode(encoding) for name, _ in names]
        except UnicodeDecodeError:
            continue
        if encoding != "utf-8":
            place = next(place for name, place in names if not name.isascii())
            text.tolerate("encoding", f"names are not UTF-8; read as {encoding}", place)
        return decoded
    raise AssertionError("any bytes are latin-1")


def _note_names(text: _Text, names: Sequence[str], places: Sequence[_Place]) -> None:
    seen: set[str] = set()
    for name, place in zip(names, places, strict=True):
        if " " in name or "\t" in name:
            text.tolerate("blank name", f"a blank in the name {name!r}", place)
        if name in seen:
            text.tolerate("twin name", f"the name {name!r} again", place)
        seen.add(name)


def _expect(text: _Text, wanted: bytes) -> None:
    word = text.keyword()
    if word == wanted:
        return
    if wanted == b"MOTION" and word == b"ROOT":
        text.fail("expected MOTION, got a second ROOT: a motion has one skeleton with one root")
    text.fail(f"expected {_shown(wanted)}, got {_shown(word)}")


def _read_number(text: _Text, what: str) -> float:
    word = text.word()
    value = float(word) if _NUMBER.fullmatch(word) else np.inf
    if not np.isfinite(value):
        text.fail(f"expected {what}, got {_explained(word)}")
    return value


def _read_count(text: _Text, what: str) -> int:
    word = text.word()
    value = float(word) if _NUMBER.fullmatch(word) else np.inf
    if not value.is_integer() or value < 0 or value >= 2**53:
        text.fail(f"expected {what}, got {_explained(word) if value == np.inf else _shown(word)}")
    if not word.isdigit():
        text.tolerate("count", f"{_shown(word)} read as {int(value)}")
    return int(value)


# The numbers.


class _Lines:
    """The check that the ends of lines fit the frames.

    A line may hold whole frames, or a part of one that is completed on the lines after it;
    or all lines hold the same count of numbers. Anything else is taken for a number too
    few or too many, since a reader that went on would be wrong from there. Where lines are
    not simply frames, the declared number of frames has to be right. If just so many lines
    hold too many numbers each, what is too much at their ends is left out.
    """

    def __init__(self, text: _Text, head: _Head) -> None:
        text.skip_white()
        self._text = text
        self._head = head
        self._width = head.skeleton.n_channels
        self._line = text.place()[0]
        # Numbers before the line being read, and those on it so far.
        self._before, self._on_line = 0, 0
        # Where the last frame begins.
        self._frame_line = self._line
        # The first line that holds part of a frame, several, or parts of two.
        self._wrapped = self._joined = self._across = 0
        self._across_message = ""
        # Whether all lines hold as many numbers as the first, but for a shorter last one.
        self._first_count, self._alike, self._shorter = 0, True, False

    def note(self, line_ends: IntArray, values: int) -> None:
        """Take in how many of the numbers just read stand before each line end."""
        if not len(line_ends):
            self._on_line += values
            return
        counts = np.diff(line_ends, prepend=0)
        counts[0] += self._on_line
        self._on_line = values - int(line_ends[-1])
        lines = np.flatnonzero(counts)
        numbers = self._line + lines
        self._line += len(counts)
        if len(lines):
            self._check(numbers, counts[lines])

    def end(self) -> tuple[int, int]:
        """Check the whole once all is read; return how many frames of how many numbers."""
        self.note(np.array([0]), 0)
        text, declared, width = self._text, self._head.n_frames, self._width
        if not self._before:
            text.skip_white()
            text.fail(f"expected {max(declared, 1)} frames, got {_shown(text.word())}")
        n_frames, left = divmod(self._before, width)
        all_fit = self._before == declared * width
        place = (self._across or self._wrapped or self._joined, 1)
        if self._across and self._each_line_is_a_frame():
            message = f"{self._first_count} numbers on each line for {width} channels"
            text.tolerate("surplus", f"{message}; the last ones are left out", place)
            return declared, self._first_count
        if self._across and not all_fit:
            text.fail(self._across_message, place)
        if left:
            message = f"expected {width} numbers in the last frame, got {left}"
            text.fail(message, (self._frame_line, 1))
        if place[0] and not all_fit:
            message = f"expected {declared} frames of {width} numbers, one on each line, got other"
            text.fail(f"{message} lines and {n_frames} frames", place)
        if self._across:
            text.tolerate("lines", "frames run on across line ends", place)
        elif self._wrapped:
            text.tolerate("lines", "a frame wrapped over lines", place)
        elif self._joined:
            text.tolerate("lines", "frames joined in one line", place)
        if not all_fit:
            message = f"{declared} frames declared, {n_frames} found and used"
            text.tolerate("frames", message, self._head.frames_place)
        return n_frames, width

    def _each_line_is_a_frame(self) -> bool:
        """Whether lines, but not their numbers, are as many as the frames declared."""
        exact = self._alike and not self._shorter and self._first_count > self._width
        return exact and self._before == self._head.n_frames * self._first_count > self._first_count

    def _check(self, lines: IntArray, counts: IntArray) -> None:
        width, before = self._width, self._before
        self._before += int(counts.sum())
        self._first_count = self._first_count or int(counts[0])
        plain = self._first_count == width and not self._shorter and before % width == 0
        if plain and (counts == width).all():
            self._frame_line = int(lines[-1])
            return
        unlike = np.flatnonzero(counts != self._first_count)
        if self._shorter or (len(unlike) and unlike[0] < len(counts) - 1):
            self._alike = False
        elif len(unlike):
            self._shorter = True
            self._alike = self._alike and bool(counts[-1] < self._first_count)
        phases = (before + np.cumsum(counts) - counts) % width
        starts = phases == 0
        begun = np.maximum.accumulate(np.where(starts, lines, self._frame_line))
        self._frame_line = int(begun[-1])
        self._wrapped = self._wrapped or _first(lines, starts & (counts < width))
        self._joined = self._joined or _first(lines, starts & (counts > width))
        across = np.where(starts, counts % width, np.maximum(phases + counts - width, 0))
        across[starts & (counts < width)] = 0
        if not self._across and across.any():
            k = int(np.flatnonzero(across)[0])
            self._across = int(begun[k])
            self._across_message = f"expected a frame of {width} numbers, got {counts[k]}"
            if not starts[k]:
                self._across_message = (
                    f"expected a frame of {width} numbers, got {phases[k]} and then "
                    f"{counts[k]} on line {lines[k]}"
                )
        if self._across and not self._alike:
            self._text.fail(self._across_message, (self._across, 1))


def _first(lines: IntArray, marked: npt.NDArray[np.bool_]) -> int:
    return int(lines[marked.argmax()]) if marked.any() else 0


def _fill(text: _Text, lines: _Lines, out: FloatArray) -> int:
    """Read numbers into `out` until it is full or the file ends; return how many."""
    filled = 0
    while True:
        values, used, line_ends, bad = _core.scan_numbers(
            text.buffer, text.at, out[filled:], last=text.ended
        )
        text.go_on(used, len(line_ends))
        filled += values
        lines.note(line_ends, values)
        if bad:
            _refuse_token(text)
            return filled
        if filled == len(out) or text.ended:
            return filled
        if len(text.buffer) - text.at >= _AHEAD:
            # Left is what may go on in the next piece; this is a number without end.
            text.word()
        text.fill()


def _refuse_token(text: _Text) -> None:
    """Refuse what is no number, unless it only fills up the file after the last one."""
    word = text.word()
    if word[:1] in (b"\0", b"\x1a"):
        place = text.place()
        text.give_back()
        while (at := _end(_PADDING, text.buffer, text.at)) == len(text.buffer):
            text.at = at
            if text.ended:
                text.tolerate("padding", "NUL or control bytes after the numbers", place)
                return
            text.fill()
        text.fail(f"expected a number, got {_shown(word)}", place)
    if word.upper() in (b"HIERARCHY", b"ROOT", b"MOTION"):
        text.fail(f"expected a number, got {_shown(word)}: a file holds one motion")
    text.fail(f"expected a number, got {_explained(word)}")


def _read_values(text: _Text, head: _Head) -> FloatArray:
    """Read the numbers, shape (n_frames, n_channels)."""
    lines, width = _Lines(text, head), head.skeleton.n_channels
    # A number takes two bytes: a count that the file cannot bear is not believed.
    values = np.empty(max(min(head.n_frames * width, text.size // 2), width))
    filled = _fill(text, lines, values)
    while filled == len(values):
        more = np.empty(max(len(values), _BLOCK))
        added = _fill(text, lines, more)
        if not added:
            break
        values = np.concatenate([values, more])
        filled += added
    n_frames, length = lines.end()
    if filled < len(values):
        values = values[:filled].copy()
    return np.ascontiguousarray(values.reshape(n_frames, length)[:, :width])


def poses(
    skeleton: Skeleton, values: FloatArray, *, add_offsets: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Turn channel values into rotations and positions.

    With `add_offsets` the offsets are added to the position channels among `values`.
    """
    starts, turns, places = [0], list[tuple[int, int]](), list[tuple[int, int, int]]()
    for joint, columns in enumerate(skeleton.channel_columns):
        for name, column in zip(skeleton.channels[joint], columns, strict=True):
            axis = "XYZ".index(name[0])
            if name.endswith("rotation"):
                turns.append((axis, column))
            else:
                places.append((joint, axis, column))
        starts.append(len(turns))
    placed = np.empty((len(values), skeleton.n_joints, 3))
    placed[:] = skeleton.offsets
    for joint, axis, column in places:
        if add_offsets:
            values[:, column] += skeleton.offsets[joint, axis]
        placed[:, joint, axis] = values[:, column]
    return _core.from_channels(values, starts, turns, np.pi / 180.0), placed


# Writing.


def _written(motion: Motion) -> Iterator[bytes]:
    """Yield the text of a file, some frames at a time."""
    skeleton = motion.skeleton
    if not skeleton.n_channels:
        raise ValueError("the skeleton must have a channel for a motion to be written")
    for what, name in _named(skeleton):
        _check_name(what, name)
    head, joints = _hierarchy(skeleton)
    columns = np.concatenate([skeleton.channel_columns[joint] for joint in joints]).astype(int)
    yield "\n".join(
        [*head, "MOTION", f"Frames: {motion.n_frames}", f"Frame Time: {motion.frame_time!r}", ""]
    ).encode()
    numbers = motion.channel_numbers()
    in_order = bool((np.diff(columns) == 1).all())
    step = max(_BLOCK // skeleton.n_channels, 1)
    for start in range(0, motion.n_frames, step):
        block = numbers[start : start + step]
        yield _core.format_rows(np.ascontiguousarray(block if in_order else block[:, columns]))


def _named(skeleton: Skeleton) -> Iterator[tuple[str, str]]:
    for joint, name in enumerate(skeleton.names):
        if not name:
            raise ValueError(f"joint {joint} must have a name to be written, got none")
        yield f"joint {joint}", name
    for site in skeleton.end_sites:
        yield f"the end site of {skeleton.names[site.parent]}", site.name


def _check_name(what: str, name: str) -> None:
    try:
        encoded = name.encode()
    except UnicodeEncodeError:
        encoded = b"{"
    if name.strip(" \t\v\f") != name or {*b"\r\n{"} & {*encoded}:
        raise ValueError(
            f"the name of {what} must be Unicode without line end, '{{' and outer blanks "
            f"to be written, got {name!r}"
        )


def _hierarchy(skeleton: Skeleton) -> tuple[list[str], list[int]]:
    """Return the lines of the hierarchy, and the joints in their order there."""
    lines, order = ["HIERARCHY"], list[int]()
    # Joints to open and lines to write, last first: no recursion, however deep the chain.
    todo: list[int | EndSite | str] = [0]
    depth = 0
    while todo:
        item = todo.pop()
        if isinstance(item, str):
            depth -= 1
            lines.append("\t" * min(depth, _DEEPEST) + item)
            continue
        indent = "\t" * min(depth, _DEEPEST)
        depth += 1
        todo.append("}")
        if isinstance(item, EndSite):
            title, offset = f"End Site {item.name}".rstrip(" "), item.offset
        else:
            title, offset = (
                ("JOINT " if order else "ROOT ") + skeleton.names[item],
                skeleton.offsets[item],
            )
        lines += [indent + title, indent + "{"]
        lines.append(f"{indent}\tOFFSET {' '.join(map(repr, offset.tolist()))}")
        if isinstance(item, EndSite):
            continue
        channels = skeleton.channels[item]
        lines.append(" ".join([f"{indent}\tCHANNELS", str(len(channels)), *channels]))
        order.append(item)
        todo += reversed(skeleton.children_and_sites[item])
    return lines, order


def _takes_text(stream: IO[Any]) -> bool:
    try:
        stream.write(b"")
    except TypeError:
        return True
    return False
