"""Seam treatment "displacement": the gap spread linearly over both segments (paper, 4.5)."""

from mograft._util.arrays import FloatArray
from mograft.blend.seams import PieceTimes, SeamBoundaries, SeamTreatment, add_deltas, at_piece_ends


class Displacement(SeamTreatment):
    """Move both sides of a seam by half of the gap; the displacement falls to 0 over the segment.

    Displacement mapping (paper, 4.5): a translation or a rotation vector, linear in time.
    Velocities jump at the seam.
    """

    is_causal = False
    is_velocity_continuous = False
    spans_segments = True

    def close(
        self, values: FloatArray, times: PieceTimes, boundaries: SeamBoundaries
    ) -> FloatArray:
        """Return the values with each gap closed by displacing both segments at the seam.

        The displacement of a segment is half of the gap at the seam. It falls linearly to 0 at the
        other end of the segment.
        """
        half = 0.5 * boundaries.gaps()
        share = (times.seconds / times.durations[times.piece])[:, None, None]
        start, end = at_piece_ends(half, times.piece)
        return add_deltas(boundaries.space, values, share * end - (1.0 - share) * start)


TREATMENT = Displacement()
