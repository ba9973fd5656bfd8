"""The procedural dancer: a synthetic motion whose labels are known.

The dance combines each of six leg styles with each of seven arm patterns once, in shuffled order.
All curves are smooth functions of a clock that counts strides, so the frame rate affects only the
sampling. The pelvis follows a smooth path. Each foot is placed below the point that the pelvis
passes in the middle of its stance, and does not move until it is lifted. If a leg would be too
short, the pelvis is lowered. Inverse kinematics computes the bend of knees and elbows.

Lengths are in cm, y is up. In the rest pose the figure stands in a T-pose and faces z; its left
side is at positive x. The left foot swings in the first half of a stride, the right foot in the
second.
"""

from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, ReadOnlyArrays, as_floats
from mograft._util.validate import as_integer
from mograft.dancer.plan import Plan, StrArray, make_clock, make_foot, make_plan, make_route
from mograft.dancer.pose import arm_pose, leg_pose, pelvis_pose, trunk_pose
from mograft.dancer.skeleton import INDEX, OFFSETS, make_skeleton
from mograft.dancer.styles import ARM_PATTERNS, LEG_STYLES
from mograft.motion import rotations
from mograft.motion.motion import Motion

__all__ = ["ARM_PATTERNS", "LEG_STYLES", "Dance", "dance"]


@dataclass(frozen=True, eq=False)
class Dance(ReadOnlyArrays):
    """A dance and the labels of its frames.

    Parameters
    ----------
    motion : Motion
        The motion, with 18 joints and 57 channels; lengths in cm.
    legs, arms : ndarray of str, shape (n_frames,)
        Style of the legs and pattern of the arms: keys of `LEG_STYLES` and `ARM_PATTERNS`.
    phase : ndarray, shape (n_frames,)
        Fraction of the stride that has passed, from 0 to 1.
    stance : ndarray of bool, shape (n_frames, 2)
        Whether the left foot (column 0) and the right foot (column 1) stand flat and still.
    """

    motion: Motion
    legs: StrArray
    arms: StrArray
    phase: FloatArray
    stance: BoolArray

    def __len__(self) -> int:
        return self.motion.n_frames

    def __getitem__(self, frames: slice) -> "Dance":
        """Return the frames of a slice as a dance, with the motion and labels of these frames."""
        return Dance(**{field.name: getattr(self, field.name)[frames] for field in fields(self)})

    def takes(self, n: int) -> tuple["Dance", ...]:
        """Cut the dance into clips of nearly equal length, named ``dance_1`` and so on.

        Parameters
        ----------
        n : int
            Number of clips.

        Returns
        -------
        tuple of Dance
            The clips in order; each frame is in exactly one of them.

        Raises
        ------
        ValueError
            If `n` is below 1 or above the number of frames.
        """
        if not 1 <= n <= len(self):
            raise ValueError(f"`n` must be 1 to {len(self)}, the number of frames, got {n}")
        bounds = np.linspace(0, len(self), n + 1).round().astype(int)
        clips = (self[start:stop] for start, stop in pairwise(bounds))
        names = (f"{self.motion.name}_{number}" for number in range(1, n + 1))
        return tuple(
            replace(clip, motion=replace(clip.motion, name=name))
            for clip, name in zip(clips, names, strict=True)
        )


def dance(seed: int | np.random.Generator = 0, *, rate: float = 30.0, strides: int = 4) -> Dance:
    """Generate a dance that combines each leg style with each arm pattern.

    Parameters
    ----------
    seed : int or numpy.random.Generator
        Determines the order of the 42 combinations and the variation between strides. The same
        integer gives exactly the same dance.
    rate : float
        Frames per second. Another rate samples the same continuous motion.
    strides : int
        Number of strides of each combination.

    Returns
    -------
    Dance
        The motion, named ``dance``, and the labels of its frames.

    Raises
    ------
    ValueError
        If the seed is neither a non-negative integer nor a generator, the rate is not above 0,
        or `strides` is not a positive integer.
    TypeError
        If the rate is not a number.

    Examples
    --------
    >>> sample = dance(strides=1)
    >>> sample.motion.n_joints, sample.motion.skeleton.n_channels
    (18, 57)
    >>> print(*sorted(set(sample.arms)))
    clap flap hips punch robot swing wave
    >>> first, second = sample.takes(2)
    >>> first.motion.name
    'dance_1'
    """
    rng = seed
    if not isinstance(rng, np.random.Generator):
        rng = np.random.default_rng(as_integer("seed", rng))
    rate = float(as_floats("rate", rate, ()))
    if rate <= 0:
        raise ValueError(f"`rate` must be above 0 frames per second, got {rate}")
    return perform(make_plan(rng, as_integer("strides", strides, 1)), rate)


def perform(plan: Plan, rate: float) -> Dance:
    """Return the dance of a plan at `rate` frames per second."""
    clock, route = make_clock(plan, rate), make_route(plan)
    feet = [make_foot(plan, route, clock, side) for side in (0, 1)]
    pelvis, pelvis_positions = pelvis_pose(plan, route, clock, feet)
    trunk = trunk_pose(plan, route, clock, pelvis)
    quats = np.empty((len(clock), len(OFFSETS), 4))
    quats[:, 0], quats[:, INDEX["Spine"] : INDEX["Spine"] + 3] = pelvis, trunk
    for side, name in enumerate(("Left", "Right")):
        hip, shoulder = INDEX[f"{name}UpLeg"], INDEX[f"{name}Shoulder"]
        quats[:, hip : hip + 3] = leg_pose(pelvis, pelvis_positions, feet[side], OFFSETS[hip])
        quats[:, shoulder : shoulder + 4] = arm_pose(plan, clock, trunk[:, 0], side)
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)

    positions = np.tile(OFFSETS, (len(clock), 1, 1))
    positions[:, 0] = pelvis_positions
    stride = plan.stride(clock)
    quats = rotations.continuous_signs(quats)
    motion = Motion(make_skeleton(), 1.0 / rate, quats, positions, name="dance")
    stance = np.stack([foot.is_standing for foot in feet], axis=-1)
    return Dance(motion, plan.legs[stride], plan.arms[stride], clock - stride, stance)
