"""Features of poses for the segmentation methods, and durations as numbers of frames."""

import numpy as np

from mograft import rotations

MIN_VARIANCE = 1e-6
"""Variances of features below this value are noise. It is that of a joint that deviates by 0.002
radians, the order of the noise of optical recordings."""


def pose_features(motion):
    """Return the local quaternions of all joints below the root, shape (n_frames, n_features).

    The features do not depend on the position or orientation of the body; see `joints_below_root`.
    There are none if the motion has no joint below the root.
    """
    quats = rotations.continuous_signs(motion.rotations[:, joints_below_root(motion)])
    return quats.reshape(motion.n_frames, -1)


def joints_below_root(motion):
    """Return the joints other than the one that moves the body and its ancestors, ascending."""
    root = motion.locomotion_root()
    return np.setdiff1d(np.arange(motion.n_joints), [root, *motion.skeleton.ancestors(root)])


def frames_of(seconds, rate):
    """Return the number of frame intervals nearest to a duration, at least 1."""
    return max(round(seconds * rate), 1)


def dimensions_of(values, energy):
    """Return the number of largest eigenvalues that suffice for a share `energy` of their sum.

    `values` are descending. The number is 0 if their sum is 0.
    """
    return int(dimensions_of_each(values, energy))


def dimensions_of_each(values, energy):
    """Return the result of `dimensions_of` for each row of `values`, shape (..., n)."""
    totals = values.sum(axis=-1)
    is_below = np.cumsum(values, axis=-1) < energy * totals[..., None]
    return np.where(totals > 0, np.count_nonzero(is_below, axis=-1) + 1, 0)


def principal_scores(features, energy):
    """Return the features in the principal axes that hold a share `energy` of their variance.

    The result has shape (n, D), with one column for each of the D axes.

    There are no columns if the features vary by less than the noise of recordings.
    """
    centred = features - features.mean(axis=0)
    if (centred**2).sum() <= MIN_VARIANCE * len(features):
        return np.zeros((len(features), 0))
    variances, axes = principal_axes(centred.T @ centred)
    return centred @ axes[:, : dimensions_of(variances, energy)]


def principal_axes(matrices):
    """Return the eigenvalues of positive semidefinite matrices, descending, and eigenvectors."""
    values, vectors = np.linalg.eigh(matrices)
    return np.maximum(values[..., ::-1], 0.0), vectors[..., ::-1]
