"""Cut frames at the lowest points of the centre of mass, and at take-offs and landings."""

from dataclasses import dataclass, fields

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.gaussian import gaussian_filter
from mograft._util.runs import find_runs
from mograft._util.validate import check_not_negative
from mograft.analysis.segmentation_method import SegmentationMethod
from mograft.body.contacts import CONTACT_HEIGHT, Ground
from mograft.body.mass import center_of_mass
from mograft.motion.motion import Motion


@dataclass(frozen=True)
class ComParameters:
    """Parameters of the method "com".

    Parameters
    ----------
    smoothing : float
        Standard deviation, in seconds, of the Gaussian that smooths the height of the centre of
        mass.
    min_depth : float
        Smallest rise of the centre of mass before and after a lowest point, in skeleton heights;
        points with a smaller rise are no cut frames. In walking, the centre of mass rises by about
        0.025 heights.
    min_flight : float
        Shortest flight, in seconds.
    min_rise : float
        Smallest distance by which the centre of mass rises in a flight above the straight line from
        take-off to landing, in skeleton heights. In free fall it is g T² / 8 after T seconds.

    Raises
    ------
    TypeError, ValueError
        If a value is not a number, or is negative.
    """

    smoothing: float = 0.05
    min_depth: float = 0.005
    min_flight: float = 0.1
    min_rise: float = 0.004

    def __post_init__(self) -> None:
        for field in fields(self):
            check_not_negative(self, field.name)


def cut_frames(motion: Motion, parameters: ComParameters) -> IntArray:
    """Return the lowest points of the centre of mass, and the first and last frame of each flight.

    A lowest point within a flight is no cut frame. Without feet there are no flights.
    """
    ground = Ground.of(motion)
    heights = center_of_mass(motion) @ ground.up / ground.height
    curve = gaussian_filter(heights, parameters.smoothing * motion.rate)
    points = ground.points(motion)
    is_low = ground.above(points) < CONTACT_HEIGHT * ground.height
    n_low = np.count_nonzero(is_low, axis=(1, 2))
    is_airborne = (n_low == 0) & (is_low.shape[1] > 0)
    flights = _find_flights(is_airborne, heights, motion.rate, parameters)
    lows = find_lowest_points(curve, parameters.min_depth)
    is_within = ((lows[:, None] > flights[:, 0]) & (lows[:, None] < flights[:, 1])).any(axis=1)
    cuts = np.unique(np.concatenate([lows[~is_within], flights.ravel()]))
    return cuts[(cuts > 0) & (cuts < motion.n_frames - 1)]


def _find_flights(
    is_airborne: BoolArray, heights: FloatArray, rate: float, parameters: ComParameters
) -> IntArray:
    """Return the first and last frame of each flight, shape (n_flights, 2).

    A flight is a run of frames without a low foot that begins and ends within the motion and lasts
    at least `min_flight`. In it, the centre of mass rises by at least `min_rise` above the straight
    line between its heights at the ends of the run.
    """
    found = []
    for start, stop in find_runs(is_airborne).tolist():
        if start == 0 or stop == len(heights) or stop - start < parameters.min_flight * rate:
            continue
        line = np.linspace(heights[start], heights[stop - 1], stop - start)
        if (heights[start:stop] - line).max() >= parameters.min_rise:
            found.append((start, stop - 1))
    return np.array(found, np.int64).reshape(-1, 2)


def find_lowest_points(curve: FloatArray, min_depth: float) -> IntArray:
    """Return the frames of the minima on both sides of which a curve rises by `min_depth` or more.

    Between two of them the curve rises by at least `min_depth` above both. Of frames with equal
    values the first is returned. The ends of the curve are not returned.
    """
    steps = np.diff(curve)
    nonzero = np.flatnonzero(steps)
    if not len(nonzero):
        return np.zeros(0, np.int64)
    is_turn = np.sign(steps[nonzero[1:]]) != np.sign(steps[nonzero[:-1]])
    turns = np.concatenate([[0], nonzero[:-1][is_turn] + 1, [len(curve) - 1]])
    found = []
    highest, lowest = float(curve[0]), -1  # since the last minimum; frame of the candidate
    for frame, value in zip(turns.tolist(), curve[turns].tolist(), strict=True):
        if lowest < 0:
            if value > highest:
                highest = value
            elif highest - value >= min_depth and value < highest:
                lowest = frame
        elif value < curve[lowest]:
            lowest = frame
        elif value - curve[lowest] >= min_depth and value > curve[lowest]:
            if lowest < len(curve) - 1:
                found.append(lowest)
            highest, lowest = value, -1
    return np.array(found, np.int64)


# The centre of mass must rise after a lowest point, and a flight must end.
METHOD = SegmentationMethod(ComParameters, cut_frames, look_ahead=0.8)
