"""Distances between windows of motions, as in GANimator."""

import numpy as np

from lab.measures.distributions import pairwise

COVERAGE_FRAMES, LOCAL_FRAMES = 10, 5  # one second and half a second at 10 frames per second
MAX_COVERED_DISTANCE = 2.0  # mean L2 distance of 6D rotations per frame to a near window


def nearest_windows(tracks, others, length):
    """Return the distance of every window of `length` frames to the nearest window of `others`.

    Both are sequences of arrays, shape (n_frames, n_features). The distance of two windows is the
    mean distance of their frames. The result has one array for each track, shape
    (n_frames - length + 1,), which is empty if the track is shorter.
    Source: Li et al., GANimator, ACM Transactions on Graphics 41 (2022).
    """
    others = [other for other in others if len(other) >= length]
    found = []
    for track in tracks:
        n = max(len(track) - length + 1, 0)
        nearest = np.full(n, np.inf)
        for other in others if n else ():
            distances = pairwise(track, other)
            total = np.zeros((n, len(other) - length + 1))
            for offset in range(length):
                total += distances[offset : offset + n, offset : offset + total.shape[1]]
            nearest = np.minimum(nearest, total.min(axis=1) / length)
        found.append(nearest)
    return found
