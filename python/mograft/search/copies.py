"""Copies: segments in which a joint group moves as in another segment, whatever their clips.

A take that is in a library twice, resampled, renamed, mirrored or as a part of itself, has every
segment twice. Such a segment is not a donor for its copy, because nothing would be new.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import DividedChannels, restrict_samples
from mograft.analysis.embedding import Samples
from mograft.body.anatomy import feature_joints
from mograft.motion.skeleton import Skeleton
from mograft.search.boundary_states import BoundaryStates

COPY_ANGLE = np.radians(0.5)
"""Angle up to which two poses of a joint count as the same; recordings have greater noise."""

_PAIRS_PER_BATCH = 2048


class SampleSource(Protocol):
    """Interface of the samples of a library's segments."""

    def select(self, indices: IntArray) -> Samples:
        """Return the samples of some segments, in the order of `indices`."""


@dataclass(frozen=True, eq=False)
class SegmentParts:
    """The part of each segment that a joint group moves."""

    samples: SampleSource
    boundary: BoundaryStates  # of the feature joints of the group
    skeleton: Skeleton
    joints: IntArray  # of the group
    root: int  # the locomotion root, whose heading is not compared
    channels: DividedChannels  # joints of which the group holds only some rotation channels

    @cached_property
    def _compared(self) -> dict[int, int]:
        """The columns of `boundary` that are compared, by their joint."""
        joints = feature_joints(self.skeleton, self.joints).tolist()
        return {joint: column for column, joint in enumerate(joints) if joint != self.root}

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """The compared poses of all segments, as from `select_ends`."""
        return self.select_ends(self.boundary)

    def select_ends(self, boundary: BoundaryStates) -> tuple[FloatArray, FloatArray]:
        """Return the compared poses in first and last frame, each (n, n_compared, 4)."""
        first, last, columns = boundary.first, boundary.last, list(self._compared.values())
        if len(columns) in (0, first.shape[1]):
            return first, last
        return first[:, columns], last[:, columns]

    @cached_property
    def _by_spread(self) -> list[int]:
        """The compared columns; those of which most pairs of segments differ come first."""
        poses = self.boundary.first
        spread = poses[:: max(len(poses) // 1000, 1)].std(axis=0).sum(axis=1)
        return sorted(self._compared.values(), key=lambda column: -float(spread[column]))

    def poses(self, samples: Samples) -> FloatArray:
        """Return the rotations of the group in samples, (n_segments, n_samples, n_joints, 4)."""
        restricted = restrict_samples(samples, self.skeleton, self.channels)
        return np.asarray(restricted.rotations[:, :, self.joints], float)

    def are_copies(self, base: IntArray, donors: IntArray) -> BoolArray:
        """Return whether the group moves in each donor as in its base segment, shape (n,).

        The rotations of all joints of the group differ by at most `COPY_ANGLE` in all samples; the
        heading of a root is not compared. A segment is no copy of itself. Both arguments have shape
        (n,).
        """
        near = np.flatnonzero(base != donors)
        for column in self._by_spread:
            for ends in (self.boundary.first, self.boundary.last):
                pairs = ends[base[near], column], ends[donors[near], column]
                near = near[_are_same(*pairs)]
        found = np.zeros(len(base), bool)
        for start in range(0, len(near), _PAIRS_PER_BATCH):
            batch = near[start : start + _PAIRS_PER_BATCH]
            segments, rows = np.unique((base[batch], donors[batch]), return_inverse=True)
            poses = self.poses(self.samples.select(segments))
            found[batch] = _are_same(*(poses[own] for own in rows.reshape(2, -1)))
        return found

    def find_copies(self, base: Samples, donors: IntArray) -> BoolArray:
        """Return which of some donors are copies of one segment that is not in the library."""
        poses, columns = self.poses(base), list(self._compared.values())
        starts = poses[:, 0, np.searchsorted(self.joints, list(self._compared))]
        near = np.flatnonzero(_are_same(self.boundary.first[donors][:, columns], starts))
        found = np.zeros(len(donors), bool)
        found[near] = _are_same(self.poses(self.samples.select(donors[near])), poses)
        return found


def _are_same(first: FloatArray, second: FloatArray) -> BoolArray:
    """Return whether rotations, shape (n, ..., 4), differ by at most `COPY_ANGLE`, shape (n,)."""
    cosines = np.abs(np.einsum("...i,...i->...", first, second))
    is_same = cosines >= np.cos(COPY_ANGLE / 2)
    return is_same.all(axis=tuple(range(1, is_same.ndim)))
