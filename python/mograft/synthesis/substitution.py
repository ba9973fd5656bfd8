"""`Substitution` and `Seam`: the donor of a base segment, and where two donors meet."""

from dataclasses import dataclass
from typing import NamedTuple


class Substitution(NamedTuple):
    """The donor of one base segment for one joint group.

    Attributes
    ----------
    group : str
        The joint group.
    start, stop : int
        First and last frame in the base, both included.
    segment, donor : int
        Indices of the base segment and of the donor in the library.
    clip : str
        Name of the donor's clip.
    donor_start, donor_stop : int
        First and last frame of the donor in its clip.
    stretch : float
        Relative change of the donor's length: 0.1 if it was lengthened by 10 %.
    cost : float
        Cost of the donor without the costs of seams and constraints; see `Config`.
    gap_before, gap_after : float
        Mean joint angle, in radians, between this donor and the previous or next one where they
        meet; 0 if they are consecutive in a clip, and at the start and end of the motion.
    """

    group: str
    start: int
    stop: int
    segment: int
    donor: int
    clip: str
    donor_start: int
    donor_stop: int
    stretch: float
    cost: float = 0.0
    gap_before: float = 0.0
    gap_after: float = 0.0

    @property
    def is_own(self) -> bool:
        """Whether the donor is the base segment itself."""
        return self.segment == self.donor


@dataclass(frozen=True)
class Seam:
    """A frame at which the gap between two donors was closed.

    The donors are not consecutive in a clip, or one of them was stretched.

    Attributes
    ----------
    group : str
        The joint group.
    frame : int
        The frame in the base.
    gap : float
        Mean joint angle between the two donors' poses, in radians: the angle that
        `Config.max_angle` limits.
    """

    group: str
    frame: int
    gap: float
