"""Features of poses for the segmentation methods, and durations as numbers of frames."""

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.linalg import eigenvectors, product, round_to_grid
from mograft.analysis.principal_components import Spread
from mograft.motion import rotations
from mograft.motion.motion import Motion

MIN_VARIANCE = 1e-6
"""Variances of features below this value are noise. It is that of a joint that deviates by 0.002
radians, the order of the noise of optical recordings."""


def pose_features(motion: Motion) -> FloatArray:
    """Return the local quaternions of all joints below the root, shape (n_frames, n_features).

    The features do not depend on the position or orientation of the body; see `joints_below_root`.
    There are none if the motion has no joint below the root. Values are multiples of 2^-20, so that
    sums of their products do not depend on the number of BLAS threads.
    """
    quats = rotations.continuous_signs(motion.rotations[:, joints_below_root(motion)])
    return round_to_grid(quats.reshape(motion.n_frames, -1))


def joints_below_root(motion: Motion) -> IntArray:
    """Return the joints other than the one that moves the body and its ancestors, ascending."""
    root = motion.locomotion_root()
    return np.setdiff1d(np.arange(motion.n_joints), [root, *motion.skeleton.ancestors(root)])


def frames_of(seconds: float, rate: float) -> int:
    """Return the number of frame intervals nearest to a duration, at least 1."""
    return max(round(seconds * rate), 1)


def dimensions_of(values: FloatArray, energy: float) -> int:
    """Return the number of largest eigenvalues that suffice for a share `energy` of their sum.

    `values` are descending. The number is 0 if their sum is 0.
    """
    return int(dimensions_of_each(values, energy))


def dimensions_of_each(values: FloatArray, energy: float) -> IntArray:
    """Return the result of `dimensions_of` for each row of `values`, shape (..., n)."""
    totals = values.sum(axis=-1)
    is_below = np.cumsum(values, axis=-1) < energy * totals[..., None]
    return np.where(totals > 0, np.count_nonzero(is_below, axis=-1) + 1, 0)


def principal_scores(features: FloatArray, energy: float) -> FloatArray:
    """Return the features in the principal axes that hold a share `energy` of their variance.

    The result has shape (n, D), with one column for each of the D axes.

    There are no columns if the features vary by less than the noise of recordings.
    """
    spread = Spread.of([features])
    if np.trace(spread.scatter) <= MIN_VARIANCE * len(features):
        return np.zeros((len(features), 0))
    variances, axes = eigenvectors(spread.scatter, features.shape[1])
    return product(features - spread.mean, axes[:, : dimensions_of(variances, energy)])
