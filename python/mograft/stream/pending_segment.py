"""`PendingSegment`: a base segment that a stream has not committed yet, and its candidates."""

from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.search.boundary_states import BoundaryStates
from mograft.search.constraints import Constraint
from mograft.search.costs import INFEASIBLE_PENALTY, CostModel
from mograft.stream.placed_donors import SampledDonors


@dataclass(eq=False)
class GroupCandidates:
    """The candidates of one group for a base segment that is not committed yet."""

    boundary: BoundaryStates
    costs: FloatArray  # shape (n_candidates,); with constraint costs, without seams
    sampled: SampledDonors | None = None  # all candidates; None if no pose constraint applies
    _seam_costs: FloatArray | None = field(default=None, init=False, repr=False)

    def seam_costs_to(self, following: "GroupCandidates", model: CostModel) -> FloatArray:
        """Return the seam costs to the candidates of the next segment; later calls reuse them."""
        if self._seam_costs is None:
            self._seam_costs = model.seam_costs(self.boundary, following.boundary)
        return self._seam_costs


@dataclass(frozen=True, eq=False, kw_only=True)
class PendingSegment:
    """A base segment of a stream whose donors are not committed yet, and its candidates."""

    base: Motion  # the segment's frames with a margin, from `BaseBuffer.motion_with_margin`
    offset: int  # index in `base` of the segment's first frame
    segment: Segments  # in frames of the stream; clip index: number of clips in the library
    donors: IntArray  # shape (n_candidates,); the last is -1, the base segment itself
    unary_costs: dict[str, FloatArray]  # by grafted group; without seams and constraints
    origin_costs: FloatArray  # shape (n_candidates,); soft constraints on clip and length
    is_copy: dict[str, BoolArray]  # by grafted group: candidates that move it as the base does
    groups: dict[str, GroupCandidates] = field(default_factory=dict)  # by grafted group
    pose_constraints: tuple[Constraint, ...] = ()  # those that apply in the segment

    @property
    def start(self) -> int:
        """First frame."""
        return int(self.segment.start[0])

    @property
    def stop(self) -> int:
        """Last frame."""
        return int(self.segment.stop[0])

    @property
    def length(self) -> int:
        """Length in intervals."""
        return self.stop - self.start

    @property
    def frames(self) -> IntArray:
        """All frames."""
        return np.arange(self.start, self.stop + 1)

    @property
    def rows(self) -> slice:
        """The segment's frames as rows of `base`."""
        return slice(self.offset, self.offset + self.length + 1)

    @property
    def rotations(self) -> FloatArray:
        """Rotations of the base in the segment's frames, shape (n_frames, n_joints, 4)."""
        return self.base.rotations[self.rows]

    def costs(self, group: str) -> FloatArray:
        """Costs of a group's candidates without seams and pose constraints, (n_candidates,)."""
        copy_costs = np.where(self.is_copy[group], INFEASIBLE_PENALTY, 0.0)
        return self.unary_costs[group] + self.origin_costs + copy_costs
