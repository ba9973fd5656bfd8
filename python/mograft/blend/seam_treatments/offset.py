"""Seam treatment "offset": a decaying offset on both sides of the seam."""

from mograft import _core
from mograft._util.arrays import FloatArray
from mograft.blend.seams import PieceTimes, SeamBoundaries, SeamTreatment, crossfade_both_sides


class Offset(SeamTreatment):
    """Move both sides of a seam to the mean value and the mean velocity.

    An offset is added on each side: a translation or a rotation vector, cubic in time. Its value
    and velocity fall to 0 within the blend time, and not later than at the other end of the piece.
    Where the offsets of both seams of a short piece overlap, they are added.
    """

    is_causal = False
    is_velocity_continuous = True
    root_velocity_weights = staticmethod(crossfade_both_sides)

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
        # At the end of a piece, time is measured backwards, from the seam into the piece.
        return _core.add_offsets(
            values,
            (times.piece, times.seconds, times.seconds_left, times.windows),
            (0.5 * gaps, -rate_before),
            (-0.5 * gaps, rate_after),
        )


TREATMENT = Offset()
