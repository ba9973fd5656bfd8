"""Accelerations and jerks of joints, as differences between frames."""

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.motion.motion import Motion


def greatest_derivatives(motion: Motion, joints: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the greatest angular acceleration and jerk of some joints in each frame.

    Both have shape (n_frames,), in rad/frame² and rad/frame³. A rotation vector from a frame to the
    next is taken as 2 sin(angle / 2), which is 1 % too short at 0.5 rad. An acceleration is that of
    the middle of three frames, a jerk that of the second of four; elsewhere both are 0.
    """
    return _core.greatest_derivatives(motion.rotations, joints)


def world_jerk(motion: Motion, joints: IntArray) -> FloatArray:
    """Return the jerk of the world positions of some joints, shape (n_frames, len(joints)).

    It is in units of the file per frame³. A jerk is that of the second of four frames; it is 0 in
    the first frame and in the last two.
    """
    return _core.world_jerk(motion.skeleton.parents, motion.rotations, motion.positions, joints)
