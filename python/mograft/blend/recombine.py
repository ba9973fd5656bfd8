"""Combination of motions: of joint groups (paper, eq. 20), and of ranges of frames."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray, as_floats, as_quaternions
from mograft._util.runs import extend_runs, find_runs
from mograft.analysis.channel_groups import ChannelKey, euler_angles
from mograft.motion import rotations
from mograft.motion.limits import MAX_COORDINATE
from mograft.motion.motion import NO_FILE, Motion, replace_unchecked
from mograft.motion.skeleton import Skeleton

MAX_ANGLE = 1e-4
"""Maximum angle, in radians, between the motions at the ends of a range; 0.006 degrees."""

_MAX_SHIFT = 1e-4  # maximum difference of translations there, in skeleton heights


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


def recombine(base: Motion, parts: Iterable[Part], name: str, *, spreads: bool = False) -> Motion:
    """Replace the motion of joint groups in a base motion (paper, eq. 20).

    No joint is in two parts. All other joints keep the motion of the base, bit for bit. The result
    keeps each channel value whose rotation or translation equals that of the base. The joints of a
    robot turn about their hinges only; see `Hinges.keep`. With `spreads`, joints below those of
    `parts` may turn, too, to follow rotations that one hinge cannot make.
    """
    changed = np.zeros(base.n_joints, bool)
    quats, positions = base.rotations, base.positions
    values = None if base.channel_values is None else base.channel_values.copy()
    single: dict[ChannelKey, FloatArray] = {}
    # `parts` may be an iterator: the arrays of one part can be released before the next is made.
    for part in parts:
        as_quaternions("rotations", part.rotations)
        changed[part.joints] = True
        quats, is_rotated = _replace_joints(quats, part.rotations, part.joints)
        _mark_derived(values, base.skeleton, part.joints, is_rotated, "rotation")
        if part.positions is not None:
            as_floats("positions", part.positions, maximum=MAX_COORDINATE)
            positions, is_moved = _replace_joints(positions, part.positions, part.joints)
            _mark_derived(values, base.skeleton, part.joints, is_moved, "position")
        single |= part.angles
    if single and quats is base.rotations:
        quats = quats.copy()
    for joint in dict.fromkeys(joint for joint, _ in single):
        changed[joint] = True
        _replace_channels(base, joint, single, quats, values)
    hinges = base.skeleton.hinges
    if hinges is not None and quats is not base.rotations:
        changed |= spreads & base.skeleton.subtree_mask(np.flatnonzero(changed))
        known = base.skeleton.parents, quats, base.rotations, changed
        quats, values = hinges.keep(*known, base.rate), None  # angles replace channel values
    # The base and the parts are checked already.
    return replace_unchecked(
        base, rotations=quats, positions=positions, channel_values=values, name=name, **NO_FILE
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
    if values is not None:
        columns = skeleton.rotation_columns[joint]
        values[:, columns] = np.where(new == given, values[:, columns], np.degrees(new))


def splice(
    before: Motion, after: Motion, is_new: BoolArray, height: float, moving: Collection[int]
) -> Motion:
    """Return `after` in the frames `is_new`, and `before`, bit for bit, in all others.

    Ranges of `is_new`, shape (n_frames,), grow on both sides until the motions differ by at most
    `MAX_ANGLE` at every joint, and by 1e-4 of `height` in every translation. The joints `moving`
    carry the body: they are not compared, and are those of `after` in all frames from the start of
    the first range.
    """
    is_new = extend_runs(is_new, ~_is_near(before, after, height, moving))
    changed = np.flatnonzero(is_new)
    if not len(changed):
        return replace(before, name=after.name)
    follows = np.arange(len(is_new)) >= changed[0]
    joints = range(before.n_joints)
    from_after = np.stack([follows if joint in moving else is_new for joint in joints], axis=1)
    quats = np.where(from_after[..., None], _with_signs(before, after, is_new), before.rotations)
    # Angles that a writer derives depend on those of the frames before, so they are kept, too.
    values = before.channel_numbers()
    is_computed = before.is_computed(values)
    counts = [len(columns) for columns in before.skeleton.channel_columns]
    new = np.nan if after.channel_values is None else after.channel_values
    values = np.where(np.repeat(from_after, counts, axis=1), new, values)
    positions = np.where(from_after[..., None], after.positions, before.positions)
    return replace(
        after,
        rotations=quats,
        positions=positions,
        channel_values=values,
        computed_values=is_computed,
    )


def _is_near(before: Motion, after: Motion, height: float, moving: Collection[int]) -> BoolArray:
    """Return the frames in which motions differ by at most the limits, without joints `moving`.

    The result is a mask of shape (n_frames,).
    """
    others = np.setdiff1d(np.arange(before.n_joints), list(moving))
    quats = [motion.rotations[:, others] for motion in (before, after)]
    # |q - p| or |q + p| is 2 sin(angle / 4), which is exact where |q·p| rounds to 1.
    chords = np.minimum(
        np.linalg.norm(quats[0] - quats[1], axis=2), np.linalg.norm(quats[0] + quats[1], axis=2)
    )
    shifts = np.linalg.norm(before.positions[:, others] - after.positions[:, others], axis=2)
    is_near: BoolArray = (chords <= 2.0 * np.sin(MAX_ANGLE / 4.0)).all(axis=1)
    is_near &= (shifts <= _MAX_SHIFT * height).all(axis=1)
    return is_near


def _with_signs(before: Motion, after: Motion, is_new: BoolArray) -> FloatArray:
    """Return the quaternions of `after`, with the signs of `before` at the start of each range."""
    quats = after.rotations.copy()
    for start, stop in find_runs(is_new).tolist():
        products = (quats[start] * before.rotations[start]).sum(axis=1, keepdims=True)
        quats[start:stop] *= np.where(products < 0.0, -1.0, 1.0)
    return quats
