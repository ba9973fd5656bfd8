"""Comparison of motions by dynamic time warping."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.search.boundary_states import pose_gaps

_BAND_SHARE = 0.2  # maximum deviation from the constant rate, as a share of the segment
_STEPS = (2, 1, 3, 4)  # in half frames; ties go to the first, the constant rate
_BAND_ROWS = 8  # whose distances are computed together


def _band(n: int) -> int:
    """Return by how many columns a path may differ from the constant rate."""
    return max(round(2 * n * _BAND_SHARE), 1)


def gaps_in_band(poses: FloatArray, samples: FloatArray) -> FloatArray:
    """Return the distances that `warping_path` uses, between a motion and several others.

    `poses`, shape (n + 1, n_joints, 4), are those of the frames of the first motion, `samples`,
    shape (n_others, 2 n + 1, n_joints, 4), those of the others. The result, shape (n_others, n + 1,
    2 n + 1), has the `pose_gaps`, in radians, and zeros where no path passes.
    """
    n_others, width, *joint = samples.shape
    gaps, band = np.zeros((n_others, len(poses), width)), _band(len(poses) - 1)
    least, most, n = min(_STEPS), max(_STEPS), len(poses) - 1
    for row in range(0, n + 1, _BAND_ROWS):
        last = min(row + _BAND_ROWS - 1, n)
        low = max(2 * row - band, least * row, 2 * n - most * (n - row))
        high = min(2 * last + band, most * last, 2 * n - least * (n - last))
        own = samples[:, low : high + 1].reshape(-1, *joint)
        found = pose_gaps(poses[row : last + 1], own).reshape(last + 1 - row, n_others, -1)
        gaps[:, row : last + 1, low : high + 1] = found.swapaxes(0, 1)
    return gaps


def warping_path(distances: FloatArray) -> FloatArray:
    """Match each row of `distances` to a column by dynamic time warping; return the columns.

    `distances`, shape (..., n + 1, 2 n + 1), are between the frames of a first motion (rows) and
    the samples of a second one (columns), which has two samples per frame. The path has the
    smallest sum of distances among the paths with steps of 1 to 4 columns (half to double speed)
    that differ from the constant rate by at most a fifth of the length.

    Sakoe and Chiba, Dynamic programming algorithm optimization for spoken word recognition (1978),
    with slopes from ½ to 2 and a band.

    >>> warping_path(np.abs(np.arange(5)[:, None] * 2 - np.arange(9)))
    array([0, 2, 4, 6, 8])
    """
    *several, n_rows, width = distances.shape
    n, columns, longest = n_rows - 1, np.arange(width), max(_STEPS)
    band = _band(n)
    sums = np.full((*several, longest + width), np.inf)
    sums[..., longest] = distances[..., 0, 0]
    step_to = np.zeros(distances.shape, np.int8)
    for frame in range(1, n_rows):
        options = np.stack([sums[..., longest - step :][..., :width] for step in _STEPS])
        step_to[..., frame, :] = np.array(_STEPS)[options.argmin(axis=0)]
        total = options.min(axis=0) + distances[..., frame, :]
        sums[..., longest:] = np.where(np.abs(columns - 2 * frame) <= band, total, np.inf)
    path = np.full((*several, n_rows), 2 * n)
    for frame in range(n, 0, -1):
        steps = np.take_along_axis(step_to[..., frame, :], path[..., frame, None], axis=-1)
        path[..., frame - 1] = path[..., frame] - steps[..., 0]
    return path
