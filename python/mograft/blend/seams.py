"""Values and velocities at seams, of rotations or translations; the interface of a treatment.

The paper's method is in section 4.5. A *piece* is the donor motion between two successive seams.
Treatments are functions of continuous time, so that they can be evaluated between frames.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.motion import rotations
from mograft.motion.segments import Segments

Pair: TypeAlias = tuple[FloatArray, FloatArray]


class ValueSpace:
    """Operations on rotations or on translations, called values, and on their differences.

    Values have shape (..., 4) or (..., 3). A delta is the difference from one value to another, a
    velocity the rate of change of a value; both have shape (..., 3). The base class has the
    operations on translations, which are vectors.
    """

    def delta(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the shortest delta from `start` to `end`."""
        return end - start

    def add(self, start: FloatArray, delta: FloatArray) -> FloatArray:
        """Return the value that differs from `start` by `delta`."""
        return start + delta

    def transport(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return the velocity of a value after the constant `delta` is added to it."""
        return velocity

    def delta_rate(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return the rate of change of a delta whose end moves with a velocity."""
        return velocity

    def hermite(self, values: Pair, velocities: Pair, t: FloatArray) -> FloatArray:
        """Return cubics at `t`, 0 to 1, from values and velocities (per unit of t) at both ends."""
        t = t[:, None, None]
        s = 1.0 - t
        return (
            values[0] * (s * s * (1.0 + 2.0 * t))
            + values[1] * (t * t * (1.0 + 2.0 * s))
            + velocities[0] * (t * s * s)
            - velocities[1] * (t * t * s)
        )


class _Rotations(ValueSpace):
    """Unit quaternions, xyzw; deltas are rotation vectors in the local axes of the joint."""

    def delta(self, start: FloatArray, end: FloatArray) -> FloatArray:
        return rotations.log(rotations.multiply(rotations.inverse(start), end))

    def add(self, start: FloatArray, delta: FloatArray) -> FloatArray:
        return rotations.multiply(start, rotations.exp(delta))

    def transport(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:
        return rotations.rotate(rotations.inverse(rotations.exp(delta)), velocity)

    def delta_rate(self, delta: FloatArray, velocity: FloatArray) -> FloatArray:
        # The inverse of the right Jacobian of exp; its last factor tends to 1/12 at 0.
        angle = np.linalg.norm(delta, axis=-1, keepdims=True)
        is_small = angle < 1e-4
        safe = np.where(is_small, 1.0, angle)
        factor = np.where(is_small, 1.0 / 12.0, 1.0 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)))
        product = _cross(delta, velocity)
        return velocity + 0.5 * product + factor * _cross(delta, product)

    def hermite(self, values: Pair, velocities: Pair, t: FloatArray) -> FloatArray:
        shape = values[0].shape
        a, b = (own.reshape(-1, 4) for own in values)
        u, v = (own.reshape(-1, 3) for own in velocities)
        return rotations.hermite(a, b, u, v, np.repeat(t, shape[1])).reshape(shape)


ROTATIONS = _Rotations()
TRANSLATIONS = ValueSpace()


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product; faster than `np.cross` for a few vectors."""
    product: FloatArray = np.empty_like(b)
    for k, m, n in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., k] = a[..., m] * b[..., n] - a[..., n] * b[..., m]
    return product


@dataclass(frozen=True, eq=False)
class PieceTimes:
    """n points in time, each given as a piece and the seconds since its start.

    A piece is the motion between two successive seams.
    """

    piece: IntArray  # (n,): index of the piece
    seconds: FloatArray  # (n,): seconds since the start of that piece
    durations: FloatArray  # (n_pieces,): duration of every piece in seconds
    blend: float  # `Config.seam_blend` in seconds

    @property
    def seconds_left(self) -> FloatArray:
        """Seconds to the end of the piece, shape (n,)."""
        return self.durations[self.piece] - self.seconds

    @property
    def windows(self) -> FloatArray:
        """The smaller of `blend` and the piece's duration, in seconds, shape (n_pieces,)."""
        return np.minimum(self.blend, self.durations)


@dataclass(frozen=True, eq=False)
class SeamBoundaries:
    """Values and velocities on both sides of the seams between successive pieces.

    Values have shape (n_pieces - 1, n_joints, 4 or 3), velocities (n_pieces - 1, n_joints, 3).
    Velocities are per second; angular velocities are in the joint's local axes.
    """

    space: ValueSpace  # `ROTATIONS` or `TRANSLATIONS`
    before: FloatArray  # last value of the piece before the seam
    after: FloatArray  # first value of the piece after it
    velocity_before: FloatArray
    velocity_after: FloatArray
    # (2, n_seams, n_joints, 3): of the donors before the seams and of those after them, per frame²,
    # in the axes of their clips; empty if unknown.
    accelerations: FloatArray = field(default_factory=lambda: np.zeros((2, 0, 0, 3)))

    def gaps(self) -> FloatArray:
        """Return the delta from the value before each seam to that after it; 0 if equal."""
        gaps = self.space.delta(self.before, self.after)
        gaps[(self.before == self.after).all(axis=-1)] = 0.0
        return gaps


class SeamTreatment(ABC):
    """A method that changes the motion near a seam so that two pieces meet without a gap.

    Implementations are in `mograft.blend.seam_treatments`. They have no state.
    """

    is_causal: ClassVar[bool] = False  # frames before a seam never change; `Stream` needs this
    # Which frames `close` changes. True: all of the two segments that meet, and every boundary
    # between segments is treated as a seam. False: those within `Config.seam_blend` seconds of a
    # seam, on the sides that the treatment changes, at most to the end of the piece.
    spans_segments: ClassVar[bool] = False
    # Seconds beyond `Config.seam_blend` within which other seams affect the frames near a seam.
    coupling: ClassVar[float] = 0.0

    # Whether `Stream` chooses the donor after a seam in advance and smooths the seam with the
    # method "gradient". Otherwise, `Stream` replaces treatments that are not causal by "inertial".
    uses_next_donor: ClassVar[bool] = False

    @abstractmethod
    def close(
        self, values: FloatArray, times: PieceTimes, boundaries: SeamBoundaries
    ) -> FloatArray:
        """Return the values with all gaps at seams closed.

        `values`, shape (n, n_joints, 4 or 3), are the pieces' rotations or translations at the n
        points in time `times`. `boundaries` are the seams between the pieces. The result has the
        shape of `values` and is continuous at the seams. A value depends on the seams at both ends
        of its piece only. A value that needs no change is returned bit for bit.
        """

    def root_velocity_weights(self, remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return two weights of the other donor's root velocity: before a seam and after it.

        The root velocity near a seam is a weighted mean of the captured velocity and of the
        velocity that the donor on the other side has at the seam. `remaining` is 1 at the seam and
        falls to 0 at the end of the blend time. Both weights have the shape of `remaining` and are
        0 where `remaining` is 0. Their sum at the seam is 1, or 0 if the treatment does not blend
        root velocities, as here.
        """
        return np.zeros_like(remaining), np.zeros_like(remaining)

    def smooth(self, closed: "ClosedFrames") -> FloatArray:
        """Return the values after a final pass over all frames; the base class changes nothing.

        The pass may change `closed.values` in place.
        """
        return closed.values


@dataclass(frozen=True, eq=False)
class ClosedFrames:
    """The rotations or translations of all frames after `SeamTreatment.close`."""

    space: ValueSpace  # `ROTATIONS` or `TRANSLATIONS`
    values: FloatArray  # (n_frames, n_joints, 4 or 3)
    cut: Segments  # the base segments
    seams: IntArray  # indices of the segments that end with a seam
    window: int  # `Config.seam_window` in frames
    blend: float  # `Config.seam_blend` in frames
    rate: float  # frames per second
    donor_rows: FloatArray  # (n_rows, n_joints, 4 or 3), by segment; a shared frame occurs twice
    seam_accelerations: FloatArray  # those of `SeamBoundaries`


def at_piece_ends(per_seam: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the entries of `per_seam` at the start and at the end of the given pieces.

    `per_seam` has shape (n_pieces - 1, ...); `piece` has n indices, and both results have shape
    (n, ...). They are 0 at the start of the first piece and at the end of the last one, where there
    is no seam.
    """
    zero = np.zeros((1, *per_seam.shape[1:]))
    return np.concatenate([zero, per_seam])[piece], np.concatenate([per_seam, zero])[piece]


def add_deltas(space: ValueSpace, values: FloatArray, deltas: FloatArray) -> FloatArray:
    """Return values plus deltas; where a delta is 0 the value is returned bit for bit."""
    x, y, z = np.moveaxis(deltas == 0.0, -1, 0)
    changed = space.add(values, deltas)
    np.copyto(changed, values, where=(x & y & z)[..., None])
    return changed
