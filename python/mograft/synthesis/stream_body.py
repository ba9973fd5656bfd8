"""`StreamBody`: world poses of the base's body with candidates in a pending segment."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.capsules import capsules
from mograft.body.world_poses import Poses
from mograft.motion.motion import Motion, world_transforms
from mograft.synthesis.pending_segment import PendingSegment
from mograft.synthesis.search_problem import driven_joints


@dataclass(frozen=True, eq=False)
class StreamBody:
    """The body of the base motion."""

    frame: Motion  # a single frame of the base
    joints: Mapping[str, IntArray]  # of each grafted group
    up: int  # index of the vertical axis

    @cached_property
    def driven_joints(self) -> dict[str, BoolArray]:
        """For each grafted group the joints that it drives; see `driven_joints`."""
        return driven_joints(self.frame.skeleton, self.joints)

    def poses(self, segment: PendingSegment, rotations: FloatArray) -> Poses:
        """Return the world poses of several candidates in a segment, which gives the translations.

        `rotations` are local, of all joints in the segment's frames, one candidate after the other:
        shape (n_candidates * n_frames, n_joints, 4).
        """
        n_candidates = len(rotations) // (segment.length + 1)
        offsets = np.tile(segment.base.positions[segment.rows], (n_candidates, 1, 1))
        return self._template.with_poses(
            np.tile(segment.frames, n_candidates),
            *world_transforms(self.frame.skeleton, rotations, offsets),
        )

    @cached_property
    def _template(self) -> Poses:
        shape = capsules(self.frame.skeleton)
        return replace(Poses.from_motion(self.frame, shape), up=self.up)
