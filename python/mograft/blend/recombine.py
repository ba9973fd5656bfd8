"""Combination of the motions of joint groups into one motion (paper, eq. 20)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import ChannelKey, euler_angles
from mograft.motion import rotations
from mograft.motion.motion import Motion


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


def recombine(base: Motion, parts: Sequence[Part], name: str) -> Motion:
    """Replace the motion of joint groups in a base motion (paper, eq. 20).

    No joint is in two parts. All other joints keep the motion of the base, bit for bit. The result
    keeps each channel value whose rotation or translation equals that of the base.
    """
    skeleton = base.skeleton
    quats, positions = base.rotations, base.positions
    values = None if base.channel_values is None else base.channel_values.copy()
    for part in parts:
        quats, rotated = _replace_joints(quats, part.rotations, part.joints)
        changes = [("rotation", rotated)]
        if part.positions is not None:
            positions, moved = _replace_joints(positions, part.positions, part.joints)
            changes.append(("position", moved))
        for kind, is_changed in changes:
            if values is None or not is_changed.any():
                continue
            pairs = [
                (index, column)
                for column, joint in enumerate(part.joints.tolist())
                for index, channel in zip(
                    skeleton.channel_columns[joint], skeleton.channels[joint], strict=True
                )
                if channel.endswith(kind)
            ]
            indices, columns = np.array(pairs, np.int64).reshape(-1, 2).T
            is_unknown = np.zeros(values.shape, bool)
            is_unknown[:, indices] = is_changed[:, columns]
            np.copyto(values, np.nan, where=is_unknown)
    single = {key: angle for part in parts for key, angle in part.angles.items()}
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
        repairs=(),
    )


def _replace_joints(
    values: FloatArray, own: FloatArray, joints: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Return `values` with those of some joints replaced, and which of the latter differ.

    `values` itself is returned if none differs, so that motions share the array.
    """
    replaced, is_changed = _core.replace_joints(values, np.ascontiguousarray(own), joints)
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
