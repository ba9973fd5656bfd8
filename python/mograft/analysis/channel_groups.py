"""Joints of which a group holds single rotation channels: degrees of freedom of their own.

A channel is treated as a joint that turns about one axis alone, so that its angle is compared,
resampled and joined as a number is, without a leap where it passes a half turn.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Samples, Source
from mograft.body.anatomy import feature_joints
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = [
    "HeldSamples",
    "Key",
    "angles",
    "apart",
    "ends_alone",
    "held_alone",
    "samples_alone",
    "told",
]

Held = Mapping[int, str]
"""Of each divided joint the axes of the channels that a group holds, as ``"ZX"``."""

Key = tuple[int, str]
"""A joint and the axis of one of its channels."""

_EYE = np.eye(3)
_STEP = 1e-5


def keys(held: Held) -> list[Key]:
    """Return the single channels that a group holds."""
    return [(joint, axis) for joint, axes in sorted(held.items()) for axis in axes]


def angles(motion: Motion, joint: int) -> FloatArray:
    """Return a joint's Euler angles in radians, shape (n_frames, 3), as the file has them."""
    skeleton = motion.skeleton
    names, columns = skeleton.channels[joint], skeleton.channel_columns[joint]
    known = motion.channel_values
    if known is not None:
        own = [c for c, name in zip(columns, names, strict=True) if name.endswith("rotation")]
        if not np.isnan(known[:, own]).any():
            return np.radians(known[:, own])
    return rotations.to_euler(motion.rotations[:, joint], skeleton.rotation_order(joint))


def apart(motion: Motion, held: Held) -> FloatArray:
    """Return each held channel as a joint that turns about one axis, (n_frames, n_channels, 4)."""
    turns = np.empty((motion.n_frames, len(keys(held)), 4))
    for column, (joint, axis) in enumerate(keys(held)):
        order = motion.skeleton.rotation_order(joint)
        own = angles(motion, joint)[:, order.index(axis)]
        turns[:, column] = rotations.from_axis_angle(_EYE["XYZ".index(axis)], own)
    return turns


def told(turns: FloatArray, held: Held) -> dict[Key, FloatArray]:
    """Undo `apart`: return each channel's angle in radians, without leaps."""
    found = {}
    for column, key in enumerate(keys(held)):
        own = turns[..., column, :]
        found[key] = np.unwrap(2.0 * np.arctan2(own[..., "XYZ".index(key[1])], own[..., 3]))
    return found


def held_alone(quats: FloatArray, order: str, axes: str) -> FloatArray:
    """Return rotations of which only some Euler angles are left, the others being 0.

    Parameters
    ----------
    quats : ndarray, shape (..., 4)
        Unit quaternions.
    order : str
        The axes of the joint's channels, as ``"ZXY"``.
    axes : str
        Those that are left.

    Returns
    -------
    ndarray, shape (..., 4)
        Of the two triples of angles the one whose middle angle is up to a right angle counts.
    """
    flat = quats.reshape(-1, 4)
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    own = rotations.to_euler(flat, order)
    middle = np.angle(np.exp(1j * own[:, 1]))
    other = np.abs(middle) > np.pi / 2
    own[:, 1] = np.where(other, np.pi - middle, middle)
    own[other] += [np.pi, 0.0, np.pi]
    own *= [axis in axes for axis in order]
    return rotations.from_euler(own, order).reshape(quats.shape)


def ends_alone(
    ends: Mapping[str, FloatArray], joints: IntArray, skeleton: Skeleton, held: Held
) -> Mapping[str, FloatArray]:
    """Return poses and velocities at the ends of segments, of divided joints only what is held.

    Parameters
    ----------
    ends : dict of str to ndarray, shape (n_segments, n_joints, 4 or 3)
        As `mograft.library.ingest.boundary_states` names them.
    joints : ndarray of int
        The group's joints; its feature joints are those of `ends`.
    skeleton : Skeleton
        Their skeleton.
    held : dict of int to str
        What the group holds of divided joints.
    """
    if not held:
        return ends
    alone = {key: np.array(own) for key, own in ends.items()}
    for column, joint in enumerate(feature_joints(skeleton, joints).tolist()):
        if joint not in held:
            continue
        order, axes = skeleton.rotation_order(joint), held[joint]
        for side in ("first", "last"):
            here = held_alone(ends[side][:, column], order, axes)
            # What is left turns as fast as the step that a small step of the joint gives.
            turned = rotations.exp(_STEP * ends[f"{side}_velocity"][:, column])
            turned = rotations.multiply(ends[side][:, column], turned)
            there = held_alone(turned, order, axes)
            step = rotations.log(rotations.multiply(rotations.inverse(here), there))
            alone[side][:, column] = here
            alone[f"{side}_velocity"][:, column] = step / _STEP
    return alone


def samples_alone(samples: Samples, skeleton: Skeleton, held: Held) -> Samples:
    """Return samples of all joints, of divided ones only what a group holds."""
    if not held:
        return samples
    turned = samples.rotations.astype(np.float64)
    for joint, axes in held.items():
        own = held_alone(turned[:, :, joint], skeleton.rotation_order(joint), axes)
        turned[:, :, joint] = own
    rest = samples.rest.astype(np.float64)
    rows = np.concatenate([turned.reshape(len(samples), -1), rest], axis=1)
    return replace(samples, rows=rows)


@dataclass(frozen=True, eq=False)
class HeldSamples:
    """Samples of a library, of divided joints only what a group holds."""

    samples: Source
    skeleton: Skeleton
    held: Held

    def __len__(self) -> int:
        return len(self.samples)

    def chunks(self) -> Iterator[Samples]:
        """Yield some segments at a time."""
        for chunk in self.samples.chunks():
            yield samples_alone(chunk, self.skeleton, self.held)
