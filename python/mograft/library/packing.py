"""Motions as flat arrays of numbers that restore them bit for bit."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.io.bvh.channels import channels_to_transforms
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["PackedContent", "PackedMotion", "pack", "unpack"]

PackedContent: TypeAlias = Literal["channels", "poses", "both"]


@dataclass(frozen=True, eq=False)
class PackedMotion:
    """A motion as one array of numbers.

    Attributes
    ----------
    content : {"channels", "poses", "both"}
        Whether the numbers are the channels of a file, from which the poses follow; rotations
        and positions; or rotations, positions and channels.
    numbers : ndarray, shape (n,)
        The numbers, one array after the other.
    skeleton : Skeleton
        The clip's skeleton.
    frame_time : float
        Seconds from one frame to the next.
    n_frames : int
        Number of frames.
    name : str
        Name of the motion.
    path : str or None
        The file from which it was read.
    repairs : tuple of str
        Defects of the file that the reader repaired.
    """

    content: PackedContent
    numbers: FloatArray
    skeleton: Skeleton
    frame_time: float
    n_frames: int
    name: str
    path: str | None
    repairs: tuple[str, ...]


def pack(motion: Motion, *, as_read: bool = False) -> PackedMotion:
    """Pack a motion.

    Parameters
    ----------
    motion : Motion
        The motion.
    as_read : bool
        Whether the motion is an unchanged result of `read_bvh`: its poses then follow from its
        channels. By default `pack` checks this.

    Returns
    -------
    PackedMotion
        With the channels alone if the poses follow from them: they take half the space.
    """
    values = motion.channel_values
    content: PackedContent = "poses" if values is None else "both"
    if values is not None and (as_read or _determines_poses(values, motion)):
        content = "channels"
    parts = [motion.rotations, motion.positions] if content != "channels" else []
    parts += [values] if content != "poses" and values is not None else []
    return PackedMotion(
        content=content,
        numbers=np.concatenate([part.ravel() for part in parts]),
        skeleton=motion.skeleton,
        frame_time=motion.frame_time,
        n_frames=motion.n_frames,
        name=motion.name,
        path=None if motion.path is None else str(motion.path),
        repairs=motion.repairs,
    )


def _determines_poses(values: FloatArray, motion: Motion) -> bool:
    """Return whether the poses computed from channel values are those of a motion, bit for bit."""
    if np.isnan(values).any():
        return False
    quats, positions = channels_to_transforms(motion.skeleton, values.copy())
    # Compared as bytes, because -0.0 is written as "-0.0".
    return (
        quats.tobytes() == motion.rotations.tobytes()
        and positions.tobytes() == motion.positions.tobytes()
    )


def unpack(packed: PackedMotion) -> Motion:
    """Return the motion that was packed."""
    skeleton, n_frames = packed.skeleton, packed.n_frames
    numbers = np.array(packed.numbers, np.float64)
    values: FloatArray | None = None
    if packed.content == "channels":
        values = numbers.reshape(n_frames, skeleton.n_channels)
        quats, positions = channels_to_transforms(skeleton, values)
    else:
        shapes: list[tuple[int, ...]] = [
            (n_frames, skeleton.n_joints, 4),
            (n_frames, skeleton.n_joints, 3),
        ]
        if packed.content == "both":
            shapes.append((n_frames, skeleton.n_channels))
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        parts = np.split(numbers, ends[:-1])
        quats, positions, *rest = (
            part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)
        )
        values = rest[0] if rest else None
    return Motion(
        skeleton,
        packed.frame_time,
        quats,
        positions,
        channel_values=values,
        name=packed.name,
        path=None if packed.path is None else Path(packed.path),
        repairs=packed.repairs,
    )
