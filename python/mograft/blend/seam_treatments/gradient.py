"""Seam treatment "gradient": the frames that best keep the accelerations of the donors."""

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray
from mograft.analysis.segmentation import Segments
from mograft.blend.seam_treatments.offset import Offset
from mograft.blend.seams import ClosedFrames, DonorFrames, add_deltas

_TIME = 2.0 / 15.0
"""Seconds over which a gap is spread: 4 frames at 30 frames per second.

Of 2 to 8 frames, 4 to 6 made seams least detectable in the clips `dance_*`, `basket` and `bandai`.
"""


class _Gradient(Offset):
    """Fit the accelerations, velocities and values near seams to those of the donors.

    Minimises Σ τ⁴ |ẍ - a|² + τ² |ẋ - v|² + |x - d|² per joint, where d, v and a are the value,
    velocity and acceleration of the donors, and τ is `_TIME`. At a seam, d and a are the means of
    both donors. Frames more than `Config.seam_blend` seconds from all seams, and the first and last
    frame of the motion, are fixed. The solution for all other frames is one Gauss-Newton step from
    the result of `Offset`; for translations it is exact.

    Derivatives are finite differences of frames. The method is gradient-domain compositing after
    Pérez, Gangnet and Blake (Poisson image editing, 2003); |x - d|² is the screening term of Bhat
    et al. (2008).
    """

    # The influence of a seam falls to 1/e in _TIME / cos(30°), and to 1/10,000 in 9.2 times that.
    coupling = 10.6 * _TIME

    def smooth(self, closed: ClosedFrames) -> FloatArray:
        """Return the values, smoothed in the frames near seams."""
        values, is_free = closed.values, _free_frames(closed)
        if not is_free.any() or not values.shape[1]:
            return values
        donors = closed.donors()
        # A constant track differs in its last bits after resampling.
        moves = (np.abs(donors.rows - donors.rows[0]) > 1e-12).any(axis=(0, 2))
        moves[list(closed.integrated)] = False
        columns = np.flatnonzero(moves)
        moving, tau = values.take(columns, axis=1), _TIME * closed.rate
        weights = np.array([1.0, tau**2, tau**4])
        is_step = _donor_steps(closed.cut)
        slopes = _half_gradient(closed, moving, donors.take(columns), is_step, weights)
        slopes[~is_free] = 0.0
        bands = _normal_matrix(is_step, weights, is_free)
        change = _core.solve_pentadiagonal(bands, -slopes.reshape(len(values), -1))
        solved = values.copy()
        solved[:, columns] = add_deltas(closed.space, moving, change.reshape(slopes.shape))
        return solved


def _donor_steps(cut: Segments) -> BoolArray:
    """Return whether each frame and the next are in one segment, shape (n_frames - 1,).

    They are not if a segment ends with the first of them and the next segment starts with the
    second, as in concatenated motions.
    """
    is_step = np.ones(cut.stop[-1], bool)
    is_step[cut.stop[:-1][cut.stop[:-1] < cut.start[1:]]] = False
    return is_step


def _half_gradient(
    closed: ClosedFrames,
    values: FloatArray,
    donors: DonorFrames,
    is_step: BoolArray,
    weights: FloatArray,
) -> FloatArray:
    """Return half of the gradient, at `values`, of the sum that `_Gradient` minimises."""
    space, rows, cut = closed.space, donors.rows, closed.cut
    last_rows = np.cumsum(cut.lengths + 1) - 1
    shares = cut.stop[:-1] == cut.start[1:]
    is_kept = np.ones(len(rows), bool)  # of a shared frame, the row of the later donor
    is_kept[last_rows[:-1][shares]] = False
    slopes = space.delta(rows[is_kept], values)
    seams = closed.seams[shares[closed.seams]]
    at_seams = cut.stop[seams]
    earlier = space.delta(rows[last_rows[seams]], values[at_seams])
    slopes[at_seams] = 0.5 * (slopes[at_seams] + earlier)
    is_inside = np.ones(len(rows) - 1, bool)
    is_inside[last_rows[:-1]] = False
    targets = np.zeros((len(is_step), *values.shape[1:-1], 3))
    targets[is_step] = space.delta(rows[:-1], rows[1:])[is_inside]
    steps = space.delta(values[:-1], values[1:])
    errors = weights[1] * (steps - targets) * is_step[:, None, None]
    slopes[:-1] -= errors
    slopes[1:] += errors
    targets = np.diff(targets, axis=0)
    targets[at_seams - 1] = donors.seam_accelerations[shares[closed.seams]]
    has_acceleration = (is_step[:-1] & is_step[1:])[:, None, None]
    errors = weights[2] * (np.diff(steps, axis=0) - targets) * has_acceleration
    slopes[:-2] += errors
    slopes[1:-1] -= 2.0 * errors
    slopes[2:] += errors
    return slopes


def _free_frames(closed: ClosedFrames) -> BoolArray:
    """Return which frames may change, shape (n_frames,)."""
    frames = np.arange(len(closed.values))
    seams = closed.cut.stop[closed.seams]
    if not len(seams):
        return np.zeros(len(frames), bool)
    after = np.searchsorted(seams, frames).clip(max=len(seams) - 1)
    distance = np.minimum(np.abs(seams[after] - frames), np.abs(frames - seams[after - 1]))
    is_free: BoolArray = distance <= closed.blend
    is_free[[0, -1]] = False
    return is_free


def _normal_matrix(is_step: BoolArray, weights: FloatArray, is_free: BoolArray) -> FloatArray:
    """Return the main diagonal and two upper diagonals of the normal equations, (n_frames, 3).

    `is_step` is the result of `_donor_steps`. Rows and columns of fixed frames are those of the
    identity matrix.
    """
    bands = np.zeros((len(is_free), 3))
    bands[:, 0] = weights[0]
    terms = (
        ((-1.0, 1.0), weights[1] * is_step),
        ((1.0, -2.0, 1.0), weights[2] * (is_step[:-1] & is_step[1:])),
    )
    for stencil, weight in terms:
        for i, first in enumerate(stencil):
            for j, second in enumerate(stencil[i:]):
                bands[i : i + len(weight), j] += weight * first * second
    bands[~is_free] = 0.0
    bands[~is_free, 0] = 1.0
    bands[:-1, 1][~is_free[1:]] = 0.0
    bands[:-2, 2][~is_free[2:]] = 0.0
    return bands


TREATMENT = _Gradient()
