"""Poses as vectors, and durations as numbers of frames, for the segmentation methods."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.linalg import round_to_grid
from mograft.motion import rotations
from mograft.motion.motion import Motion


def pose_features(motion: Motion) -> FloatArray:
    """Return the local quaternions of all joints below the root, shape (n_frames, n_features).

    The joint that moves the body through the world and the joints above it are left out, so the
    features do not depend on the position or orientation of the body. There are no features if the
    motion has no other joint. Values are multiples of 2^-20, so that sums of their products do not
    depend on the number of BLAS threads.
    """
    root = motion.locomotion_root()
    is_above = np.zeros(motion.n_joints, bool)
    is_above[[root, *motion.skeleton.ancestors(root)]] = True
    quats = rotations.continuous_signs(motion.rotations[:, ~is_above])
    return round_to_grid(quats.reshape(motion.n_frames, -1))


def frames_of(seconds: float, rate: float) -> int:
    """Return the number of frame intervals nearest to a duration, at least 1."""
    return max(round(seconds * rate), 1)
