"""Reading of BVH files.

A deviation from the format with only one possible meaning is tolerated and listed as a repair, or
is an error if `strict`. Ambiguous text raises `BvhError`.
"""

import os
import re
from pathlib import Path

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.errors import BvhError
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

_PADDING = re.compile(rb"[\0\x1a \t-\r]*")


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
    cursor = open_cursor(source, strict=strict)
    header = read_header(cursor)
    values = read_frames(cursor, header)
    label, repairs = cursor.label, cursor.repairs()
    del cursor  # and its text, before the transforms need memory
    rotations, positions = channels_to_transforms(header.skeleton, values, add_offsets=add_offsets)
    # The name of an open file may not be a path; that of standard input is "<stdin>".
    path = Path(label) if os.path.exists(label) else None
    try:
        return Motion(
            header.skeleton,
            header.frame_time,
            rotations,
            positions,
            channel_values=values,
            name="" if path is None else path.stem,
            path=path,
            repairs=repairs,
        )
    except ValueError as error:  # a coordinate is too large
        raise BvhError(str(error), label) from error


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
    width, text = header.skeleton.n_channels, cursor.text
    cursor.skip_white_space()
    # A number takes at least two bytes: the size of the file limits the memory that the declared
    # number of frames can claim.
    capacity = min(header.n_frames * width, len(text) // 2)
    values, lines, counts, n_bytes, is_invalid = _core.scan_numbers(text, cursor.offset, capacity)
    lines += cursor.line_and_column(cursor.offset)[0]
    cursor.offset += n_bytes
    if is_invalid:
        has_ended = lines < cursor.line_and_column(cursor.offset)[0]
        _find_layout(cursor, width, lines[has_ended], counts[has_ended])
        _check_padding(cursor)
    n_frames, numbers_per_frame = _check_lines(cursor, header, lines, counts)
    rows = values[: n_frames * numbers_per_frame].reshape(n_frames, numbers_per_frame)
    return np.ascontiguousarray(rows[:, :width])


def _check_padding(cursor: Cursor) -> None:
    """Raise BvhError for the word at the cursor, which is not a number.

    If only padding (NUL, control-Z and white space) follows up to the end of the file, tolerate it.
    """
    word, start = cursor.take_word(), cursor.word_start
    if word[:1] in (b"\0", b"\x1a"):
        if match_end(_PADDING, cursor.text, start) < len(cursor.text):
            cursor.fail(f"expected a number, got {describe_word(word)}")
        cursor.tolerate("padding", "NUL or control bytes after the numbers", start)
        return
    if word.upper() in (b"HIERARCHY", b"ROOT", b"MOTION"):
        cursor.fail(f"expected a number, got {describe_word(word)}: a file holds one motion")
    cursor.fail(f"expected a number, got {describe_number(word)}")


def _find_layout(
    cursor: Cursor, width: int, lines: IntArray, counts: IntArray
) -> tuple[str, int, str]:
    """Return how frames of `width` numbers lie on lines; `counts` are the numbers on each.

    The result is the text of a repair, the first line of the first frame that needs it, and, if
    frames end inside lines, the text of an error. Texts are empty if there is nothing to state.

    Usually, each line holds one frame. These layouts are valid, too, if the file has as many
    frames as it declares:

    - several whole frames on a line;
    - a frame that continues on the next lines, where the next frame starts on a new line;
    - the same count of numbers on all lines, except fewer on the last, whatever the frames;
    - one line per frame with the same count of surplus numbers at its end, which are ignored.

    In any other layout a number is missing or surplus, and all later numbers would be assigned to
    wrong channels. Raises BvhError if frames end inside lines of different lengths.
    """
    n_before = (np.cumsum(counts) - counts) % width  # numbers of the frame on earlier lines
    starts = n_before == 0
    is_deviation = {
        "frames continue across line ends": (n_before + counts > width)
        & ~(starts & (counts % width == 0)),
        "a frame wrapped over lines": starts & (counts < width),
        "several frames on one line": starts & (counts > width),
    }
    found = [repair for repair, own in is_deviation.items() if own.any()]
    if not found:
        return "", 0, ""
    repair = found[0]
    first = int(is_deviation[repair].argmax())
    line = int(lines[: first + 1][starts[: first + 1]][-1])
    if repair != "frames continue across line ends":
        return repair, line, ""
    got = str(counts[first])
    if n_before[first]:
        got = f"{n_before[first]} and then {got} on line {lines[first]}"
    error = f"expected a frame of {width} numbers, got {got}"
    if (counts[:-1] != counts[0]).any() or counts[-1] > counts[0]:
        cursor.fail(error, line=line)
    return repair, line, error


def _check_lines(
    cursor: Cursor, header: Header, lines: IntArray, counts: IntArray
) -> tuple[int, int]:
    """Return the number of frames and of numbers for each, which may be more than the channels.

    `lines` are those that are not blank, `counts` the numbers on each. Raises BvhError if a number
    is missing or surplus; see `_find_layout`.
    """
    declared, width, n_numbers = header.n_frames, header.skeleton.n_channels, int(counts.sum())
    if not n_numbers and not declared:
        cursor.fail("expected at least 1 frame, got Frames: 0", header.frames_place)
    if not n_numbers:
        cursor.skip_white_space()
        word = describe_word(cursor.take_word())
        cursor.fail(f"expected {declared} frames, got {word}")
    repair, line, error = _find_layout(cursor, width, lines, counts)
    n_frames, n_left = divmod(n_numbers, width)
    try:
        check_frames(n_frames)
    except ValueError as too_many:
        cursor.fail(str(too_many), header.frames_place)
    is_declared = n_numbers == declared * width
    n_on_each = int(counts[0])
    if error and n_on_each > width and (counts == n_on_each).all() and declared == len(counts) > 1:
        message = f"{n_on_each} numbers on each line for {width} channels"
        cursor.tolerate("surplus", f"{message}; the last ones are ignored", line=line)
        return declared, n_on_each
    if error and not is_declared:
        cursor.fail(error, line=line)
    last = int(lines[(np.cumsum(counts) - counts) % width == 0][-1])  # where the last frame starts
    if n_left:
        message = f"expected {width} numbers in the last frame, got {n_left}"
        cursor.fail(message, line=last)
    if repair and not is_declared:
        message = f"expected {declared} frames of {width} numbers, one on each line"
        cursor.fail(f"{message}, got {n_frames} frames on lines of other lengths", line=line)
    if repair:
        cursor.tolerate("lines", repair, line=line)
    # The text may end in white space or padding, or in a word.
    if n_frames < declared and cursor.text[-1:] not in b"\0\x1a \t\n\v\f\r":
        message = f"expected {declared} frames, got {n_frames} and no line end after the last"
        cursor.fail(f"{message}: its last number may be incomplete", line=last)
    if not is_declared:
        message = f"{declared} frames declared, {n_frames} found and used"
        cursor.tolerate("frames", message, header.frames_place)
    return n_frames, width
