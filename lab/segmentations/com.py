"""Cut frames at the lowest points of the centre of mass, and at take-offs and landings."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from mograft.body.contacts import CONTACT_HEIGHT, Ground
from mograft.body.mass import center_of_mass


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
    """

    smoothing: float = 0.05
    min_depth: float = 0.005
    min_flight: float = 0.1
    min_rise: float = 0.004


def cut_frames(motion, parameters):
    """Return the lowest points of the centre of mass, and the first and last frame of each flight.

    A lowest point within a flight is no cut frame. Without feet there are no flights.
    """
    ground = Ground.of(motion)
    heights = center_of_mass(motion) @ ground.up / ground.height
    curve = gaussian_filter1d(heights, parameters.smoothing * motion.rate)
    points = ground.points(motion)
    is_low = ground.above(points) < CONTACT_HEIGHT * ground.height
    n_low = np.count_nonzero(is_low, axis=(1, 2))
    is_airborne = (n_low == 0) & (is_low.shape[1] > 0)
    flights = _find_flights(is_airborne, heights, motion.rate, parameters)
    lows = find_peaks(-curve, prominence=parameters.min_depth)[0]
    is_within = ((lows[:, None] > flights[:, 0]) & (lows[:, None] < flights[:, 1])).any(axis=1)
    cuts = np.unique(np.concatenate([lows[~is_within], flights.ravel()]))
    return cuts[(cuts > 0) & (cuts < motion.n_frames - 1)]


def _find_flights(is_airborne, heights, rate, parameters):
    """Return the first and last frame of each flight, shape (n_flights, 2).

    A flight is a run of frames without a low foot that begins and ends within the motion and lasts
    at least `min_flight`. In it, the centre of mass rises by at least `min_rise` above the straight
    line between its heights at the ends of the run.
    """
    found = []
    changes = np.diff(is_airborne.astype(np.int8), prepend=0, append=0)
    for start, stop in np.flatnonzero(changes).reshape(-1, 2).tolist():
        if start == 0 or stop == len(heights) or stop - start < parameters.min_flight * rate:
            continue
        line = np.linspace(heights[start], heights[stop - 1], stop - start)
        if (heights[start:stop] - line).max() >= parameters.min_rise:
            found.append((start, stop - 1))
    return np.array(found, np.int64).reshape(-1, 2)
