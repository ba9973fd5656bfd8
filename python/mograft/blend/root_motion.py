"""The root's way over the floor: how a body goes on where segments that never met follow.

Seams close a gap and come back to what was captured. A root has no gap to close, for each
segment starts where the one before has come to; and what it came back from would have to be
made up for in haste. So the root blends how fast it goes and turns, and keeps where that leads.
"""

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.config import Config
from mograft.motion import rotations

__all__ = ["blend_root_velocity", "integrate_root", "root_velocity_weights", "yaw_rates"]


def root_velocity_weights(
    frames: FloatArray, lengths: IntArray, config: Config, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Return the share that the other side of a seam has in a velocity.

    Parameters
    ----------
    frames : ndarray
        How many frames before the seam, or after it.
    lengths : ndarray of int
        Frames that the segment on this side has; the shapes broadcast.
    config : Config
        Gives `seam` and `seam_blend`.
    rate : float
        Frames per second.

    Returns
    -------
    before, after : ndarray
        0 to ½ on both sides with "offset"; 0 to 1 after and none before with "inertial" and
        "dead", which look not ahead; else none. On a cubic, flat where it is 0 or 1.
    """
    left = np.maximum(1.0 - frames / np.minimum(config.seam_blend * rate, lengths), 0.0)
    if config.seam == "offset":
        half = 0.25 * left * left * (3.0 - left)
        return half, half
    whole = left * left * (3.0 - 2.0 * left) * (config.seam in ("inertial", "dead"))
    return np.zeros_like(whole), whole


def blend_root_velocity(
    steps: FloatArray, cut: Segments, seams: BoolArray, config: Config, rate: float
) -> FloatArray:
    """Fade from the velocity on one side of a seam to that on the other.

    Parameters
    ----------
    steps : ndarray, shape (n, k)
        Velocities from each frame to the next.
    cut : Segments
        Segments that cover the frames, in order of time.
    seams : ndarray of bool, shape (len(cut) - 1,)
        Between which of them there is a seam.
    config, rate
        As for `fading`.

    Returns
    -------
    ndarray, shape (n, k)
        Each velocity a mean of some of those given, by weights of sum 1: none is greater than
        the greatest. Where the other side has no share the same to the bit. Only what is
        between a seam and the next cut changes, so that what a seam does to the way over the
        floor is known from the two segments that it joins.
    """
    own = np.repeat(np.arange(len(cut)), cut.lengths)
    at = np.arange(len(steps), dtype=np.float64) + 0.5
    lengths = cut.lengths[own]
    met = np.concatenate([[False], seams, [False]])
    first = root_velocity_weights(at - cut.start[own], lengths, config, rate)[1] * met[own]
    last = root_velocity_weights(cut.stop[own] - at, lengths, config, rate)[0] * met[own + 1]
    before, after = steps[cut.start[own] - 1], steps[cut.stop[own] % len(steps)]
    faded: FloatArray = steps + first[:, None] * (before - steps) + last[:, None] * (after - steps)
    return faded


def yaw_rates(quats: FloatArray, up: int) -> FloatArray:
    """Return the rotation about the up axis from each frame to the next, in radians."""
    steps = rotations.multiply(quats[1:], rotations.inverse(quats[:-1]))
    rates: FloatArray = rotations.log(rotations.twist(steps, up))[:, up]
    return rates


def integrate_root(
    velocities: FloatArray,
    captured: FloatArray,
    rows: tuple[FloatArray, FloatArray],
    joined: tuple[FloatArray, FloatArray],
    up: int,
) -> tuple[FloatArray, FloatArray]:
    """Lead the root over the floor with velocities of its own.

    Parameters
    ----------
    velocities : ndarray, shape (n - 1, 4)
        From each frame to the next, the way over the floor, where the root faces as in `rows`,
        and the turn about up.
    captured : ndarray, shape (n - 1, 4)
        The same of `rows`.
    rows : tuple of ndarray, shapes (n, 4) and (n, 3)
        The root's rotations and places before seams are closed.
    joined : tuple of ndarray, shapes (n, 4) and (n, 3)
        The same once they are: how the root leans, and how high it is.
    up : int
        The axis that points up.

    Returns
    -------
    rotations : ndarray, shape (n, 4)
        Leaning as joined, and turning about up as it is told to, but never faster than the
        fastest that was captured.
    places : ndarray, shape (n, 3)
        As high as joined, and going over the floor as it is told to.
        From the start to where something is told that was not captured, the same to the bit.
    """
    (turned, placed), (leaning, places) = rows, joined
    off = rotations.twist(rotations.multiply(leaning, rotations.inverse(turned)), up)
    facing = rotations.multiply(rotations.inverse(off), leaning)
    facing = np.where((leaning == turned).all(axis=1, keepdims=True), leaning, facing)
    more = velocities[:, 3] - captured[:, 3]
    # A body that leans otherwise turns otherwise; only a little, but perhaps where it is fastest.
    own = yaw_rates(facing, up)
    most = np.abs(captured[:, 3]).max(initial=0.0)
    more = np.where(np.abs(own + more) > most, np.clip(own + more, -most, most) - own, more)
    yaws = np.concatenate([[0.0], np.cumsum(more)])
    heading = rotations.from_axis_angle(np.eye(3)[up], yaws)
    heading[yaws == 0.0] = rotations.IDENTITY
    quats = np.where(yaws[:, None] == 0.0, facing, rotations.multiply(heading, facing))
    ways = rotations.rotate(heading[:-1], velocities[:, :3]) - captured[:, :3]
    moved = placed + np.concatenate([np.zeros((1, 3)), np.cumsum(ways, axis=0)])
    return quats, np.where(np.arange(3) == up, places, moved)
