"""The parameters that all clips of a library share, and how they are chosen."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from mograft.body.anatomy import anatomy
from mograft.body.joint_matching import match_joints
from mograft.body.mass import up_axis
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


@dataclass(frozen=True, eq=False)
class ClipProperties:
    """The properties of one clip from which the library specification is chosen."""

    skeleton: Skeleton
    rate: float  # frames per second; the override of the file's rate, if the caller gave one
    n_frames: int  # at that rate
    root: int  # the joint that carries the body; -1 if no joint changes its position
    up: int  # the axis that points up: 0, 1 or 2

    @classmethod
    def from_motion(cls, motion: Motion) -> "ClipProperties":
        """Return the properties of a motion."""
        is_moving = bool(np.ptp(motion.positions, axis=0).any())
        return cls(
            skeleton=motion.skeleton,
            rate=motion.rate,
            n_frames=motion.n_frames,
            root=motion.locomotion_root() if is_moving else -1,
            up=up_axis(motion),
        )


def choose_spec(
    clips: Sequence[ClipProperties],
    rate: float | None = None,
    match: Match = "names",
    rest: Skeleton | None = None,
    hierarchy: Skeleton | None = None,
) -> LibrarySpec:
    """Choose the library specification from the properties of at least one clip.

    Its hierarchy (joint names and parents) is that of `hierarchy` or, by default, the one that most
    clips have. Only the clips with this hierarchy determine the other parameters: the most frequent
    root, the up axis of the longest clip and, unless `rate` is given, the rate with the most
    frames. Ties go to the first clip. If no clip has the given `hierarchy`, all clips determine
    rate and up axis, and the hips are the root.
    """
    by_hierarchy: dict[tuple[object, ...], list[ClipProperties]] = {}
    for clip in clips:
        key = (clip.skeleton.names, clip.skeleton.parents.tobytes())
        by_hierarchy.setdefault(key, []).append(clip)
    fitting = max(by_hierarchy.values(), key=len)
    if hierarchy is not None:
        fitting = by_hierarchy.get((hierarchy.names, hierarchy.parents.tobytes()), [])
    roots = Counter(clip.root for clip in fitting if clip.root >= 0)
    if hierarchy is not None and not fitting:
        fitting, roots = list(clips), Counter([anatomy(hierarchy).hips])
    frames: dict[float, int] = {}
    for clip in fitting:
        known_rate = next((known for known in frames if rates_match(clip.rate, known)), clip.rate)
        frames[known_rate] = frames.get(known_rate, 0) + clip.n_frames
    if rate is None:
        rate = max(frames, key=lambda known: frames[known])
    longest = max(fitting, key=lambda clip: (clip.n_frames - 1) / clip.rate)
    return LibrarySpec(
        skeleton=hierarchy or fitting[0].skeleton,
        rate=rate,
        root=roots.most_common(1)[0][0] if roots else 0,
        up=longest.up,
        match=match,
        rest=rest,
    )


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
