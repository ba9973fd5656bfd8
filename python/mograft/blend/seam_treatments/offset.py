"""Seam treatment "offset": a decaying offset on both sides of the seam."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.blend.seams import (
    PieceTimes,
    SeamBoundaries,
    SeamTreatment,
    add_deltas,
    at_piece_ends,
    crossfade_both_sides,
)


class Offset(SeamTreatment):
    """Move both sides of a seam to the mean value and the mean velocity.

    An offset is added on each side: a translation or a rotation vector, cubic in time. Its value
    and velocity fall to 0 at the end of the blend time, at the latest at the other end of the
    piece. Where the offsets of both seams of a short piece overlap, they are added.
    """

    is_causal = False
    is_velocity_continuous = True

    def close(
        self, values: FloatArray, times: PieceTimes, boundaries: SeamBoundaries
    ) -> FloatArray:
        """Return the values with an offset on each side of a seam; each closes half of the gap."""
        space, gaps = boundaries.space, boundaries.gaps()
        velocity_before = space.transport(0.5 * gaps, boundaries.velocity_before)
        velocity_after = space.transport(-0.5 * gaps, boundaries.velocity_after)
        mean = 0.5 * (velocity_before + velocity_after)
        rate_before = space.delta_rate(0.5 * gaps, mean - velocity_before)
        rate_after = space.delta_rate(-0.5 * gaps, mean - velocity_after)
        start_gap, end_gap = at_piece_ends(gaps, times.piece)
        start_rate = at_piece_ends(rate_after, times.piece)[0]
        end_rate = at_piece_ends(rate_before, times.piece)[1]
        window = times.windows[times.piece]
        # At the end of a piece, time is measured backwards, from the seam into the piece.
        offsets = _decay(-0.5 * start_gap, start_rate, times.seconds, window)
        offsets += _decay(0.5 * end_gap, -end_rate, times.seconds_left, window)
        return add_deltas(space, values, offsets)

    def root_velocity_weights(self, remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return weights that rise to ½ at the seam on both sides."""
        return crossfade_both_sides(remaining)


def _decay(
    value: FloatArray, velocity: FloatArray, seconds: FloatArray, window: FloatArray
) -> FloatArray:
    """Return offsets, `seconds` from a seam: cubics from a value and velocity to 0."""
    u = np.minimum(seconds / window, 1.0)[:, None, None]
    offset: FloatArray = velocity * window[:, None, None]
    offset *= u
    offset += value * (1.0 + 2.0 * u)
    # This factor makes it exactly 0 at the end.
    offset *= (1.0 - u) ** 2
    return offset


TREATMENT = Offset()
