"""Seam treatment "dead": a cross-fade, after the seam, from the extrapolated previous motion."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.seams import PieceTimes, SeamBoundaries, SeamTreatment, crossfade_after

_MIN_HALF_LIFE, _MAX_HALF_LIFE = 0.05, 1.0  # of the extrapolated velocity, in seconds


class _Dead(SeamTreatment):
    """After a seam, cross-fade from the extrapolated previous motion to the next motion.

    Dead blending (Holden 2023). The velocity of the extrapolation decays. The half-life of each
    velocity component is the time in which the velocity would cover the gap, clipped to 0.05 to
    1 s; it is 0.05 s if the joint moves away from its target.
    """

    is_causal = True
    is_velocity_continuous = True

    def close(
        self, values: FloatArray, times: PieceTimes, boundaries: SeamBoundaries
    ) -> FloatArray:
        space, gaps = boundaries.space, boundaries.gaps()
        velocity = boundaries.velocity_before
        half_life = gaps / np.where(np.abs(velocity) < 1e-9, 1e-9, velocity)
        decay = np.log(2.0) / np.clip(half_life, _MIN_HALF_LIFE, _MAX_HALF_LIFE)
        seam = times.piece - 1
        window = times.windows[times.piece]
        is_fading = (seam >= 0) & (times.seconds < window)
        seam, seconds = seam[is_fading], times.seconds[is_fading][:, None, None]
        distance = velocity[seam] / decay[seam] * -np.expm1(-decay[seam] * seconds)
        extrapolated = space.add(boundaries.before[seam], distance)
        share = seconds / window[is_fading][:, None, None]
        share = share * share * (3.0 - 2.0 * share)
        given = values[is_fading]
        faded = space.add(extrapolated, share * space.delta(extrapolated, given))
        is_met = (gaps == 0.0).all(axis=-1)
        is_met &= (boundaries.velocity_before == boundaries.velocity_after).all(axis=-1)
        closed = values.copy()
        closed[is_fading] = np.where(is_met[seam][..., None], given, faded)
        return closed

    def root_velocity_weights(self, remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
        return crossfade_after(remaining)


TREATMENT = _Dead()
