"""Groups that hold single rotation channels of a joint; see `JointGroups.divided_channels`.

Each such channel is treated as a joint that rotates about one axis. Its angle is compared,
resampled and blended like a number, without jumps at half turns.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Samples
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

    Columns are in channel order. If the motion has the channel values of its file, the angles are
    those of the file; otherwise `rotations.to_euler` computes them.
    """
    skeleton = motion.skeleton
    if motion.channel_values is not None:
        values = motion.channel_values[:, skeleton.rotation_columns[joint]]
        if not np.isnan(values).any():
            return np.radians(values)
    return rotations.to_euler(motion.rotations[:, joint], skeleton.rotation_order(joint))


def split_axes(motion: Motion, channels: DividedChannels) -> FloatArray:
    """Return each rotation channel as a rotation about its axis, (n_frames, n_channels, 4).

    `channels` maps joints to axes, such as ``{4: "ZX"}``. The result is ordered by joint and,
    within a joint, by these axes.
    """
    keys = _channel_keys(channels)
    quats = np.empty((motion.n_frames, len(keys), 4))
    for column, (joint, axis) in enumerate(keys):
        order = motion.skeleton.rotation_order(joint)
        angle = euler_angles(motion, joint)[:, order.index(axis)]
        quats[:, column] = rotations.from_axis_angle(_AXES["XYZ".index(axis)], angle)
    return quats


def merge_axes(quats: FloatArray, channels: DividedChannels) -> dict[ChannelKey, FloatArray]:
    """Return the angle of each channel (joint, axis) in radians; the inverse of `split_axes`.

    `quats` has shape (n_frames, n_channels, 4). Each array of angles has shape (n_frames,) and is
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

    `order` has the axes of the Euler angles, such as ``"ZXY"``. Of the two triples of Euler angles
    that describe the same rotation, the one whose middle angle is within ±90 degrees is used.
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
    """Restrict the poses and velocities at the ends of segments to the axes in `channels`.

    `ends` is the result of `mograft.library.ingest.boundary_states`: arrays of shape
    (n_segments, n_feature_joints, 4) for poses and (n_segments, n_feature_joints, 3) for
    velocities. Their joints are ``feature_joints(skeleton, joints)``. `channels` maps joints to
    axes, such as "ZX".
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
    """Return samples in which each joint of `channels` rotates only about the axes given there."""
    if not channels:
        return samples
    quats = samples.rotations.astype(np.float64)
    for joint, axes in channels.items():
        order = skeleton.rotation_order(joint)
        quats[:, :, joint] = restrict_rotations(quats[:, :, joint], order, axes)
    others = samples.displacements_and_length.astype(np.float64)
    rows = np.concatenate([quats.reshape(len(samples), -1), others], axis=1)
    return replace(samples, rows=rows)
