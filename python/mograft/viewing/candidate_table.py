"""The donors that the segments of a graft could have, as the page lists them."""

from dataclasses import dataclass
from itertools import islice

import numpy as np

from mograft.search.candidates import Candidate
from mograft.solve.candidate_verdicts import candidates
from mograft.synthesis.graft_result import Graft

_MAX_LISTED = 20
"""Maximum number of donors listed for a segment."""

_MAX_SEGMENTS = 1_500
"""Maximum number of segments with listed donors, over all groups."""


@dataclass(frozen=True)
class ListedDonor:
    """An allowed candidate, with the numbers that ``mograft candidates`` prints."""

    clip: str
    start: int  # First and last frame in the clip, both inclusive.
    stop: int
    is_own: bool  # Whether it is the base segment itself.
    cost: float | None  # Cost, stretch and seam angles are None in a scenario.
    stretch: float | None
    seam_angles: tuple[float, float] | None  # Before and after, in degrees.


@dataclass(frozen=True, eq=False)
class CandidateTable:
    """The allowed candidates of the base segments of a graft, for each exchanged group."""

    donors: dict[str, tuple[tuple[ListedDonor, ...], ...]]  # The first 20 of each base segment.
    counts: dict[str, tuple[int, ...]]  # Number of allowed candidates of each base segment.

    @classmethod
    def of(cls, graft: Graft) -> "CandidateTable":
        """Return the allowed candidates in the order of `mograft.candidates`.

        Constraints are ignored. Costs and seam angles are those between the neighbours of the base
        segment in its clip; in a scenario, in which it has other neighbours, they are None. Only
        the first segments of each group are included, at most 1,500 segments over all groups.
        """
        donors, counts = {}, {}
        most = _MAX_SEGMENTS // max(len(graft.alternatives), 1)
        for group in graft.alternatives:
            own = (s.segment for s in graft.substitutions if s.group == group)
            found = [
                (segment, candidates(graft.library, segment, group).allowed)
                for segment in islice(own, most)
            ]
            donors[group] = tuple(
                tuple(_list_donor(graft, segment, each) for each in allowed[:_MAX_LISTED])
                for segment, allowed in found
            )
            counts[group] = tuple(len(allowed) for _, allowed in found)
        return cls(donors, counts)


def _list_donor(graft: Graft, segment: int, candidate: Candidate) -> ListedDonor:
    before, after = np.degrees([candidate.gap_before, candidate.gap_after]).tolist()
    has_own_neighbours = not graft.scenario
    return ListedDonor(
        clip=graft.library.names[candidate.clip],
        start=candidate.start,
        stop=candidate.stop,
        is_own=candidate.segment == segment,
        cost=candidate.cost if has_own_neighbours else None,
        stretch=candidate.stretch if has_own_neighbours else None,
        seam_angles=(before, after) if has_own_neighbours else None,
    )
