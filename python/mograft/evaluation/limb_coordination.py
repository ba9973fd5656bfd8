"""Coordination of the arms with the opposite legs."""

import math

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.body.anatomy import anatomy
from mograft.body.mass import up_axis
from mograft.body.support_polygon import normalize
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_MAX_LAG_SECONDS = 0.5


def coordination(motion: Motion) -> tuple[float, float]:
    """Return how strongly arms and opposite legs swing together, and the time lag between them.

    The first result is the absolute correlation between the rates at which an upper arm and the
    opposite thigh swing forward. The second result is the absolute time shift in seconds, up to
    0.5 s, at which this correlation is strongest. Both are means over the two pairs of limbs. They
    are NaN if a limb is unknown or does not move, or if the motion is shorter than about a second.
    """
    pairs = _opposite_limbs(motion.skeleton)
    if not pairs or motion.n_frames < 8:
        return math.nan, math.nan
    positions = motion.world_positions()
    up = np.eye(3)[up_axis(motion)]
    (_, (right, _)), (_, (left, _)) = pairs
    forward = normalize(np.cross(positions[:, left] - positions[:, right], up))
    found = []
    max_lag = max(round(_MAX_LAG_SECONDS * motion.rate), 1)
    for pair in pairs:
        # Forward components of unit vectors, since angles could wrap around.
        a, b = (
            np.gradient((normalize(positions[:, end] - positions[:, top]) * forward).sum(axis=1))
            for top, end in pair
        )
        if a.std() < 1e-9 or b.std() < 1e-9 or len(a) < 2 * max_lag + 4:
            return math.nan, math.nan
        lags = np.arange(-max_lag, max_lag + 1)
        strengths = np.abs([_correlation(a, b, int(lag)) for lag in lags])
        strongest = abs(int(lags[strengths.argmax()])) * motion.frame_time
        found.append((strengths[max_lag], strongest))
    correlation, lag = np.mean(found, axis=0)
    return float(correlation), float(lag)


def _correlation(a: FloatArray, b: FloatArray, lag: int) -> float:
    x, y = (a[lag:], b[: len(b) - lag]) if lag >= 0 else (a[:lag], b[-lag:])
    spread = x.std() * y.std()
    return float(((x - x.mean()) * (y - y.mean())).mean() / spread) if spread > 0 else 0.0


def _opposite_limbs(skeleton: Skeleton) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return, for each arm, the joints at both ends of the upper arm and of the opposite thigh."""
    known = anatomy(skeleton)
    pairs = []
    for arm_side, leg_side in (("left", "right"), ("right", "left")):
        side_of = {"upper_arm": arm_side, "forearm": arm_side, "thigh": leg_side, "shank": leg_side}
        ends = [known.joints(part, side=side) for part, side in side_of.items()]
        if not (known.human and all(ends)):
            return []
        upper, fore, thigh, shank = (int(joints[0]) for joints in ends)
        pairs.append(((upper, fore), (thigh, shank)))
    return pairs
