"""A vector of fixed length for a clip of any length, for small classifiers."""

import numpy as np

from mograft.evaluation.body_tracks import BodyTracks, derivative

_QUANTILES = (0.1, 0.5, 0.9)


def clip_features(motion):
    """Return quantiles over time of positions and speeds, in the directions of the heading.

    For each bone end: the quantiles 0.1, 0.5 and 0.9 of its position relative to the hips and of
    its speed; for the hips the same quantiles of velocity, yaw rate and height. Lengths are in
    skeleton heights.
    """
    tracks = BodyTracks.of(motion)
    frames = np.arange(len(tracks))
    points = tracks.facing_forward(tracks.points, frames)
    speeds = np.linalg.norm(derivative(tracks.points, tracks.rate, 1), axis=-1)
    root = tracks.root_velocity
    level = tracks.facing_forward(root[:, None, :3], frames)[:, 0]
    columns = [points.reshape(len(frames), -1), speeds, level, root[:, 3:], tracks.hips[:, 2:]]
    return np.quantile(np.concatenate(columns, axis=1), _QUANTILES, axis=0).ravel()
