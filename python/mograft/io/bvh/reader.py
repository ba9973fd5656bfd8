"""Reading and scanning of BVH files.

A deviation from the format with only one possible meaning is tolerated and listed as a repair, or
is an error if `strict`. Ambiguous text raises `BvhError`.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray
from mograft.io.bvh.cursor import BvhFile, open_cursor
from mograft.io.bvh.frames import count_frames, read_frames
from mograft.io.bvh.header import read_header
from mograft.io.clips import ClipLength, Clips, single_clip
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, Skeleton

_CODES = {name: code for code, name in enumerate(CHANNELS)}
"""Codes of channels: the axis, plus 3 if it is a rotation."""


@dataclass(frozen=True, eq=False)
class BvhSummary(ClipLength):
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

    path: str
    skeleton: Skeleton
    declared_frames: int
    repairs: tuple[str, ...]

    @property
    def counts_agree(self) -> bool:
        """Whether the number of frames found equals the number that the file declares."""
        return self.n_frames == self.declared_frames


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
