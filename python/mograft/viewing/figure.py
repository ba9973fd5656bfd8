"""A figure on a page: a motion, its joint groups, and the timeline of its segments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.motion.motion import Motion
from mograft.viewing.candidate_table import CandidateTable


@dataclass(frozen=True, eq=False, kw_only=True)
class TimelineRow:
    """One row of the timeline: the segments of one joint group of a motion."""

    group: str
    start: IntArray  # First and last frame of each segment, both inclusive.
    stop: IntArray
    cluster: IntArray  # Of each segment; in a graft, of its donor. -1 if unknown.
    donor_clips: tuple[str, ...]  # Name of each donor's clip; empty for a captured motion.
    donor_start: IntArray  # First and last frame of each donor in its clip.
    donor_stop: IntArray
    is_exchanged: BoolArray  # Whether the donor is another segment.
    stretch: FloatArray  # Relative change of each donor's duration.
    seam_angles: FloatArray  # Before and after each segment (n, 2), degrees; NaN without a seam.
    n_alternatives: IntArray  # Number of donors other than the segment itself; -1 if unknown.

    @classmethod
    def without_donors(
        cls, group: str, start: IntArray, stop: IntArray, cluster: IntArray
    ) -> "TimelineRow":
        """Return the row of captured segments."""
        zeros = np.zeros(len(start), np.int64)
        return cls(
            group=group,
            start=start,
            stop=stop,
            cluster=cluster,
            donor_clips=(),
            donor_start=zeros,
            donor_stop=zeros,
            is_exchanged=np.zeros(len(start), bool),
            stretch=np.zeros(len(start)),
            seam_angles=np.full((len(start), 2), np.nan),
            n_alternatives=zeros - 1,
        )


@dataclass(frozen=True, eq=False)
class Figure:
    """One moving figure."""

    motion: Motion
    name: str  # Name on the page.
    members: Mapping[str, IntArray]  # The joints of each group.
    rows: tuple[TimelineRow, ...]  # The rows of the figure in the timeline.
    candidates: CandidateTable | None = None  # The donors that the segments of a graft could have.
    command: str | None = None  # Command line to which the page appends ``--take`` and ``--ban``.

    def group_of_nodes(self, parents: Sequence[int]) -> list[int]:
        """Return the index of the joint group of each node.

        `parents` holds the parent of each node: of the joints, then of the end sites. An end site
        belongs to the group of its parent.
        """
        groups = np.zeros(len(parents), np.int64)
        for index, joints in enumerate(self.members.values()):
            groups[joints] = index
        for node in range(self.motion.n_joints, len(parents)):
            groups[node] = groups[max(parents[node], 0)]
        indices: list[int] = groups.tolist()
        return indices
