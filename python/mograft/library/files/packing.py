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
    n_frames: int
    name: str
    path: str | None  # the file from which the motion was read
    clip: str | None  # name of the motion in the file, if the file holds several
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
    parts += [values] if content != "poses" and values is not None else []
    return PackedMotion(
        content=content,
        numbers=np.concatenate([part.ravel() for part in parts]),
        skeleton=motion.skeleton,
        frame_time=motion.frame_time,
        n_frames=motion.n_frames,
        name=motion.name,
        path=None if motion.path is None else str(motion.path),
        clip=motion.clip,
        repairs=motion.repairs,
    )


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


def unpack(packed: PackedMotion) -> Motion:
    """Return the motion that was packed."""
    skeleton, n_frames = packed.skeleton, packed.n_frames
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
        name=packed.name,
        path=None if packed.path is None else Path(packed.path),
        clip=packed.clip,
        repairs=packed.repairs,
    )
