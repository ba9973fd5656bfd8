"""The seam treatments by name: one class for each value of `Config.seam`.

To add a treatment, write a class derived from `mograft.blend.seams.SeamTreatment`, and name it in
`SEAM_TREATMENTS` and in the annotation of `Config.seam`.
"""

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.blend import seams

_GRADIENT_SECONDS = 2.0 / 15.0
"""Seconds over which gaps are spread, also of accelerations: 4 frames at 30 frames per second.

Of 2 to 8 frames, 4 to 6 made seams least detectable in the clips `dance_*`, `basket` and `bandai`.
"""


class _Displacement(seams.SeamTreatment):
    """Move both sides of a seam by half of the gap; the displacement falls to 0 over the segment.

    Displacement mapping (paper, 4.5): a translation or a rotation vector, linear in time.
    Velocities jump at the seam.
    """

    spans_segments = True

    def close(
        self, values: FloatArray, times: seams.PieceTimes, boundaries: seams.SeamBoundaries
    ) -> FloatArray:
        """Return the values with each gap closed by displacing both segments at the seam.

        The displacement of a segment is half of the gap at the seam. It falls linearly to 0 at the
        other end of the segment.
        """
        half = 0.5 * boundaries.gaps()
        share = (times.seconds / times.durations[times.piece])[:, None, None]
        start, end = seams.at_piece_ends(half, times.piece)
        return seams.add_deltas(boundaries.space, values, share * end - (1.0 - share) * start)


class _Paper(_Displacement):
    """Displace segments as `_Displacement` does, then replace the frames near seams by a cubic.

    The paper replaces 5 frames on each side of a seam. Here their number is `Config.seam_window`,
    but at most one frame less than half of the shorter segment, so that two windows never overlap.
    Seams next to a segment of one frame interval are not smoothed.
    """

    def smooth(self, closed: seams.ClosedFrames) -> FloatArray:
        """Return the values, with those in a window around each seam replaced by a cubic."""
        space, values, lengths = closed.space, closed.values, closed.cut.lengths
        shorter = np.minimum(lengths[closed.seams], lengths[closed.seams + 1])
        reach = np.minimum(shorter // 2 - 1, closed.window)
        # The last kept frame before each seam, and the first kept frame after it.
        frames, reach = closed.cut.stop[closed.seams][reach >= 0], reach[reach >= 0] + 1
        left, right = frames - reach, frames + reach
        if not len(left) or not values.shape[1]:
            return values
        count = right - left - 1
        index = np.repeat(np.arange(len(left)), count)
        step = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count) + 1

        def velocities(knots: IntArray) -> FloatArray:
            across = space.delta(values[knots - 1], values[knots + 1])
            return 0.5 * across * (right - left)[:, None, None]

        smooth = values.copy()
        smooth[left[index] + step] = space.hermite(
            (values[left[index]], values[right[index]]),
            (velocities(left)[index], velocities(right)[index]),
            step / (right - left)[index],
        )
        return smooth


class _Offset(seams.SeamTreatment):
    """Move both sides of a seam to the mean value and the mean velocity.

    An offset is added on each side: a translation or a rotation vector, cubic in time. Its value
    and velocity fall to 0 within the blend time, and not later than at the other end of the piece.
    Where the offsets of both seams of a short piece overlap, they are added.
    """

    def close(
        self, values: FloatArray, times: seams.PieceTimes, boundaries: seams.SeamBoundaries
    ) -> FloatArray:
        """Return the values with an offset on each side of a seam; each closes half of the gap."""
        space, gaps = boundaries.space, boundaries.gaps()
        velocity_before = space.transport(0.5 * gaps, boundaries.velocity_before)
        velocity_after = space.transport(-0.5 * gaps, boundaries.velocity_after)
        mean = 0.5 * (velocity_before + velocity_after)
        rate_before = space.delta_rate(0.5 * gaps, mean - velocity_before)
        rate_after = space.delta_rate(-0.5 * gaps, mean - velocity_after)
        # At the end of a piece, time is measured backwards, from the seam into the piece.
        return _core.add_offsets(
            values,
            (times.piece, times.seconds, times.seconds_left, times.windows),
            (0.5 * gaps, -rate_before),
            (-0.5 * gaps, rate_after),
        )

    def root_velocity_weights(self, remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
        # They rise to ½ at the seam, with a continuous slope.
        half = 0.25 * remaining * remaining * (3.0 - remaining)
        return half, half


class _Gradient(_Offset):
    """Fit the accelerations, velocities and values near seams to those of the donors.

    Minimises Σ τ⁴ |ẍ - a|² + τ² |ẋ - v|² + |x - d|² per joint, where d, v and a are the value,
    velocity and acceleration of the donors, and τ is `_GRADIENT_SECONDS`. At a seam, d and a are
    the means of both donors. Beside it, half of the difference of their accelerations is added to a
    on the one side and subtracted on the other; it falls linearly to 0 within τ, and not later than
    at the other end of the segment. Frames more than `Config.seam_blend` seconds from all seams,
    and the first and last frame of the motion, are fixed. The solution for all other frames is one
    Gauss-Newton step from the result of `_Offset`; for translations it is exact.

    Derivatives are finite differences of frames. The method is gradient-domain compositing after
    Pérez, Gangnet and Blake (Poisson image editing, 2003); |x - d|² is the screening term of Bhat
    et al. (2008).
    """

    # The influence of a seam falls to 1/e in _GRADIENT_SECONDS / cos(30°), and to 1/10,000 in 9.2
    # times that.
    coupling = 10.6 * _GRADIENT_SECONDS
    uses_next_donor = True

    def smooth(self, closed: seams.ClosedFrames) -> FloatArray:
        """Smooth the values in the frames near seams, in place, and return them."""
        cut = closed.cut
        donors = cut.start, cut.stop, closed.donor_rows, closed.seams, closed.seam_accelerations
        return fit_donors(closed.values, donors, closed.rate, closed.blend)


class _Inertial(seams.SeamTreatment):
    """Add a decaying offset to the motion after a seam; the motion before it is unchanged.

    Inertialisation (Bollo, GDC 2018). The offset is a quintic in time. At the seam it closes the
    gap in value and velocity, and its acceleration is 0. At the end of a window its value,
    velocity and acceleration are 0. The window lasts `Config.seam_blend` seconds, but at most as
    long as the piece, and is shortened if the offset would overshoot 0. All three components of a
    joint share one window.
    """

    is_causal = True

    def close(
        self, values: FloatArray, times: seams.PieceTimes, boundaries: seams.SeamBoundaries
    ) -> FloatArray:
        space, gaps = boundaries.space, boundaries.gaps()
        rate = space.delta_rate(
            -gaps, boundaries.velocity_before - space.transport(-gaps, boundaries.velocity_after)
        )
        value, _ = seams.at_piece_ends(-gaps, times.piece)
        velocity, _ = seams.at_piece_ends(rate, times.piece)
        window = _without_overshoot(value, velocity, times.windows[times.piece][:, None])
        # Quintics with acceleration 0 at both ends of the window.
        u = np.minimum(times.seconds[:, None] / window, 1.0)[..., None]
        scaled = velocity * window[..., None] * u * (1.0 + 3.0 * u)
        offsets = (1.0 - u) ** 3 * (value * (1.0 + u * (3.0 + 6.0 * u)) + scaled)
        return seams.add_deltas(space, values, offsets)

    def root_velocity_weights(self, remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
        # 0 before the seam, and after it a cubic from 1 to 0.
        return np.zeros_like(remaining), remaining * remaining * (3.0 - 2.0 * remaining)


def _without_overshoot(value: FloatArray, velocity: FloatArray, window: FloatArray) -> FloatArray:
    """Return `window`, in seconds, shortened where the offset would overshoot 0.

    The result is at least a third of `window`, even for a small gap and a large velocity
    difference.
    """
    towards_zero = -(value * velocity).sum(axis=-1)
    squared = (value * value).sum(axis=-1)
    overshoots = 5.0 * squared < window * towards_zero
    shorter = np.divide(5.0 * squared, towards_zero, out=np.zeros_like(squared), where=overshoots)
    return np.where(overshoots, np.maximum(shorter, window / 3.0), window)


def fit_donors(
    values: FloatArray,
    donors: tuple[IntArray, IntArray, FloatArray, IntArray, FloatArray],
    rate: float,
    reach: float,
    n_fixed: int = 1,
) -> FloatArray:
    """Minimise the sum that "gradient" has, near seams, by changing `values` in place.

    Returns `values`, whose shape is (n_frames, n_joints, 4 or 3). `donors` has the first and the
    last frame of each segment and, as in `ClosedFrames`, the donor rows, seams and seam
    accelerations. `reach` is the greatest distance of a changed frame from a seam, in frames, and
    `rate` is in frames per second. The first `n_fixed` frames do not change.
    """
    tau = _GRADIENT_SECONDS * rate
    _core.smooth_gradient(values, donors, (1.0, tau**2, tau**4), (reach, n_fixed, tau))
    return values


SEAM_TREATMENTS: dict[str, seams.SeamTreatment] = {
    "gradient": _Gradient(),
    "offset": _Offset(),
    "paper": _Paper(),
    "displacement": _Displacement(),
    "inertial": _Inertial(),
}
"""The treatment of each value of `Config.seam`."""
