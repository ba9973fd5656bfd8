"""Writing of BVH files."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray
from mograft._util.atomic import atomic_path
from mograft._util.validate import check_type
from mograft.io.bvh.cursor import BvhFile
from mograft.io.bvh.decimals import check_digits, count_decimals, round_numbers
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

# Numbers that are formatted at a time.
_BLOCK_LENGTH = 1 << 15
# Deeper levels are not indented further: a chain of thousands of joints would be mostly tabs.
_MAX_INDENTATION = 40
_FRAMES_WITH_DECIMALS = 4096  # frames, about, whose decimals are counted
_MIN_DECIMALS = 6  # of computed angles, if `digits` is not given


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
        raise ValueError("the skeleton must have at least one channel to be written, got none")
    _check_names(skeleton)
    header, joints = _format_hierarchy(skeleton)
    columns = np.concatenate([skeleton.channel_columns[joint] for joint in joints]).astype(int)
    yield "\n".join(
        [*header, "MOTION", f"Frames: {motion.n_frames}", f"Frame Time: {motion.frame_time!r}", ""]
    ).encode()
    is_angle = np.zeros(skeleton.n_channels, bool)
    is_angle[[column for turns in skeleton.rotation_columns for column in turns]] = True
    if digits is None:
        digits = max(_count_own_decimals(motion, is_angle), _MIN_DECIMALS)
    is_in_order = bool((np.diff(columns) == 1).all())
    start = 0
    for numbers in motion.channel_blocks(max(_BLOCK_LENGTH // skeleton.n_channels, 1)):
        is_rounded = is_angle & motion.is_computed(numbers, start)
        start += len(numbers)
        numbers[is_rounded] = round_numbers(numbers[is_rounded], digits)
        ordered = numbers if is_in_order else numbers[:, columns]
        yield _core.format_rows(np.ascontiguousarray(ordered))


def _count_own_decimals(motion: Motion, is_angle: BoolArray) -> int:
    """Return the number of decimals of the angles that were read from a file; 0 if none were."""
    if motion.channel_values is None:
        return 0
    frames = slice(None, None, max(1, motion.n_frames // _FRAMES_WITH_DECIMALS))
    own = motion.channel_values[frames]
    is_own = np.broadcast_to(is_angle, own.shape)
    if motion.computed_values is not None:
        is_own = is_own & ~motion.computed_values[frames]
    return count_decimals(own[is_own])


def _check_names(skeleton: Skeleton) -> None:
    owners = [(f"joint {joint}", name) for joint, name in enumerate(skeleton.names)]
    for owner, name in owners:
        if not name:
            raise ValueError(f"{owner} must have a name to be written, got none")
    owners += [(f"the end site of {skeleton.names[s.parent]}", s.name) for s in skeleton.end_sites]
    for owner, name in owners:
        # Lone surrogates (category Cs) cannot be encoded.
        if name.strip(" \t\v\f") != name or re.search("[\r\n{\ud800-\udfff]", name):
            raise ValueError(
                f"the name of {owner} must not contain a line end, '{{' or a lone surrogate, or "
                f"start or end with white space, to be written; got {name!r}"
            )


def _format_hierarchy(skeleton: Skeleton) -> tuple[list[str], list[int]]:
    """Return the lines of the hierarchy, and the joint indices in the order of these lines."""
    lines, order = ["HIERARCHY"], list[int]()
    # An explicit stack of joints, end sites and closing lines still to be written: chains may be
    # deeper than Python's recursion limit.
    stack: list[int | EndSite | str] = [0]
    depth = 0
    while stack:
        item = stack.pop()
        if isinstance(item, str):
            depth -= 1
            lines.append("\t" * min(depth, _MAX_INDENTATION) + item)
            continue
        indent = "\t" * min(depth, _MAX_INDENTATION)
        depth += 1
        stack.append("}")
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
        stack += reversed(skeleton.children_and_sites[item])
    return lines, order


def _is_text_file(stream: IO[Any]) -> bool:
    try:
        stream.write(b"")
    except TypeError:
        return True
    return False
