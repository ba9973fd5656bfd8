"""Groups that hold single rotation channels of a joint; see `JointGroups.divided_channels`.

Each such channel is treated as a joint that rotates about one axis. Its angle is compared,
resampled and blended like a number, without jumps at half turns.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Samples, Source
from mograft.body.anatomy import feature_joints
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

DividedChannels: TypeAlias = Mapping[int, str]
"""For each divided joint, the axes of the channels that a group holds, such as ``"ZX"``."""

ChannelKey: TypeAlias = tuple[int, str]
"""A joint and the axis of one of its rotation channels."""

_AXES = np.eye(3)
_DIFFERENCE_STEP = 1e-5


def _channel_keys(channels: DividedChannels) -> list[ChannelKey]:
    return [(joint, axis) for joint, axes in sorted(channels.items()) for axis in axes]


def euler_angles(motion: Motion, joint: int) -> FloatArray:
    """Return the Euler angles of a joint in radians, shape (n_frames, n_rotation_channels).

    Columns are in channel order. Angles that the motion keeps from its file are returned as they
    are; otherwise `rotations.to_euler` computes them.
    """
    skeleton = motion.skeleton
    names, columns = skeleton.channels[joint], skeleton.channel_columns[joint]
    values = motion.channel_values
    if values is not None:
        is_rotation = [name.endswith("rotation") for name in names]
        selected = np.array(columns, np.int64)[is_rotation]
        if not np.isnan(values[:, selected]).any():
            return np.radians(values[:, selected])
    return rotations.to_euler(motion.rotations[:, joint], skeleton.rotation_order(joint))


def split_axes(motion: Motion, channels: DividedChannels) -> FloatArray:
    """Return each channel as a rotation about one axis, shape (n_frames, n_channels, 4).

    The channels are ordered by joint and, within a joint, as in `channels`.
    """
    keys = _channel_keys(channels)
    quats = np.empty((motion.n_frames, len(keys), 4))
    for column, (joint, axis) in enumerate(keys):
        order = motion.skeleton.rotation_order(joint)
        angle = euler_angles(motion, joint)[:, order.index(axis)]
        quats[:, column] = rotations.from_axis_angle(_AXES["XYZ".index(axis)], angle)
    return quats


def merge_axes(quats: FloatArray, channels: DividedChannels) -> dict[ChannelKey, FloatArray]:
    """Return the angle of each channel in radians; the inverse of `split_axes`.

    `quats` has shape (n_frames, n_channels, 4). Each result has shape (n_frames,) and is
    unwrapped: it has no jumps of a full turn.
    """
    angles = {}
    for column, key in enumerate(_channel_keys(channels)):
        channel = quats[..., column, :]
        half = np.arctan2(channel[..., "XYZ".index(key[1])], channel[..., 3])
        angles[key] = np.unwrap(2.0 * half)
    return angles


def restrict_rotations(quats: FloatArray, order: str, axes: str) -> FloatArray:
    """Return rotations, shape (..., 4), with all Euler angles set to 0 except those about `axes`.

    `order` gives the axes of the joint's channels, such as ``"ZXY"``. Two triples of Euler angles
    give the same rotation; the one whose middle angle is within 90 degrees is used.
    """
    flat = quats.reshape(-1, 4)
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    angles = rotations.to_euler(flat, order)
    middle = np.angle(np.exp(1j * angles[:, 1]))
    is_beyond = np.abs(middle) > np.pi / 2
    angles[:, 1] = np.where(is_beyond, np.pi - middle, middle)
    angles[is_beyond] += [np.pi, 0.0, np.pi]
    angles *= [axis in axes for axis in order]
    return rotations.from_euler(angles, order).reshape(quats.shape)


def restrict_ends(
    ends: Mapping[str, FloatArray], joints: IntArray, skeleton: Skeleton, channels: DividedChannels
) -> Mapping[str, FloatArray]:
    """Return poses and velocities at the ends of segments, restricted to a group's channels.

    The arrays of `ends` have shape (n_segments, n_feature_joints, 4 or 3) and the keys of
    `mograft.library.ingest.boundary_states`. Their joints are the feature joints of `joints`.
    """
    if not channels:
        return ends
    restricted = {key: np.array(values) for key, values in ends.items()}
    for column, joint in enumerate(feature_joints(skeleton, joints).tolist()):
        if joint not in channels:
            continue
        order, axes = skeleton.rotation_order(joint), channels[joint]
        for side in ("first", "last"):
            pose = restrict_rotations(ends[side][:, column], order, axes)
            # The velocity of the restricted rotation is a finite difference.
            step = rotations.exp(_DIFFERENCE_STEP * ends[f"{side}_velocity"][:, column])
            next_pose = rotations.multiply(ends[side][:, column], step)
            next_pose = restrict_rotations(next_pose, order, axes)
            change = rotations.log(rotations.multiply(rotations.inverse(pose), next_pose))
            restricted[side][:, column] = pose
            restricted[f"{side}_velocity"][:, column] = change / _DIFFERENCE_STEP
    return restricted


def restrict_samples(samples: Samples, skeleton: Skeleton, channels: DividedChannels) -> Samples:
    """Return samples with the divided joints restricted to a group's channels."""
    if not channels:
        return samples
    quats = samples.rotations.astype(np.float64)
    for joint, axes in channels.items():
        order = skeleton.rotation_order(joint)
        quats[:, :, joint] = restrict_rotations(quats[:, :, joint], order, axes)
    rest = samples.rest.astype(np.float64)
    rows = np.concatenate([quats.reshape(len(samples), -1), rest], axis=1)
    return replace(samples, rows=rows)


@dataclass(frozen=True, eq=False)
class RestrictedSamples:
    """Samples of a library with the divided joints restricted to a group's channels."""

    samples: Source
    skeleton: Skeleton
    channels: DividedChannels

    def __len__(self) -> int:
        return len(self.samples)

    def chunks(self) -> Iterator[Samples]:
        """Yield the samples of some segments at a time."""
        for chunk in self.samples.chunks():
            yield restrict_samples(chunk, self.skeleton, self.channels)
