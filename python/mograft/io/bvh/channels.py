"""Conversion of channel values to rotations and positions."""

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray
from mograft.motion.skeleton import Skeleton


def channels_to_transforms(
    skeleton: Skeleton, values: FloatArray, *, add_offsets: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Convert channel values, shape (n_frames, n_channels), to local rotations and positions.

    Angles are in degrees, intrinsic, in the order of a joint's channels. Rotations, xyzw, have
    shape (n_frames, n_joints, 4) and do not change sign from frame to frame. Positions, shape
    (n_frames, n_joints, 3), are relative to the parent; a coordinate without a channel is that of
    the offset. With `add_offsets`, offsets are added to the position channels, which also changes
    `values` in place.
    """
    starts, rotation_axes = [0], list[tuple[int, int]]()
    position_axes = list[tuple[int, int, int]]()
    for joint, columns in enumerate(skeleton.channel_columns):
        for name, column in zip(skeleton.channels[joint], columns, strict=True):
            axis = "XYZ".index(name[0])
            if name.endswith("rotation"):
                rotation_axes.append((axis, column))
            else:
                position_axes.append((joint, axis, column))
        starts.append(len(rotation_axes))
    positions = np.empty((len(values), skeleton.n_joints, 3))
    positions[:] = skeleton.offsets
    for joint, axis, column in position_axes:
        if add_offsets:
            values[:, column] += skeleton.offsets[joint, axis]
        positions[:, joint, axis] = values[:, column]
    return _core.from_channels(values, starts, rotation_axes, np.pi / 180.0), positions
