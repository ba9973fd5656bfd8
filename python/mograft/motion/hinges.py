"""`Hinges`: the joints of a robot that turn about one axis, and the layout of its motion files."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, ReadOnlyArrays, set_fields
from mograft.motion import rotations

NO_LIMIT = 1e9
"""The amount of a limit that does not exist."""

_ON_AXIS = 1e-12
"""Length of the part of a quaternion across the axis up to which it counts as rounding."""

_EASING_SECONDS = 0.1
"""Seconds within which the correction of an angle or speed beyond its limits rises and falls."""


@dataclass(frozen=True)
class TableLayout:
    """How a table of joint angles stores a motion.

    Parameters
    ----------
    quaternion : str
        Order of the root's quaternion, ``"wxyz"`` or ``"xyzw"``; empty if it is not known.
    header : tuple of str
        Names of the columns; empty for a file without header.
    unit : float
        Metres in a unit of the root's position.
    is_degrees : bool
        Whether angles are in degrees.
    numbers : str
        Format of a number, such as ``".6f"``.
    is_single : bool
        Whether numbers have the precision of float32.
    rates : tuple of (str, float)
        Globs of names of files, each with the frames per second of these files.
    """

    quaternion: str = ""
    header: tuple[str, ...] = ()
    unit: float = 1.0
    is_degrees: bool = False
    numbers: str = ".9f"
    is_single: bool = False
    rates: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Hinges(ReadOnlyArrays):
    """The joints of a robot that turn about one axis, its bodies, and the layout of its files.

    Axes and points are in the axes of the rest pose, in which all angles are 0 and no joint is
    rotated. A body moves with a joint of the skeleton, of its joints with the last one.

    Parameters
    ----------
    names : sequence of str
        The joints in the order of the model.
    joints : array_like of int, shape (n_hinges,)
        Index of each joint in the skeleton.
    axes : array_like, shape (n_hinges, 3)
        Unit vectors.
    limits : array_like, shape (n_hinges, 2)
        Lowest and highest angle in radians; ±`NO_LIMIT` if there is no limit.
    speeds : array_like, shape (n_hinges,)
        Maximum angular velocity in radians per second; `NO_LIMIT` if there is no limit.
    bodies : array_like of int, shape (n_bodies,)
        Index of the root in the skeleton, and those of the bodies that a hinge moves.
    frames : array_like, shape (n_joints, 4)
        Rotation, xyzw, of the axes of each body in the model.
    origins : array_like, shape (n_joints, 3)
        Origin of the body in the model, from the joint.
    centers : array_like, shape (n_joints, 3)
        Centre of mass of the body, from the joint.
    masses : array_like, shape (n_joints,)
        Mass of the body in kilograms.
    layout : TableLayout
        The layout of the file of a motion; in a model the parts of it that the user states.
    """

    names: tuple[str, ...]
    joints: IntArray
    axes: FloatArray
    limits: FloatArray
    speeds: FloatArray
    bodies: IntArray
    frames: FloatArray
    origins: FloatArray
    centers: FloatArray
    masses: FloatArray
    layout: TableLayout = TableLayout()

    def __post_init__(self) -> None:
        given = {k: v for k, v in vars(self).items() if k not in ("names", "layout")}
        kinds = {"joints": np.int64, "bodies": np.int64}
        arrays = {name: np.array(own, kinds.get(name, float)) for name, own in given.items()}
        set_fields(self, {"names": tuple(self.names), **arrays})

    def angles(self, quats: FloatArray) -> FloatArray:
        """Return the angle of each hinge, (n_frames, n_hinges), from (n_frames, n_joints, 4).

        Of equal angles that nearest to the middle of the limits is returned; without limits, that
        nearest to the frame before.
        """
        own = quats[:, self.joints]
        along = np.einsum("fij,ij->fi", own[..., :3], self.axes)
        turns = 2.0 * np.arctan2(along, own[..., 3])
        is_free = np.abs(self.limits).max(axis=1) >= NO_LIMIT
        middle = np.where(is_free, 0.0, self.limits.mean(axis=1))
        turns -= 2.0 * np.pi * np.round((turns - middle) / (2.0 * np.pi))
        turns[:, is_free] = np.unwrap(turns[:, is_free], axis=0)
        return turns

    def rotations(self, angles: FloatArray) -> FloatArray:
        """Return the local rotations, (n_frames, n_hinges, 4), that angles give."""
        return _turns(self.axes, angles)

    def excess(self, angles: FloatArray) -> FloatArray:
        """Return by how many radians each angle exceeds the limits; negative below the lowest."""
        return angles - np.clip(angles, self.limits[:, 0], self.limits[:, 1])

    def keep(
        self, parents: IntArray, quats: FloatArray, base: FloatArray, moved: BoolArray, rate: float
    ) -> FloatArray:
        """Return rotations with which hinges turn about their axes only, within their limits.

        What a joint turns about other axes is passed on to the hinge after it, if there is only
        one: the three hinges of a shoulder or waist together follow a rotation. Angles and speeds
        may exceed their limits as far as those of `base` do.

        Parameters
        ----------
        parents : ndarray of int, shape (n_joints,)
            Index of each joint's parent.
        quats, base : ndarray, shape (n_frames, n_joints, 4)
            Local rotations; those of the motion that was changed.
        moved : ndarray of bool, shape (n_joints,)
            The joints that may be changed. Rotations on the axis and within limits are kept bit for
            bit, except within 0.2 s of frames that are changed to keep the limits.
        rate : float
            Frames per second.
        """
        axes = np.zeros((len(parents), 3))  # zero if a joint is fixed
        axes[self.joints] = self.axes
        kept = quats.copy()
        for joint in 1 + np.flatnonzero(moved[1:]):
            own, axis = kept[:, joint], axes[joint]
            across = own[:, :3] - (own[:, :3] @ axis)[:, None] * axis
            is_off = np.linalg.norm(across, axis=1, keepdims=True) > _ON_AXIS
            if not is_off.any():
                continue
            turned, rest = _swing_twist(own, axis)
            kept[:, joint] = np.where(is_off, turned, own)
            below = np.flatnonzero((parents == joint) & axes.any(axis=1))
            if len(below) == 1 and moved[below[0]]:
                passed = rotations.multiply(rest, kept[:, below[0]])
                kept[:, below[0]] = np.where(is_off, passed, kept[:, below[0]])
        return self._within_limits(kept, base, moved, rate)

    def _within_limits(
        self, quats: FloatArray, base: FloatArray, moved: BoolArray, rate: float
    ) -> FloatArray:
        """Return rotations that keep the limits as well as `base` does."""
        angles, given = self.angles(quats), self.angles(base)
        steps = np.abs(np.diff(given, axis=0)).max(axis=0, initial=0.0)
        pace = (len(given) - 1) / max(len(angles) - 1, 1)  # frames of `base` in a frame
        steps = np.maximum(self.speeds / rate, pace * steps)
        lowest = np.minimum(self.limits[:, 0], given.min(axis=0))
        highest = np.maximum(self.limits[:, 1], given.max(axis=0))
        width = max(round(_EASING_SECONDS * rate), 1)
        for number in np.flatnonzero(moved[self.joints]).tolist():
            own, low, high = angles[:, number], lowest[number], highest[number]
            above, below = np.maximum(own - high, 0.0), np.maximum(low - own, 0.0)
            changed, step = own, steps[number] + _ON_AXIS
            if max(above.max(), below.max()) > _ON_AXIS:
                change = _ease(below, width) - _ease(above, width)
                changed = np.clip(own + change, low, high)
            if np.abs(np.diff(changed)).max(initial=0.0) > step:
                changed = _slow_down(changed, step, width)
            if changed is own:
                continue
            turned = _turns(self.axes[number], changed)
            joint = self.joints[number]
            turned *= np.where((turned * quats[:, joint]).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
            is_changed = (changed != own)[:, None]
            quats[:, joint] = np.where(is_changed, turned, quats[:, joint])
        return quats

    def to_json(self) -> dict[str, Any]:
        """Return a JSON document."""
        arrays = {k: v.tolist() for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return {**vars(self), **arrays, "layout": asdict(self.layout)}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> "Hinges":
        """Return the hinges of a JSON document."""
        return cls(**{**document, "layout": TableLayout(**document["layout"])})


def _turns(axes: FloatArray, angles: FloatArray) -> FloatArray:
    half = 0.5 * angles[..., None]
    return np.concatenate([np.sin(half) * axes, np.cos(half)], axis=-1)


def _swing_twist(quats: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation about an axis, and the rest, which is applied before it.

    An axis of zeros gives no rotation. So does a half turn about a perpendicular axis.
    """
    twists = np.concatenate([(quats[:, :3] @ axis)[:, None] * axis, quats[:, 3:]], axis=1)
    norms = np.linalg.norm(twists, axis=1, keepdims=True)
    twists = np.where(norms < 1e-6, rotations.IDENTITY, twists / np.maximum(norms, 1e-6))
    return twists, rotations.multiply(rotations.inverse(twists), quats)


def _ease(excess: FloatArray, width: int) -> FloatArray:
    """Return a smooth curve that is nowhere below `excess`, (n_frames,), and 0 far from it.

    It is the largest excess within `width` frames, averaged by a Hann window of that width.
    """
    window = 2 * width + 1
    views = np.lib.stride_tricks.sliding_window_view(np.pad(excess, 2 * width, mode="edge"), window)
    return _average(views.max(axis=1), width)


def _average(values: FloatArray, width: int) -> FloatArray:
    """Return averages within `width` frames by a Hann window, without the ends of `values`."""
    weights = np.hanning(2 * width + 3)[1:-1]
    return np.convolve(values, weights / weights.sum(), mode="valid")


def _slow_down(angles: FloatArray, step: float, width: int) -> FloatArray:
    """Return angles, (n_frames,), that change by at most `step` between frames.

    Those near changed ones are averages, so that the speed does not jump.
    """
    slow = _nearest_slow(angles, step)
    share = np.minimum(_ease((slow != angles).astype(float), width), 1.0)
    smooth = _average(np.pad(slow, width, mode="edge"), width)
    return _nearest_slow(angles + share * (smooth - angles), step)


def _nearest_slow(angles: FloatArray, step: float) -> FloatArray:
    """Return the nearest curve to `angles` that changes by at most `step` between frames.

    It is the mean of the highest such curve below the angles and the lowest one above them
    (McShane, "Extension of range of functions", 1934).
    """
    ramp = step * np.arange(len(angles))

    def below(values: FloatArray) -> FloatArray:
        ahead = np.minimum.accumulate((values + ramp)[::-1])[::-1] - ramp
        return np.minimum(np.minimum.accumulate(values - ramp) + ramp, ahead)

    slow = 0.5 * (below(angles) - below(-angles))
    return np.where(np.abs(slow - angles) > _ON_AXIS, slow, angles)
