"""The parameters that all clips of a library share, and how clips are made to fit."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from mograft.body.joint_matching import match_joints
from mograft.library.conform import conform
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

Match: TypeAlias = Literal["names", "anatomy"]

MATCHES = {
    "names": "clips must have the joint names and the hierarchy of the library",
    "anatomy": "joints of other hierarchies are matched by body part",
}
"""How the joints of clips correspond to those of the library."""

MAX_RATE_DIFFERENCE = 1e-3
"""Relative difference up to which two frame rates count as equal: files round frame times, for
instance 1/30 s to 0.033."""


@dataclass(frozen=True, eq=False)
class LibrarySpec:
    """The parameters that all clips of a library share."""

    skeleton: Skeleton  # with the joint names and the hierarchy of every clip
    rate: float  # frames per second
    root: int  # the joint that carries the body through the world
    up: int  # the axis that points up: 0, 1 or 2
    match: Match = "names"  # how clips of other hierarchies fit; a key of `MATCHES`
    rest: Skeleton | None = None  # the rest pose of files that store none, as for `read`

    def fit(self, motion: Motion, label: str) -> Motion:
        """Return a motion with the hierarchy of the library.

        Raises SkeletonMismatchError if the motion has another hierarchy and joints are matched by
        name, or if its joints cannot be matched by anatomy. The message calls the motion `label`.
        """
        if self.match == "anatomy":
            return conform(motion, self.skeleton, up=self.up, root=self.root, name=label)
        self.skeleton.check_same_hierarchy(motion.skeleton, label)
        return motion

    def is_equivalent(self, other: "LibrarySpec") -> bool:
        """Return whether ingest gives the same results with another specification."""
        parameters = (self.rate, self.root, self.up, self.match)
        is_same = parameters == (other.rate, other.root, other.up, other.match)
        return is_same and self.skeleton.has_same_hierarchy(other.skeleton)


def rates_match(rate: float, other: float) -> bool:
    """Return whether two frame rates differ by at most `MAX_RATE_DIFFERENCE` of `other`."""
    return abs(rate - other) <= MAX_RATE_DIFFERENCE * other


def describe_match(skeleton: Skeleton, other: Skeleton, name: str = "the clip") -> str:
    """Return a text that lists the joints without a counterpart; "" if the hierarchies are equal.

    Raises SkeletonMismatchError if the skeletons cannot be matched. The message calls the other
    skeleton `name`.
    """
    if skeleton.has_same_hierarchy(other):
        return ""
    match = match_joints(skeleton, other, name)
    return match.describe() or "every joint has a counterpart"
