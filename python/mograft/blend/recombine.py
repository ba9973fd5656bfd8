"""Combination of the motions of joint groups into one motion (paper, eq. 20)."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import ChannelKey, euler_angles
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Part:
    """The motion of one joint group."""

    joints: IntArray  # the group's joints
    rotations: FloatArray  # local, (n_frames, n_joints, 4)
    # Local translations, (n_frames, n_joints, 3); None: those of the base.
    positions: FloatArray | None
    seams: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))  # (n_seams,): frames
    # Angle of each single channel in radians, (n_frames,); NaN in frames that keep the base's.
    angles: Mapping[ChannelKey, FloatArray] = field(default_factory=dict)


def recombine(base: Motion, parts: Iterable[Part], name: str) -> Motion:
    """Replace the motion of joint groups in a base motion (paper, eq. 20).

    No joint is in two parts. All other joints keep the motion of the base, bit for bit. The result
    keeps each channel value whose rotation or translation equals that of the base.
    """
    quats, positions = base.rotations, base.positions
    values = None if base.channel_values is None else base.channel_values.copy()
    single: dict[ChannelKey, FloatArray] = {}
    # `parts` may be an iterator: the arrays of one part can be released before the next is made.
    for part in parts:
        quats, is_rotated = _replace_joints(quats, part.rotations, part.joints)
        _mark_derived(values, base.skeleton, part.joints, is_rotated, "rotation")
        if part.positions is not None:
            positions, is_moved = _replace_joints(positions, part.positions, part.joints)
            _mark_derived(values, base.skeleton, part.joints, is_moved, "position")
        single |= part.angles
    if single and quats is base.rotations:
        quats = quats.copy()
    for joint in dict.fromkeys(joint for joint, _ in single):
        _replace_channels(base, joint, single, quats, values)
    return replace(
        base,
        rotations=quats,
        positions=positions,
        channel_values=values,
        name=name,
        path=None,
        clip=None,
        repairs=(),
    )


def _mark_derived(
    values: FloatArray | None,
    skeleton: Skeleton,
    joints: IntArray,
    is_changed: BoolArray,
    kind: str,
) -> None:
    """Set changed channel values to NaN, in place: the writer derives them from the pose.

    `is_changed`, shape (n_frames, n_joints), marks the frames in which the values of `kind`,
    "rotation" or "position", differ from those of the base.
    """
    if values is None:
        return
    for joint, is_own in zip(joints.tolist(), is_changed.T, strict=True):
        for index, channel in zip(
            skeleton.channel_columns[joint], skeleton.channels[joint], strict=True
        ):
            if channel.endswith(kind):
                values[is_own, index] = np.nan


def _replace_joints(
    values: FloatArray, new: FloatArray, joints: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Return `values` with those of some joints replaced, and a mask of the values that differ.

    The mask has shape (n_frames, len(joints)). If no value differs, `values` itself is returned, so
    that motions share the array.
    """
    replaced, is_changed = _core.replace_joints(values, np.ascontiguousarray(new), joints)
    return (replaced if is_changed.any() else values), is_changed


def _replace_channels(
    base: Motion,
    joint: int,
    single: Mapping[ChannelKey, FloatArray],
    quats: FloatArray,
    values: FloatArray | None,
) -> None:
    """Replace single channels of a joint in `quats` and `values`, in place.

    `single` has the new angles in radians, (n_frames,); NaN in frames that keep the base's.
    """
    skeleton = base.skeleton
    order = skeleton.rotation_order(joint)
    given = euler_angles(base, joint)
    new = given.copy()
    for column, axis in enumerate(order):
        target = single.get((joint, axis), np.full(base.n_frames, np.nan))
        # An angle that differs from the base's by full turns counts as equal.
        off = np.angle(np.exp(1j * (target - given[:, column])))
        new[:, column] = np.where(np.isnan(target), given[:, column], given[:, column] + off)
    changed = (new != given).any(axis=1)
    if not changed.any():
        return
    turned = np.where(changed[:, None], rotations.from_euler(new, order), base.rotations[:, joint])
    quats[:, joint] = rotations.continuous_signs(turned)
    if values is None:
        return
    for index, name in zip(skeleton.channel_columns[joint], skeleton.channels[joint], strict=True):
        if name.endswith("rotation"):
            angle = order.index(name[0])
            is_kept = new[:, angle] == given[:, angle]
            values[:, index] = np.where(is_kept, values[:, index], np.degrees(new[:, angle]))
