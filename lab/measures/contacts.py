"""Skating of the toes, as the benchmark of Kimodo counts it."""

import numpy as np

from mograft.body.contacts import Ground

CONTACT_HEIGHT, SKATING_SPEED = 0.05, 0.2  # metres, metres per second
STATURE = 1.7  # metres that a skeleton height is taken for: the files do not state their unit


def toe_skate(motion):
    """Return the number of toes in contact in every frame, and how many of these skate.

    A toe is in contact if it is less than 5 cm above its floor height in a frame and in the
    previous one. It skates if its horizontal speed is then above 0.2 m/s. Both arrays have shape
    (n_frames,).
    """
    ground = Ground.of(motion)
    points = ground.points(motion)
    counts = np.zeros(motion.n_frames, np.int64), np.zeros(motion.n_frames, np.int64)
    if not points.size or motion.n_frames < 2:
        return counts
    scale = STATURE / ground.height
    is_low = scale * ground.above(points)[:, :, 1] < CONTACT_HEIGHT
    steps = np.diff(points[:, :, 1], axis=0)
    level = steps - (steps @ ground.up)[..., None] * ground.up
    speed = scale * motion.rate * np.linalg.norm(level, axis=-1)
    both = is_low[1:] & is_low[:-1]
    counts[0][1:] = both.sum(axis=1)
    counts[1][1:] = (both & (speed > SKATING_SPEED)).sum(axis=1)
    return counts
