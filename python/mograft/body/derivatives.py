"""Accelerations and jerks of joints, as differences between frames."""

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.motion.motion import Motion


def greatest_derivatives(motion: Motion, joints: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the greatest angular acceleration and jerk of some joints in each frame.

    Both have shape (n_frames,), in rad/frame² and rad/frame³. The length of a rotation vector from
    a frame to the next is taken as 2 sin(angle / 2), which is 1 % too short at 0.5 rad. An
    acceleration is computed from three frames and assigned to the second, a jerk from four frames
    and assigned to the second. Frames at the ends, to which none is assigned, have the value 0.
    """
    return _core.greatest_derivatives(motion.rotations, joints)


def world_jerk(motion: Motion, joints: IntArray) -> FloatArray:
    """Return the magnitude of the jerk of joints in the world, shape (n_frames, len(joints)).

    It is in units of the file per frame³. A jerk is computed from the positions in four frames and
    assigned to the second. The first frame and the last two have the value 0.
    """
    return _core.world_jerk(motion.skeleton.parents, motion.rotations, motion.positions, joints)
