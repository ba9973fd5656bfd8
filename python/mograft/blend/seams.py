"""Seams: how pieces of clips that never met are made to meet (paper, 4.5).

Every treatment but the paper's is a curve in continuous time: it is told at which moments it
is wanted. It works on rotations and on translations alike: see `mograft.blend.value_spaces`.
"""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.value_spaces import ValueSpace

__all__ = [
    "PieceTimes",
    "SeamBoundaries",
    "dead",
    "displacement",
    "inertial",
    "offset",
]

_LIVELY = 1.0
"""Half-life in seconds, at most, of the speed that "dead" goes on with."""
_FADING = 0.05
"""And at least: that of a joint that moves away from where it must go."""


@dataclass(frozen=True, eq=False)
class PieceTimes:
    """When, in a row of pieces, a motion is wanted.

    Attributes
    ----------
    piece : ndarray of int, shape (n,)
        The piece of each moment.
    since : ndarray, shape (n,)
        Seconds from the piece's start.
    durations : ndarray, shape (n_pieces,)
        Seconds that each piece lasts.
    """

    piece: IntArray
    seconds: FloatArray
    durations: FloatArray

    @property
    def seconds_left(self) -> FloatArray:
        """Seconds to the end of each moment's piece."""
        return self.durations[self.piece] - self.seconds


@dataclass(frozen=True, eq=False)
class SeamBoundaries:
    """What meets at the seams between pieces, one row each.

    Attributes
    ----------
    before, after : ndarray, shape (n_pieces - 1, n_joints, 4 or 3)
        The last value of the piece before and the first of the piece after.
    leaving, arriving : ndarray, shape (n_pieces - 1, n_joints, 3)
        Their velocities there, per second; of rotations in the body's own frame.
    """

    before: FloatArray
    after: FloatArray
    velocity_before: FloatArray
    velocity_after: FloatArray

    def gaps(self, algebra: ValueSpace) -> FloatArray:
        """Return the way across each seam; exactly 0 where the values are the same to the bit."""
        ways = algebra.delta(self.before, self.after)
        ways[(self.before == self.after).all(axis=-1)] = 0.0
        return ways


def displacement(
    algebra: ValueSpace, values: FloatArray, at: PieceTimes, ends: SeamBoundaries
) -> FloatArray:
    """Move both sides of a seam half way, the change fading evenly over the pieces.

    Parameters
    ----------
    algebra : Algebra
        `ROTATIONS` for rotations, `TRANSLATIONS` for translations.
    values : ndarray, shape (n, n_joints, 4 or 3)
        What the pieces do at the moments.
    at : PieceTimes
        The moments.
    ends : SeamBoundaries
        What meets at the seams.

    Returns
    -------
    ndarray, shape of `values`
        Without a gap at the seams; velocities may jump there. Where nothing is to be changed
        the value is the same to the bit: so in all treatments.

    Notes
    -----
    Displacement mapping, linear in the logarithm (paper, 4.5).
    """
    half = 0.5 * ends.gaps(algebra)
    share = (at.seconds / at.durations[at.piece])[:, None, None]
    first, last = _beside(half, at.piece)
    return _moved(algebra, values, share * last - (1.0 - share) * first)


def offset(
    algebra: ValueSpace, values: FloatArray, at: PieceTimes, ends: SeamBoundaries, blend: float
) -> FloatArray:
    """Let both sides of a seam meet half way, in pose and in velocity.

    Parameters
    ----------
    algebra, values, at, ends
        As for `displacement`.
    blend : float
        Seconds on either side of a seam in which something changes, at most; never more than
        the piece lasts.

    Returns
    -------
    ndarray, shape of `values`
        Without a jump in value or velocity, at the seams and where their influence ends.

    Notes
    -----
    The offset is a cubic in the logarithm that starts as the seam demands and ends at 0 with
    velocity 0. With both seams of a short piece in reach, the offsets add up; each is 0 with
    its velocity at the other seam.
    """
    ways = ends.gaps(algebra)
    leaving = algebra.transport(0.5 * ways, ends.velocity_before)
    arriving = algebra.transport(-0.5 * ways, ends.velocity_after)
    middle = 0.5 * (leaving + arriving)
    before = algebra.delta_rate(0.5 * ways, middle - leaving)
    after = algebra.delta_rate(-0.5 * ways, middle - arriving)
    first, last = _beside(ways, at.piece)
    first_velocity, last_velocity = _beside(after, at.piece)[0], _beside(before, at.piece)[1]
    window = np.minimum(blend, at.durations)[at.piece]
    # The end of a piece is seen backwards, from the seam into the piece.
    offsets = _cubic(-0.5 * first, first_velocity, at.seconds, window)
    offsets += _cubic(0.5 * last, -last_velocity, at.seconds_left, window)
    return _moved(algebra, values, offsets)


def inertial(
    algebra: ValueSpace, values: FloatArray, at: PieceTimes, ends: SeamBoundaries, blend: float
) -> FloatArray:
    """Leave the piece before a seam as it is, and let the one after start from there.

    Parameters
    ----------
    algebra, values, at, ends, blend
        As for `offset`.

    Returns
    -------
    ndarray, shape of `values`
        Without a jump in value or velocity, and with no look ahead: what was before a seam
        never changes, as a motion that is being played demands.

    Notes
    -----
    Inertialisation (Bollo, GDC 2018): the offset is the quintic with zero value, velocity and
    acceleration at its end and zero acceleration at the seam; sooner over where it would
    swing to the other side. Here it is one for the three components, so that they all meet.
    """
    ways = ends.gaps(algebra)
    start = algebra.delta_rate(
        -ways, ends.velocity_before - algebra.transport(-ways, ends.velocity_after)
    )
    none = np.zeros((1, *ways.shape[1:]))  # before the first piece there is no seam
    value, velocity = np.concatenate([none, -ways]), np.concatenate([none, start])
    window = np.minimum(blend, at.durations)[:, None]
    towards = -(value * velocity).sum(axis=-1)
    squared = (value * value).sum(axis=-1)
    # Not at once, though, where a joint hardly has a way to go but comes at another speed.
    swings = 5.0 * squared < window * towards
    sooner = np.divide(5.0 * squared, towards, out=np.zeros_like(squared), where=swings)
    window = np.where(swings, np.maximum(sooner, window / 3.0), window)
    offsets = _quintic(value[at.piece], velocity[at.piece], at.seconds, window[at.piece])
    return _moved(algebra, values, offsets)


def dead(
    algebra: ValueSpace, values: FloatArray, at: PieceTimes, ends: SeamBoundaries, blend: float
) -> FloatArray:
    """Let the piece before a seam go on, slowing down, and fade over to the one after.

    Parameters
    ----------
    algebra, values, at, ends, blend
        As for `offset`.

    Returns
    -------
    ndarray, shape of `values`
        Without a jump in value or velocity, and with no look ahead.

    Notes
    -----
    Dead blending (Holden 2023). A joint's velocity halves the sooner the less it leads to
    where the joint must go.
    """
    ways = ends.gaps(algebra)
    velocity = ends.velocity_before
    # How long the velocity would take to cover the way, axis by axis.
    takes = ways / np.where(np.abs(velocity) < 1e-9, 1e-9, velocity)
    decay = np.log(2.0) / np.clip(takes, _FADING, _LIVELY)
    seam = at.piece - 1
    window = np.minimum(blend, at.durations)[at.piece]
    fading = (seam >= 0) & (at.seconds < window) if len(ways) else np.zeros(len(values), bool)
    joined = values.copy()
    seam, since = seam[fading], at.seconds[fading][:, None, None]
    on = velocity[seam] / decay[seam] * -np.expm1(-decay[seam] * since)
    going = algebra.add(ends.before[seam], on)
    share = since / window[fading][:, None, None]
    share = share * share * (3.0 - 2.0 * share)
    own = values[fading]
    met = algebra.add(going, share * algebra.delta(going, own))
    same = (ways == 0.0).all(axis=-1) & (ends.velocity_before == ends.velocity_after).all(axis=-1)
    joined[fading] = np.where(same[seam][..., None], own, met)
    return joined


def _beside(per_seam: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return what belongs to the seam before and the one after each moment's piece, 0 at ends."""
    none = np.zeros((1, *per_seam.shape[1:]))
    return np.concatenate([none, per_seam])[piece], np.concatenate([per_seam, none])[piece]


def _cubic(
    value: FloatArray, velocity: FloatArray, time: FloatArray, window: FloatArray
) -> FloatArray:
    """Go from a value and velocity to none within a window, and stay there."""
    u = np.minimum(time / window, 1.0)[:, None, None]
    c = velocity * window[:, None, None]
    # By (1 - u)², so that it is exactly 0 at the end.
    fallen: FloatArray = (1.0 - u) ** 2 * (value * (1.0 + 2.0 * u) + c * u)
    return fallen


def _quintic(
    value: FloatArray, velocity: FloatArray, time: FloatArray, window: FloatArray
) -> FloatArray:
    """As `_cubic`, with no acceleration at either end; a window for each joint."""
    u = np.minimum(time[:, None] / window, 1.0)[..., None]
    c = velocity * window[..., None]
    fallen: FloatArray = (1.0 - u) ** 3 * (
        value * (1.0 + u * (3.0 + 6.0 * u)) + c * u * (1.0 + 3.0 * u)
    )
    return fallen


def _moved(algebra: ValueSpace, values: FloatArray, ways: FloatArray) -> FloatArray:
    """Move values by ways; where there is none, leave every bit."""
    x, y, z = np.moveaxis(ways == 0.0, -1, 0)
    moved = algebra.add(values, ways)
    np.copyto(moved, values, where=(x & y & z)[..., None])
    return moved
