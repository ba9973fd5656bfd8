"""Writing of BVH files."""

import os
import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.atomic import atomic_path
from mograft._util.validate import check_type, is_integer
from mograft.io.bvh.cursor import BvhFile
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

MAX_DECIMALS = 12
"""Largest number of decimals to which angles are rounded.

The spacing of float64 numbers near 180 is 3e-14.
"""

_SAMPLE_LENGTH = 4096  # numbers of which the decimals are counted, about
_SHARE = 0.9  # of the numbers, which the result must reproduce
_MAX_SCALED = 2.0**53  # integers below this are exact

# Numbers that are formatted at a time.
_BLOCK_LENGTH = 1 << 15
# Deeper levels are not indented further: a chain of thousands of joints would be mostly tabs.
_MAX_INDENTATION = 40
_FRAMES_WITH_DECIMALS = 4096  # about as many frames are searched for the number of decimals
_MIN_DECIMALS = 6  # of computed angles, if `digits` is not given
# Names that the format cannot represent. Lone surrogates (category Cs) cannot be encoded.
_UNSUITABLE = re.compile(r"[\r\n{\ud800-\udfff]|^[ \t\v\f]|[ \t\v\f]\Z")


def write_bvh(motion: Motion, target: BvhFile, *, digits: int | None = None) -> None:
    """Write a motion to a BVH file.

    Names, hierarchy, offsets, end sites, channels and frame time are those of the motion. A
    number that was read from a file and not changed since is written with the same value. Other
    angles are computed from the rotation, in the channel order of the joint: the Euler angles
    nearest to those of the previous frame, rounded to `digits` decimals. All other numbers have
    the fewest digits that reproduce them exactly. An existing file is replaced atomically.

    Parameters
    ----------
    motion : Motion
        The motion.
    target : path or file object
        The destination; an open file may be text or binary.
    digits : int, optional
        Decimals of computed angles, in degrees, from 1 to 12. Default: the number of decimals of
        the angles that were read from the file, at least 6 and at most 12; 6 if no angle was read.

    Raises
    ------
    ValueError
        If `digits` is not an integer from 1 to 12, or if the format cannot represent the motion:
        the name of a joint is empty; the name of a joint or end site contains a line end, ``{`` or
        a lone surrogate, or starts or ends with white space; or the skeleton has no channel.
    TypeError
        If `motion` is not a motion, or `target` is neither a path nor a file object.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import io
    >>> skeleton = Skeleton(["Hips"], [-1], [[0, 0, 0]], [["Yrotation"]])
    >>> motion = Motion(skeleton, 0.5, [[[0, 0, 0, 1]]] * 2, [[[0, 0, 0]]] * 2)
    >>> file = io.StringIO()
    >>> write_bvh(motion, file)
    >>> file.getvalue().splitlines()[-5:]
    ['MOTION', 'Frames: 2', 'Frame Time: 0.5', '0.0', '0.0']
    """
    check_type("motion", motion, Motion)
    blocks = _format_blocks(motion, None if digits is None else check_digits(digits))
    if not isinstance(target, str | os.PathLike):
        if not hasattr(target, "write"):
            kind = type(target).__name__
            raise TypeError(f"`target` must be a path or a file object, got {kind}")
        is_text = _is_text_file(target)
        for block in blocks:
            target.write(block.decode() if is_text else block)
        return
    path = Path(target)
    if path.exists() and not path.is_file():
        # A pipe or a device cannot be replaced.
        with path.open("wb") as stream:
            stream.writelines(blocks)
        return
    with atomic_path(path) as draft, draft.open("xb") as stream:
        stream.writelines(blocks)


def _format_blocks(motion: Motion, digits: int | None) -> Iterator[bytes]:
    """Yield the text of a file: the header, then blocks of frames."""
    skeleton = motion.skeleton
    if not skeleton.n_channels:
        raise ValueError("the skeleton must have at least one channel in a BVH file, got none")
    _check_names(skeleton)
    header, joints = _format_hierarchy(skeleton)
    timing = f"MOTION\nFrames: {motion.n_frames}\nFrame Time: {motion.frame_time!r}\n"
    yield "\n".join([*header, timing]).encode()
    is_angle = np.zeros(skeleton.n_channels, bool)
    is_angle[list(chain(*skeleton.rotation_columns))] = True
    if digits is None:
        digits = max(_count_read_decimals(motion, is_angle), _MIN_DECIMALS)
    columns: slice | list[int] = slice(None)
    if joints != sorted(joints):
        columns = [column for joint in joints for column in skeleton.channel_columns[joint]]
    start = 0
    for numbers in motion.channel_blocks(max(_BLOCK_LENGTH // skeleton.n_channels, 8)):
        is_rounded = is_angle & motion.is_computed(numbers, start)
        start += len(numbers)
        numbers[is_rounded] = round_numbers(numbers[is_rounded], digits)
        yield _core.format_rows(np.ascontiguousarray(numbers[:, columns]))


def _count_read_decimals(motion: Motion, is_angle: BoolArray) -> int:
    """Return the number of decimals of the angles that were read from a file; 0 if none were."""
    if motion.channel_values is None:
        return 0
    frames = slice(None, None, max(1, motion.n_frames // _FRAMES_WITH_DECIMALS))
    values = motion.channel_values[frames]
    is_read = np.broadcast_to(is_angle, values.shape)
    if motion.computed_values is not None:
        is_read = is_read & ~motion.computed_values[frames]
    return count_decimals(values[is_read])


def _check_names(skeleton: Skeleton) -> None:
    if "" in skeleton.names:
        joint = skeleton.names.index("")
        raise ValueError(f"joint {joint} must have a name in a BVH file, got an empty name")
    joints = [(f"joint {index}", name) for index, name in enumerate(skeleton.names)]
    tips = [(f"the end site of {skeleton.names[s.parent]}", s.name) for s in skeleton.end_sites]
    for owner, name in joints + tips:
        if _UNSUITABLE.search(name):
            rule = "a line end, '{' or a lone surrogate, or start or end with white space"
            raise ValueError(
                f"in a BVH file, the name of {owner} must not contain {rule}; got {name!r}"
            )


def _format_hierarchy(skeleton: Skeleton) -> tuple[list[str], list[int]]:
    """Return the lines of the hierarchy, and the joint indices in the order of these lines.

    An item of the first list may hold several lines.
    """
    lines, order = ["HIERARCHY"], list[int]()
    below = skeleton.children_and_sites
    # An explicit stack of joints, end sites and, as None, closing lines still to be written:
    # chains may be deeper than Python's recursion limit.
    stack: list[int | EndSite | None] = [0]
    depth, kind = 0, "ROOT"
    while stack:
        item = stack.pop()
        if item is None:
            depth -= 1
            lines.append("\t" * min(depth, _MAX_INDENTATION) + "}")
            continue
        tab = "\t" * min(depth, _MAX_INDENTATION)
        if isinstance(item, EndSite):
            title = f"End Site {item.name}".rstrip(" ")
            lines.append(f"{tab}{title}\n{tab}{{\n{tab}\t{_offset(item.offset)}\n{tab}}}")
            continue
        own = skeleton.channels[item]
        lines.append(
            f"{tab}{kind} {skeleton.names[item]}\n{tab}{{\n"
            f"{tab}\t{_offset(skeleton.offsets[item])}\n"
            f"{tab}\t{' '.join(['CHANNELS', str(len(own)), *own])}"
        )
        order.append(item)
        depth, kind = depth + 1, "JOINT"
        stack.append(None)
        stack += reversed(below[item])
    return lines, order


def _offset(offset: FloatArray) -> str:
    return " ".join(["OFFSET", *map(repr, offset.tolist())])


def _is_text_file(stream: IO[Any]) -> bool:
    try:
        stream.write(b"")
    except TypeError:
        return True
    return False


def check_digits(digits: object) -> int:
    """Return `digits` as an int; raise ValueError unless it is an integer from 1 to 12."""
    if not is_integer(digits) or not 1 <= digits <= MAX_DECIMALS:
        raise ValueError(f"`digits` must be an integer from 1 to {MAX_DECIMALS}, got {digits!r}")
    return int(digits)


def round_numbers(numbers: FloatArray, digits: int) -> FloatArray:
    """Return numbers rounded to `digits` decimals, without negative zeros.

    Numbers of at least 2**53 / 10**digits are returned unchanged: float64 numbers of this size have
    no more decimals.
    """
    scale = 10.0**digits
    is_small = np.abs(numbers) < _MAX_SCALED / scale
    scaled = np.rint(np.where(is_small, numbers, 0.0) * scale)
    return np.where(is_small, scaled / scale + 0.0, numbers)


def count_decimals(numbers: FloatArray) -> int:
    """Return how many decimals the numbers of a text were written with, at most 12.

    This is the smallest number of decimals that reproduces nine tenths of the numbers that are not
    integers. The other tenth may have been written with exponents. NaN is ignored. The result is 0
    if all numbers are integers. Of more than about 4,096 numbers, only a sample is examined.
    """
    flat = numbers.ravel()
    sample = flat[:: max(1, len(flat) // _SAMPLE_LENGTH)]
    sample = sample[np.isfinite(sample) & (sample != np.rint(sample))]
    for digits in range(MAX_DECIMALS):
        if (round_numbers(sample, digits) == sample).sum() >= _SHARE * len(sample):
            return digits
    return MAX_DECIMALS
