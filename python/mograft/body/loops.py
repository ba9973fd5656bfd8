"""Loops: motions whose last frame continues in their first, such as a walk cycle of a game."""

import numpy as np

from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion

MAX_LOOP_ANGLE = np.radians(5.0)
"""Angle of each joint between the first and the last frame of a loop, at most."""

MAX_LOOP_SHIFT = 0.01
"""Difference of heights and translations between them, at most, in skeleton heights."""

_VELOCITY_FACTOR = 2.0  # change of velocity at the join, relative to the greatest inside
_MIN_FRAMES = 4  # fewer have no velocity inside to compare with


def is_loop(motion: Motion) -> bool:
    """Return whether the last pose and velocity of a motion meet its first.

    Every joint differs by at most `MAX_LOOP_ANGLE` and `MAX_LOOP_SHIFT` between the last and the
    first frame, and the mean change of the joint velocities there is at most twice the greatest
    within the motion. The path over the floor and the heading of the root are not compared, so a
    walk that covers ground can be a loop. The last frame repeats the first: a cycle without this
    frame is no loop.
    """
    if motion.n_frames < _MIN_FRAMES:
        return False
    root, up = motion.locomotion_root(), up_axis(motion)
    turns = rotations.multiply(rotations.inverse(motion.rotations[0]), motion.rotations[-1])
    first, last = motion.rotations[[0, -1], root]
    change = rotations.multiply(last, rotations.inverse(first))
    turns[root] = rotations.multiply(rotations.inverse(rotations.twist(change, up)), change)
    shifts = motion.positions[-1] - motion.positions[0]
    carriers = [root, *motion.skeleton.ancestors(root)]
    shifts[carriers] = 0.0
    ends = [motion[k : k + 1].world_positions()[0, root, up] for k in (0, motion.n_frames - 1)]
    limit = MAX_LOOP_SHIFT * mass_model(motion.skeleton).height
    if (
        np.linalg.norm(rotations.log(turns), axis=-1).max() > MAX_LOOP_ANGLE
        or np.linalg.norm(shifts, axis=-1).max() > limit
        or abs(ends[1] - ends[0]) > limit
    ):
        return False
    others = np.setdiff1d(np.arange(motion.n_joints), carriers)
    quats = motion.rotations[:, others]
    steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
    changes = np.linalg.norm(np.diff(steps, axis=0, append=steps[:1]), axis=-1).sum(axis=-1)
    return bool(changes[-1] <= _VELOCITY_FACTOR * changes[:-1].max())
