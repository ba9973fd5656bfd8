"""Seam treatment "paper": displacement, then a cubic through the frames at the seam (4.5)."""

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.seam_treatments.displacement import Displacement
from mograft.blend.seams import ClosedFrames
from mograft.motion.segments import Segments


class _Paper(Displacement):
    """Displace segments as `Displacement` does, then replace the frames near seams by a cubic.

    The paper replaces 5 frames on each side of a seam. Here their number is `Config.seam_window`,
    but at most one frame less than half of the shorter segment, so that two windows never overlap.
    Seams next to a segment of one frame interval are not smoothed.
    """

    def smooth(self, closed: ClosedFrames) -> FloatArray:
        """Return the values, with those in a window around each seam replaced by a cubic."""
        space, values = closed.space, closed.values
        left, right = smoothing_windows(closed.cut, closed.seams, closed.window)
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


def smoothing_windows(cut: Segments, seams: IntArray, window: int) -> tuple[IntArray, IntArray]:
    """Return the last kept frame before each seam and the first kept frame after it.

    The frames between the two are replaced.

    `window` is the maximum number of replaced frames on each side of a seam. Seams next to a
    segment of one frame interval have no entry.
    """
    reach = np.minimum(np.minimum(cut.lengths[seams], cut.lengths[seams + 1]) // 2 - 1, window)
    frames = cut.stop[seams][reach >= 0]
    reach = reach[reach >= 0]
    return frames - (reach + 1), frames + (reach + 1)


TREATMENT = _Paper()
