"""Seam treatment "gradient": the frames that best keep the accelerations of the donors."""

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.seam_treatments.offset import Offset
from mograft.blend.seams import ClosedFrames

_TIME = 2.0 / 15.0
"""Seconds over which a gap is spread: 4 frames at 30 frames per second.

Of 2 to 8 frames, 4 to 6 made seams least detectable in the clips `dance_*`, `basket` and `bandai`.
"""


def fit_donors(
    values: FloatArray,
    donors: tuple[IntArray, IntArray, FloatArray, IntArray, FloatArray],
    rate: float,
    reach: float,
) -> FloatArray:
    """Minimise the sum that `_Gradient` defines, near seams, by changing `values` in place.

    Returns `values`, whose shape is (n_frames, n_joints, 4 or 3). `donors` has the first and the
    last frame of each segment and, as in `ClosedFrames`, the donor rows, seams and seam
    accelerations. `reach` is the greatest distance of a changed frame from a seam, in frames, and
    `rate` is in frames per second.
    """
    tau = _TIME * rate
    _core.smooth_gradient(values, donors, (1.0, tau**2, tau**4), reach)
    return values


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
    uses_next_donor = True

    def smooth(self, closed: ClosedFrames) -> FloatArray:
        """Smooth the values in the frames near seams, in place, and return them."""
        cut = closed.cut
        donors = cut.start, cut.stop, closed.donor_rows, closed.seams, closed.seam_accelerations
        return fit_donors(closed.values, donors, closed.rate, closed.blend)


TREATMENT = _Gradient()
