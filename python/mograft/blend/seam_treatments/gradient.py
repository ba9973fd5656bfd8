"""Seam treatment "gradient": the frames that best keep the accelerations of the donors."""

from dataclasses import dataclass

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray
from mograft.blend.seam_treatments.offset import Offset
from mograft.blend.seams import ClosedFrames, add_deltas

_TIME = 2.0 / 15.0
"""Seconds over which a gap is spread: 4 frames at 30 frames per second.

Of 1 to 8 frames, 4 to 6 left seams least detectable in the clips `dance_*`, `basket` and `bandai`.
"""

_STEPS = 2
"""Gauss-Newton steps; in translations the first one is exact."""


class _Gradient(Offset):
    """Find the frames whose accelerations, velocities and values are nearest to the donors'.

    Minimises Σ τ⁴ |ẍ - a|² + τ² |ẋ - v|² + |x - d|² per joint, where d, v and a are the value,
    velocity and acceleration of the donors, and τ is `_TIME`. At a seam, d and a are the means of
    both donors. Frames more than `Config.seam_blend` away from a seam, and both ends of the motion,
    are fixed. Seams that are closer together are solved together. `Offset` gives the start.

    Differences across frames stand for derivatives. Compositing of gradients after Pérez, Gangnet
    and Blake (Poisson image editing, 2003); the last term is the screening of Bhat et al. (2008).
    """

    def smooth(self, closed: ClosedFrames) -> FloatArray:
        """Return the values with the frames near seams solved for."""
        values = closed.values
        n_frames, n_joints = values.shape[:2]
        is_free = _free_frames(closed)
        if not is_free.any() or not n_joints:
            return values
        donors = closed.donors()
        targets = _Targets.from_donors(closed, donors.rows, donors.seam_accelerations)
        tau = _TIME * closed.rate
        weights = np.array([1.0, tau**2, tau**4])
        bands = _normal_matrix(n_frames, weights, is_free)
        solved = values
        for _ in range(_STEPS):
            slope = targets.slopes(solved, weights)
            slope[~is_free] = 0.0
            slope[:, list(closed.integrated)] = 0.0
            change = _core.solve_pentadiagonal(bands, -slope.reshape(n_frames, -1))
            solved = add_deltas(closed.space, solved, change.reshape(slope.shape))
        return solved


@dataclass(frozen=True, eq=False)
class _Targets:
    """What the solved frames are compared with, in frames."""

    closed: ClosedFrames
    values: FloatArray  # (n_frames, ...): donors' values; in a shared frame, the later donor's
    earlier_values: FloatArray  # (n_seams, ...): values at seams of the donors that end there
    velocities: FloatArray  # (n_frames - 1, n_joints, 3): from each frame to the next
    accelerations: FloatArray  # (n_frames - 2, n_joints, 3): of all frames but the first and last

    @classmethod
    def from_donors(
        cls, closed: ClosedFrames, rows: FloatArray, seam_accelerations: FloatArray
    ) -> "_Targets":
        """Return the targets; `rows` and `seam_accelerations` are those of `DonorFrames`."""
        lengths, stop = closed.cut.lengths, closed.cut.stop
        last_row = np.cumsum(lengths + 1) - 1
        is_step = np.ones(len(rows) - 1, bool)
        is_step[last_row[:-1]] = False
        velocities = closed.space.delta(rows[:-1], rows[1:])[is_step]
        accelerations = np.diff(velocities, axis=0)
        accelerations[stop[closed.seams] - 1] = seam_accelerations
        is_kept = np.ones(len(rows), bool)
        is_kept[last_row[:-1]] = False
        return cls(closed, rows[is_kept], rows[last_row[closed.seams]], velocities, accelerations)

    def slopes(self, solved: FloatArray, weights: FloatArray) -> FloatArray:
        """Return half of the gradient of the minimised sum, shape (n_frames, n_joints, 3)."""
        space, at_seams = self.closed.space, self.closed.cut.stop[self.closed.seams]
        slopes = space.delta(self.values, solved)
        earlier = space.delta(self.earlier_values, solved[at_seams])
        slopes[at_seams] = 0.5 * (slopes[at_seams] + earlier)
        steps = space.delta(solved[:-1], solved[1:])
        errors = weights[1] * (steps - self.velocities)
        slopes[:-1] -= errors
        slopes[1:] += errors
        errors = weights[2] * (np.diff(steps, axis=0) - self.accelerations)
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


def _normal_matrix(n_frames: int, weights: FloatArray, is_free: BoolArray) -> FloatArray:
    """Return the matrix of the least squares as `solve_pentadiagonal` takes it, (n_frames, 3).

    Rows and columns of fixed frames are those of the identity.
    """
    bands = np.zeros((n_frames, 3))
    bands[:, 0] = weights[0]
    for stencil, weight in (((-1.0, 1.0), weights[1]), ((1.0, -2.0, 1.0), weights[2])):
        n_terms = n_frames + 1 - len(stencil)
        for i, first in enumerate(stencil):
            for j, second in enumerate(stencil[i:]):
                bands[i : i + n_terms, j] += weight * first * second
    bands[~is_free] = 0.0
    bands[~is_free, 0] = 1.0
    bands[:-1, 1][~is_free[1:]] = 0.0
    bands[:-2, 2][~is_free[2:]] = 0.0
    return bands


TREATMENT = _Gradient()
