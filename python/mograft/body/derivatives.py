"""Accelerations and jerks of joints, as differences between frames."""

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.motion.motion import Motion


def greatest_derivatives(
    motion: Motion, joints: IntArray, step: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return the greatest angular acceleration and jerk of some joints in each frame.

    Derivatives are differences between frames that are `step` frames apart. Both results have shape
    (n_frames,), in rad/step² and rad/step³. The length of a rotation vector is taken as
    2 sin(angle / 2), which is 1 % too short at 0.5 rad. An acceleration is computed from three
    frames and assigned to the second, a jerk from four frames and assigned to the second. Frames at
    the ends, to which none is assigned, have the value 0.
    """
    derivatives = np.zeros((2, motion.n_frames))
    for first in range(min(step, motion.n_frames)):
        rotations = np.ascontiguousarray(motion.rotations[first::step])
        derivatives[:, first::step] = _core.greatest_derivatives(rotations, joints)
    return derivatives[0], derivatives[1]


def world_jerk(
    motion: Motion, joints: IntArray, step: int = 1, frames: slice = slice(None)
) -> FloatArray:
    """Return the magnitude of the jerk of joints in the world, shape (n_frames, len(joints)).

    It is in units of the file per step³, from differences between frames that are `step` frames
    apart. A jerk is computed from the positions in four frames and assigned to the second. Frames
    at the ends, to which none is assigned, have the value 0. Only the frames `frames` are read.
    """
    rotations, positions = motion.rotations[frames], motion.positions[frames]
    jerks = np.zeros((len(rotations), len(joints)))
    for first in range(min(step, len(rotations))):
        quats, places = (np.ascontiguousarray(own[first::step]) for own in (rotations, positions))
        jerks[first::step] = _core.world_jerk(motion.skeleton.parents, quats, places, joints)
    return jerks
