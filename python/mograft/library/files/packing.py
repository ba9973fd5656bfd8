"""Motions as flat arrays of numbers that restore them bit for bit."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.io.bvh.reader import channels_to_transforms
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

PackedContent: TypeAlias = Literal["channels", "poses", "both"]


@dataclass(frozen=True, eq=False)
class PackedMotion:
    """A motion as one array of numbers.

    If `content` is "channels", the numbers are the channel values of a file, from which rotations
    and positions follow. With "poses" they are rotations and positions; with "both" they are
    rotations, positions and channel values.
    """

    content: PackedContent
    numbers: FloatArray  # shape (n,); the arrays one after the other
    skeleton: Skeleton
    frame_time: float  # seconds
    repairs: tuple[str, ...]  # deviations that the reader tolerated


def pack(motion: Motion, *, as_read: bool = False) -> PackedMotion:
    """Return a motion as one array: only its channel values if these determine its poses.

    Channel values take about half the space of poses. `as_read` states that the motion is an
    unchanged result of a reader, so that its channel values determine the poses. Otherwise `pack`
    computes the poses from the channel values and compares them bit for bit. `computed_values` of
    the motion are not stored.
    """
    values = motion.channel_values
    content: PackedContent = "poses" if values is None else "both"
    if values is not None and (as_read or _determines_poses(values, motion)):
        content = "channels"
    parts = [motion.rotations, motion.positions] if content != "channels" else []
    parts += [] if values is None else [values]
    numbers = np.concatenate([part.ravel() for part in parts])
    return PackedMotion(content, numbers, motion.skeleton, motion.frame_time, motion.repairs)


def _determines_poses(values: FloatArray, motion: Motion) -> bool:
    """Return whether the poses computed from channel values equal a motion's poses bit for bit."""
    if np.isnan(values).any():
        return False
    quats, positions = channels_to_transforms(motion.skeleton, values.copy())
    # Compared as bytes, because 0.0 and -0.0 are equal numbers but are written differently.
    return (
        quats.tobytes() == motion.rotations.tobytes()
        and positions.tobytes() == motion.positions.tobytes()
    )


def unpack(
    packed: PackedMotion, n_frames: int, name: str, path: str | None, clip: str | None
) -> Motion:
    """Return the motion that was packed; the other arguments are fields of the motion."""
    skeleton = packed.skeleton
    numbers = np.array(packed.numbers, np.float64)
    values: FloatArray | None = None
    if packed.content == "channels":
        values = numbers.reshape(n_frames, skeleton.n_channels)
        quats, positions = channels_to_transforms(skeleton, values)
    else:
        n_joints = skeleton.n_joints
        ends = n_frames * n_joints * np.array([4, 7])
        quats, positions, rest = np.split(numbers, ends)
        quats, positions = quats.reshape(-1, n_joints, 4), positions.reshape(-1, n_joints, 3)
        if packed.content == "both":
            values = rest.reshape(n_frames, skeleton.n_channels)
    return Motion(
        skeleton,
        packed.frame_time,
        quats,
        positions,
        channel_values=values,
        name=name,
        path=None if path is None else Path(path),
        clip=clip,
        repairs=packed.repairs,
    )
