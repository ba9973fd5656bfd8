"""Reading and scanning of BVH files.

A deviation from the format with only one possible meaning is tolerated and listed as a repair, or
is an error if `strict`. Ambiguous text raises `BvhError`.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.io.bvh.cursor import (
    BvhFile,
    Cursor,
    describe_number,
    describe_word,
    match_end,
    open_cursor,
)
from mograft.io.bvh.header import Header, read_header
from mograft.io.clips import Clips, single_clip
from mograft.motion.limits import check_frames
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, Skeleton

_CODES = {name: code for code, name in enumerate(CHANNELS)}
"""Codes of channels: the axis, plus 3 if it is a rotation."""

# Numbers read at a time after the declared number of frames.
_BLOCK_LENGTH = 1 << 15
_PADDING = re.compile(rb"[\0\x1a \t-\r]*")


@dataclass(frozen=True, eq=False)
class BvhSummary:
    """Skeleton, length and repairs of a BVH file, without the motion.

    Parameters
    ----------
    n_frames : int
        The number of frames found.
    frame_time : float
        Seconds from one frame to the next.
    path : str
        The file, or a name for the stream that was read.
    skeleton : Skeleton
        Joints, end sites and channels.
    declared_frames : int
        The number of frames that the file declares.
    repairs : tuple of str
        The deviations that were tolerated, each with its line.
    """

    n_frames: int
    frame_time: float
    path: str
    skeleton: Skeleton
    declared_frames: int
    repairs: tuple[str, ...]


def read_bvh(source: BvhFile, *, strict: bool = False, add_offsets: bool = False) -> Motion:
    """Read a motion from a BVH file.

    Parameters
    ----------
    source : path or file object
        The file: a path, or an open text or binary file. White space and line ends may be of any
        kind.
    strict : bool
        Whether to raise an error for the deviations that `Motion.repairs` otherwise lists.
    add_offsets : bool
        Whether position channels are added to OFFSET, as in three.js. By default they replace it,
        as in Blender. The sums become the channel values of the motion: when the motion is written,
        programs that replace OFFSET read the file correctly.

    Returns
    -------
    Motion
        The motion, named after the file without its suffix. It has all frames found, even if the
        file declares another number. Without `add_offsets`, `Motion.channel_values` holds the
        numbers of the file, so that `write_bvh` reproduces them. Quaternions do not change sign
        from frame to frame.

    Raises
    ------
    BvhError
        If the file is not valid BVH; the message gives path, line, column and expected text.
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
    with open_cursor(source, strict=strict) as cursor:
        header = read_header(cursor)
        values = read_frames(cursor, header)
    rotations, positions = channels_to_transforms(header.skeleton, values, add_offsets=add_offsets)
    # The name of an open file may not be a path; that of standard input is "<stdin>".
    path = Path(cursor.label) if os.path.exists(cursor.label) else None
    return Motion(
        header.skeleton,
        header.frame_time,
        rotations,
        positions,
        channel_values=values,
        name="" if path is None else path.stem,
        path=path,
        repairs=cursor.repairs(),
    )


def scan_bvh(source: BvhFile, *, strict: bool = False) -> BvhSummary:
    """Check a BVH file as `read_bvh` does, and return a summary.

    The memory does not grow with the number of frames.

    Parameters
    ----------
    source, strict
        As for `read_bvh`.

    Returns
    -------
    BvhSummary
        Skeleton, length and repairs.

    Raises
    ------
    BvhError, OSError
        As for `read_bvh`.

    Examples
    --------
    >>> import io
    >>> from mograft.dancer import dance
    >>> from mograft.io.bvh.writer import write_bvh
    >>> file = io.BytesIO()
    >>> write_bvh(dance(strides=1).motion[:90], file)
    >>> _ = file.seek(0)
    >>> summary = scan_bvh(file)
    >>> summary.n_frames, summary.skeleton.n_joints
    (90, 18)
    """
    with open_cursor(source, strict=strict) as cursor:
        header = read_header(cursor)
        n_frames = count_frames(cursor, header)
    return BvhSummary(
        path=cursor.label,
        skeleton=header.skeleton,
        frame_time=header.frame_time,
        n_frames=n_frames,
        declared_frames=header.n_frames,
        repairs=cursor.repairs(),
    )


def open_bvh(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clip of a BVH file; see `mograft.io.formats.Opener`."""
    return single_clip(path, "BVH", lambda: read_bvh(path), rate)


def channels_to_transforms(
    skeleton: Skeleton, values: FloatArray, *, add_offsets: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Convert channel values, shape (n_frames, n_channels), to local rotations and positions.

    Angles are in degrees, intrinsic, in the order of a joint's channels. Rotations, xyzw, have
    shape (n_frames, n_joints, 4) and do not change sign from frame to frame. Positions, shape
    (n_frames, n_joints, 3), are relative to the parent. A coordinate that has no channel is that of
    the joint's offset. If `add_offsets`, the offsets are first added to the position channels; this
    changes `values` in place.
    """
    counts = [len(channels) for channels in skeleton.channels]
    joints = np.repeat(np.arange(skeleton.n_joints), counts)
    codes = np.array([_CODES[name] for channels in skeleton.channels for name in channels], int)
    axes, is_rotation = codes % 3, codes >= 3
    moved = np.flatnonzero(~is_rotation)
    joint, axis = joints[moved], axes[moved]
    positions = np.empty((len(values), skeleton.n_joints, 3))
    positions[:] = skeleton.offsets
    if add_offsets:
        values[:, moved] += skeleton.offsets[joint, axis]
    positions[:, joint, axis] = values[:, moved]
    turned = np.flatnonzero(is_rotation)
    starts = np.searchsorted(joints[turned], np.arange(skeleton.n_joints + 1))
    turns = list(zip(axes[turned].tolist(), turned.tolist(), strict=True))
    return _core.from_channels(values, starts.tolist(), turns, np.pi / 180.0), positions


def read_frames(cursor: Cursor, header: Header) -> FloatArray:
    """Read the channel values, shape (n_frames, n_channels)."""
    lines, width = _LineCheck(cursor, header), header.skeleton.n_channels
    # A number takes at least two bytes: the size of the file limits the memory that the declared
    # number of frames can claim.
    values = np.empty(max(min(header.n_frames * width, cursor.file_bytes // 2), width))
    filled = _read_numbers(cursor, lines, values)
    while filled == len(values):
        more = np.empty(max(len(values), _BLOCK_LENGTH))
        added = _read_numbers(cursor, lines, more)
        if not added:
            break
        values = np.concatenate([values, more])
        filled += added
    n_frames, numbers_per_frame = lines.finish()
    if filled < len(values):
        values = values[:filled].copy()
    return np.ascontiguousarray(values.reshape(n_frames, numbers_per_frame)[:, :width])


def count_frames(cursor: Cursor, header: Header) -> int:
    """Return the number of frames; check the numbers as `read_frames` does."""
    lines, scratch = _LineCheck(cursor, header), np.empty(_BLOCK_LENGTH)
    while _read_numbers(cursor, lines, scratch):
        pass
    n_frames, _ = lines.finish()
    return n_frames


def _read_numbers(cursor: Cursor, lines: "_LineCheck", out: FloatArray) -> int:
    """Read numbers into `out` until it is full or the file ends; return how many were read.

    Pass the line ends between them to `lines`.
    """
    filled = 0
    while True:
        n_values, n_bytes, line_ends, is_invalid = _core.scan_numbers(
            cursor.buffer, cursor.offset, out[filled:], last=cursor.is_at_end
        )
        cursor.move(n_bytes, len(line_ends))
        filled += n_values
        lines.add(line_ends, n_values)
        if is_invalid:
            _check_padding(cursor)
            return filled
        if filled == len(out) or cursor.is_at_end:
            return filled
        if cursor.has_lookahead:
            # The scan stops at a number that may continue in the next chunk. This one is too long.
            cursor.take_word()
        cursor.read_chunk()


def _check_padding(cursor: Cursor) -> None:
    """Raise BvhError for the word at the cursor, which is not a number.

    If only padding (NUL, control-Z and white space) follows up to the end of the file, tolerate it.
    """
    word = cursor.take_word()
    if word[:1] in (b"\0", b"\x1a"):
        position = cursor.position()
        cursor.move_back()
        while (end := match_end(_PADDING, cursor.buffer, cursor.offset)) == len(cursor.buffer):
            cursor.offset = end
            if cursor.is_at_end:
                cursor.tolerate("padding", "NUL or control bytes after the numbers", position)
                return
            cursor.read_chunk()
        cursor.fail(f"expected a number, got {describe_word(word)}", position)
    if word.upper() in (b"HIERARCHY", b"ROOT", b"MOTION"):
        cursor.fail(f"expected a number, got {describe_word(word)}: a file holds one motion")
    cursor.fail(f"expected a number, got {describe_number(word)}")


class _LineCheck:
    """Check that the line ends fit the frames.

    Usually, each line holds one frame. These layouts are valid, too, if the file has as many
    frames as it declares:

    - several whole frames on a line;
    - a frame that continues on the next lines, where the next frame starts on a new line;
    - the same count of numbers on all lines, except fewer on the last, whatever the frames;
    - one line per frame with the same count of surplus numbers at its end, which are ignored.

    In any other layout a number is missing or surplus, and all later numbers would be assigned to
    wrong channels.
    """

    def __init__(self, cursor: Cursor, header: Header) -> None:
        cursor.skip_white_space()
        self._cursor = cursor
        self._header = header
        self._width = header.skeleton.n_channels
        self._line = cursor.position()[0]
        # Numbers on the lines before the current one, and on the current line so far.
        self._n_numbers, self._n_on_line = 0, 0
        # Line on which the last frame starts.
        self._frame_line = self._line
        # First line that holds a part of a frame; several frames; parts of two frames; 0 if none.
        self._wrapped_line = self._joined_line = self._straddling_line = 0
        self._straddling_message = ""
        # Whether all lines hold as many numbers as the first, except for a shorter last line.
        self._first_count, self._is_uniform, self._has_short_line = 0, True, False

    def add(self, line_ends: IntArray, n_values: int) -> None:
        """Add `n_values` numbers and the line ends between them.

        `line_ends` holds for each line end how many of these numbers precede it.
        """
        if not len(line_ends):
            self._n_on_line += n_values
            return
        counts = np.diff(line_ends, prepend=0)
        counts[0] += self._n_on_line
        self._n_on_line = n_values - int(line_ends[-1])
        not_blank = np.flatnonzero(counts)
        lines = self._line + not_blank
        self._line += len(counts)
        if len(lines):
            self._check_lines(lines, counts[not_blank])

    def finish(self) -> tuple[int, int]:
        """Complete the check after the last number; return the counts of frames and of numbers.

        The second result is the count of numbers per frame: one per channel, or more if the lines
        have surplus numbers.
        """
        self.add(np.array([0]), 0)
        cursor, declared, width = self._cursor, self._header.n_frames, self._width
        if not self._n_numbers and not declared:
            cursor.fail("expected at least 1 frame, got Frames: 0", self._header.frames_position)
        if not self._n_numbers:
            cursor.skip_white_space()
            word = describe_word(cursor.take_word())
            cursor.fail(f"expected {declared} frames, got {word}")
        n_frames, n_left = divmod(self._n_numbers, width)
        try:
            check_frames(n_frames)
        except ValueError as error:
            cursor.fail(str(error), self._header.frames_position)
        is_declared = self._n_numbers == declared * width
        position = (self._straddling_line or self._wrapped_line or self._joined_line, 1)
        if self._straddling_line and self._has_surplus():
            message = f"{self._first_count} numbers on each line for {width} channels"
            cursor.tolerate("surplus", f"{message}; the last ones are ignored", position)
            return declared, self._first_count
        if self._straddling_line and not is_declared:
            cursor.fail(self._straddling_message, position)
        if n_left:
            message = f"expected {width} numbers in the last frame, got {n_left}"
            cursor.fail(message, (self._frame_line, 1))
        if position[0] and not is_declared:
            message = f"expected {declared} frames of {width} numbers, one on each line"
            cursor.fail(f"{message}, got {n_frames} frames on lines of other lengths", position)
        if self._straddling_line:
            cursor.tolerate("lines", "frames continue across line ends", position)
        elif self._wrapped_line:
            cursor.tolerate("lines", "a frame wrapped over lines", position)
        elif self._joined_line:
            cursor.tolerate("lines", "several frames on one line", position)
        if n_frames < declared and cursor.ends_in_word():
            message = f"expected {declared} frames, got {n_frames} and no line end after the last"
            cursor.fail(f"{message}: its last number may be incomplete", (self._frame_line, 1))
        if not is_declared:
            message = f"{declared} frames declared, {n_frames} found and used"
            cursor.tolerate("frames", message, self._header.frames_position)
        return n_frames, width

    def _has_surplus(self) -> bool:
        """Return whether each declared frame is one line with surplus numbers at its end."""
        is_exact = self._is_uniform and not self._has_short_line
        return (
            is_exact
            and self._first_count > self._width
            and self._n_numbers == self._header.n_frames * self._first_count > self._first_count
        )

    def _check_lines(self, lines: IntArray, counts: IntArray) -> None:
        """Check lines that are not blank: `lines` are their numbers, `counts` those of values."""
        width, n_before = self._width, self._n_numbers
        self._n_numbers += int(counts.sum())
        self._first_count = self._first_count or int(counts[0])
        starts_frame = n_before % width == 0
        is_regular = self._first_count == width and not self._has_short_line and starts_frame
        if is_regular and (counts == width).all():
            self._frame_line = int(lines[-1])
            return
        self._check_uniformity(counts)
        phases = (n_before + np.cumsum(counts) - counts) % width
        starts = phases == 0
        frame_lines = np.maximum.accumulate(np.where(starts, lines, self._frame_line))
        self._frame_line = int(frame_lines[-1])
        self._wrapped_line = self._wrapped_line or _first(lines, starts & (counts < width))
        self._joined_line = self._joined_line or _first(lines, starts & (counts > width))
        straddling = np.where(starts, counts % width, np.maximum(phases + counts - width, 0))
        straddling[starts & (counts < width)] = 0
        if not self._straddling_line and straddling.any():
            k = int(np.flatnonzero(straddling)[0])
            self._straddling_line = int(frame_lines[k])
            got = str(counts[k])
            if not starts[k]:
                got = f"{phases[k]} and then {counts[k]} on line {lines[k]}"
            self._straddling_message = f"expected a frame of {width} numbers, got {got}"
        if self._straddling_line and not self._is_uniform:
            self._cursor.fail(self._straddling_message, (self._straddling_line, 1))

    def _check_uniformity(self, counts: IntArray) -> None:
        different = np.flatnonzero(counts != self._first_count)
        if self._has_short_line or (len(different) and different[0] < len(counts) - 1):
            self._is_uniform = False
        elif len(different):
            self._has_short_line = True
            self._is_uniform = self._is_uniform and bool(counts[-1] < self._first_count)


def _first(lines: IntArray, selected: npt.NDArray[np.bool_]) -> int:
    """Return the first of `lines` for which `selected` is true; 0 if there is none."""
    return int(lines[selected.argmax()]) if selected.any() else 0
