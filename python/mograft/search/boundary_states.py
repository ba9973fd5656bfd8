"""Poses and velocities at the ends of segments, and the gaps between them at seams."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray


def pose_gaps(ends: FloatArray, starts: FloatArray) -> FloatArray:
    """Return the mean joint angle between every end pose and every start pose.

    `ends` and `starts` are local rotations, xyzw, of shapes (n_ends, n_joints, 4) and (n_starts,
    n_joints, 4). A joint angle is the angle of the rotation between two poses of a joint. The
    result, shape (n_ends, n_starts), is in radians, 0 to π.
    """
    return _core.pose_gaps(np.ascontiguousarray(ends), np.ascontiguousarray(starts))


def velocity_gaps(ends: FloatArray, starts: FloatArray) -> FloatArray:
    """Return the mean difference of joint velocities between every end and every start.

    `ends` and `starts` are angular velocities, each in its joint's local frame, of shapes (n_ends,
    n_joints, 3) and (n_starts, n_joints, 3). The result, shape (n_ends, n_starts), is the norm of
    the difference, averaged over the joints, in the unit of the velocities.
    """
    return _core.velocity_gaps(np.ascontiguousarray(ends), np.ascontiguousarray(starts))


def pose_gaps_along(
    ends: FloatArray, starts: FloatArray, candidates: IntArray, counts: IntArray
) -> FloatArray:
    """Return the `pose_gaps` from the candidates of each position to those of the next.

    `ends` and `starts` hold the poses of all segments. `candidates` holds the candidate segments of
    all positions, one position after the other, and `counts` their number at each position. The
    result is flat: for each position but the last, a matrix with one row per candidate and one
    column per candidate of the next position, row by row.
    """
    return _core.pose_gaps_along(
        np.ascontiguousarray(ends), np.ascontiguousarray(starts), candidates, counts
    )


def velocity_gaps_along(
    ends: FloatArray, starts: FloatArray, candidates: IntArray, counts: IntArray
) -> FloatArray:
    """Return the `velocity_gaps` from the candidates of each position to those of the next.

    Arguments and result have the form of those of `pose_gaps_along`.
    """
    return _core.velocity_gaps_along(
        np.ascontiguousarray(ends), np.ascontiguousarray(starts), candidates, counts
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundaryStates:
    """Poses and velocities of one joint group in the first and last frame of each segment.

    Poses are local rotations, xyzw, shape (n_segments, n_joints, 4). Velocities are angular, in
    radians per second, each in its joint's local frame, shape (n_segments, n_joints, 3).
    """

    first: FloatArray
    last: FloatArray
    first_velocity: FloatArray
    last_velocity: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    def __getitem__(self, index: IntArray | slice) -> "BoundaryStates":
        return BoundaryStates(**{name: states[index] for name, states in vars(self).items()})

    @staticmethod
    def concatenate(parts: "Sequence[BoundaryStates]") -> "BoundaryStates":
        """Join the boundary states of several sets of segments, in order."""
        names = [field.name for field in fields(BoundaryStates)]
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return BoundaryStates(**joined)
