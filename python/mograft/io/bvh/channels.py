"""Conversion of channel values to rotations and positions."""

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray
from mograft.motion.skeleton import CHANNELS, Skeleton

_CODES = {name: code for code, name in enumerate(CHANNELS)}
"""Codes of channels: the axis, plus 3 if it is a rotation."""


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
