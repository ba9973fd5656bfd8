"""Seam treatment "inertial": a decaying offset after the seam only."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.seams import (
    PieceTimes,
    SeamBoundaries,
    SeamTreatment,
    add_deltas,
    at_piece_ends,
    crossfade_after,
)


class _Inertial(SeamTreatment):
    """Add a decaying offset to the motion after a seam; the motion before it is unchanged.

    Inertialisation (Bollo, GDC 2018). The offset is a quintic in time. At the seam it closes the
    gap in value and velocity, and its acceleration is 0. At the end of a window its value,
    velocity and acceleration are 0. The window lasts `Config.seam_blend` seconds, but at most as
    long as the piece, and is shortened if the offset would overshoot 0. All three components of a
    joint share one window.
    """

    is_causal = True
    is_velocity_continuous = True
    root_velocity_weights = staticmethod(crossfade_after)

    def close(
        self, values: FloatArray, times: PieceTimes, boundaries: SeamBoundaries
    ) -> FloatArray:
        space, gaps = boundaries.space, boundaries.gaps()
        rate = space.delta_rate(
            -gaps, boundaries.velocity_before - space.transport(-gaps, boundaries.velocity_after)
        )
        value, _ = at_piece_ends(-gaps, times.piece)
        velocity, _ = at_piece_ends(rate, times.piece)
        window = _without_overshoot(value, velocity, times.windows[times.piece][:, None])
        offsets = _decay(value, velocity, times.seconds, window)
        return add_deltas(space, values, offsets)


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


def _decay(
    value: FloatArray, velocity: FloatArray, seconds: FloatArray, window: FloatArray
) -> FloatArray:
    """Return offsets, `seconds` after a seam, that decay from a value and velocity to 0.

    They are quintics with acceleration 0 at both ends of `window`, in seconds, (n, n_joints).
    """
    u = np.minimum(seconds[:, None] / window, 1.0)[..., None]
    scaled = velocity * window[..., None]
    return (1.0 - u) ** 3 * (value * (1.0 + u * (3.0 + 6.0 * u)) + scaled * u * (1.0 + 3.0 * u))


TREATMENT = _Inertial()
