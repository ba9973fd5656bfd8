"""What a seam treatment is: the values that meet at seams, and the interface of a treatment.

The paper's method is in section 4.5. A *piece* is a stretch of donor motion without a seam inside.
Treatments are functions of continuous time, so that they can be evaluated between frames.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.blend.value_spaces import ValueSpace

__all__ = [
    "PieceTimes",
    "SeamBoundaries",
    "SeamTreatment",
    "add_deltas",
    "at_piece_ends",
    "crossfade_after",
    "crossfade_both_sides",
    "no_crossfade",
]


@dataclass(frozen=True, eq=False)
class PieceTimes:
    """n points in time, each inside one piece of a sequence.

    Attributes
    ----------
    piece : ndarray of int, shape (n,)
        Index of the piece.
    seconds : ndarray, shape (n,)
        Seconds since the start of that piece.
    durations : ndarray, shape (n_pieces,)
        Duration of every piece in seconds.
    """

    piece: IntArray
    seconds: FloatArray
    durations: FloatArray

    @property
    def seconds_left(self) -> FloatArray:
        """Seconds to the end of the piece, shape (n,)."""
        return self.durations[self.piece] - self.seconds

    def windows(self, blend: float) -> FloatArray:
        """Return the blend time of every piece: `blend`, at most the piece's duration."""
        return np.minimum(blend, self.durations)


@dataclass(frozen=True, eq=False)
class SeamBoundaries:
    """Values and velocities on both sides of the seams between successive pieces.

    Attributes
    ----------
    before, after : ndarray, shape (n_pieces - 1, n_joints, 4 or 3)
        The last value of the piece before the seam, and the first value of the piece after it.
    velocity_before, velocity_after : ndarray, shape (n_pieces - 1, n_joints, 3)
        The velocities of these values, per second; of rotations in the joint's own frame.
    """

    before: FloatArray
    after: FloatArray
    velocity_before: FloatArray
    velocity_after: FloatArray

    def gaps(self, space: ValueSpace) -> FloatArray:
        """Return the delta across every seam; exactly 0 where both values are equal."""
        gaps = space.delta(self.before, self.after)
        gaps[(self.before == self.after).all(axis=-1)] = 0.0
        return gaps


class SeamTreatment(ABC):
    """How the motion beside a seam is changed so that the two pieces meet.

    Implementations have no state. Each one is the object `TREATMENT` of its own module in
    `mograft.blend.seam_treatments`.

    Attributes
    ----------
    is_causal : bool
        Whether the frames before a seam never change. `Stream` needs this.
    is_velocity_continuous : bool
        Whether `close` makes velocities continuous too, not only values.
    spans_segments : bool
        How far `close` reaches. True: over the whole of the two segments that meet, and every
        boundary between segments is treated as a seam. False: `Config.seam_blend` seconds on the
        treated sides of a seam, at most to the end of the piece.
    """

    is_causal: ClassVar[bool]
    is_velocity_continuous: ClassVar[bool]
    spans_segments: ClassVar[bool] = False

    @abstractmethod
    def close(
        self,
        space: ValueSpace,
        values: FloatArray,
        times: PieceTimes,
        boundaries: SeamBoundaries,
        blend: float,
    ) -> FloatArray:
        """Return the values with all gaps at seams closed.

        Parameters
        ----------
        space : ValueSpace
            `ROTATIONS` or `TRANSLATIONS`.
        values : ndarray, shape (n, n_joints, 4 or 3)
            The pieces' values at `times`.
        times : PieceTimes
            The n points in time.
        boundaries : SeamBoundaries
            The seams between the pieces.
        blend : float
            `Config.seam_blend`, in seconds.

        Returns
        -------
        ndarray, shape of `values`
            Values that are continuous at the seams. A value that needs no change is returned
            bit for bit.
        """

    @abstractmethod
    def root_velocity_weights(self, remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the weight of the other side's root velocity before and after a seam.

        Parameters
        ----------
        remaining : ndarray
            Share of the blend time that remains: 1 at the seam, 0 where the blend ends.

        Returns
        -------
        before, after : ndarray, shape of `remaining`
            Weights before and after the seam, 0 where `remaining` is 0. Their sum is 1 at the
            seam if the velocity is blended, else 0. See `crossfade_both_sides`,
            `crossfade_after` and `no_crossfade`.
        """

    def smooth(
        self,
        space: ValueSpace,  # noqa: ARG002
        values: FloatArray,
        cut: Segments,  # noqa: ARG002
        seams: IntArray,  # noqa: ARG002
        window: int,  # noqa: ARG002
    ) -> FloatArray:
        """Return the closed values after a last pass over whole frames; unchanged by default.

        Parameters
        ----------
        space : ValueSpace
            `ROTATIONS` or `TRANSLATIONS`.
        values : ndarray, shape (n_frames, n_joints, 4 or 3)
            Values in all frames, seams closed.
        cut : Segments
            The base segments.
        seams : ndarray of int
            Indices of the segments that end with a seam.
        window : int
            `Config.seam_window`, in frames.
        """
        return values


def crossfade_both_sides(remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights that rise to ½ on either side of the seam, with a continuous slope."""
    half = 0.25 * remaining * remaining * (3.0 - remaining)
    return half, half


def crossfade_after(remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights 0 before the seam, and after it a cubic from 1 to 0 with flat ends."""
    return np.zeros_like(remaining), remaining * remaining * (3.0 - 2.0 * remaining)


def no_crossfade(remaining: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights 0: root velocities stay as captured and jump at the seam."""
    return np.zeros_like(remaining), np.zeros_like(remaining)


def at_piece_ends(per_seam: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return a quantity of seams for the seam at each piece's start and at its end.

    Parameters
    ----------
    per_seam : ndarray, shape (n_pieces - 1, ...)
        The quantity.
    piece : ndarray of int, shape (n,)
        Pieces.

    Returns
    -------
    start, end : ndarray, shape (n, ...)
        0 at the start of the first piece and at the end of the last, which have no seam.
    """
    zero = np.zeros((1, *per_seam.shape[1:]))
    return np.concatenate([zero, per_seam])[piece], np.concatenate([per_seam, zero])[piece]


def add_deltas(space: ValueSpace, values: FloatArray, deltas: FloatArray) -> FloatArray:
    """Return values plus deltas; where a delta is 0 the value is returned bit for bit."""
    x, y, z = np.moveaxis(deltas == 0.0, -1, 0)
    changed = space.add(values, deltas)
    np.copyto(changed, values, where=(x & y & z)[..., None])
    return changed
