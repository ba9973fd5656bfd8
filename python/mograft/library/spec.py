"""The parameters that all clips of a library share, and how they are chosen."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft.body.mass import up_axis
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

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

    def is_equivalent(self, other: "LibrarySpec") -> bool:
        """Return whether ingest gives the same results with another specification."""
        parameters = (self.rate, self.root, self.up)
        is_same = parameters == (other.rate, other.root, other.up)
        return is_same and has_same_hierarchy(self.skeleton, other.skeleton)


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


def choose_spec(clips: Sequence[ClipProperties], rate: float | None = None) -> LibrarySpec:
    """Choose the library specification from the properties of at least one clip.

    Its joint names and hierarchy are those that most clips have. Only these clips determine the
    other parameters: the most frequent root, the up axis of the longest clip and, unless `rate` is
    given, the rate with the most frames. Ties go to the first clip.
    """
    by_hierarchy: dict[tuple[object, ...], list[ClipProperties]] = {}
    for clip in clips:
        hierarchy = (clip.skeleton.names, clip.skeleton.parents.tobytes())
        by_hierarchy.setdefault(hierarchy, []).append(clip)
    fitting = max(by_hierarchy.values(), key=len)
    frames: dict[float, int] = {}
    for clip in fitting:
        known_rate = next((known for known in frames if rates_match(clip.rate, known)), clip.rate)
        frames[known_rate] = frames.get(known_rate, 0) + clip.n_frames
    if rate is None:
        rate = max(frames, key=lambda known: frames[known])
    roots = Counter(clip.root for clip in fitting if clip.root >= 0)
    longest = max(fitting, key=lambda clip: (clip.n_frames - 1) / clip.rate)
    return LibrarySpec(
        skeleton=fitting[0].skeleton,
        rate=rate,
        root=roots.most_common(1)[0][0] if roots else 0,
        up=longest.up,
    )


def rates_match(rate: float, other: float) -> bool:
    """Return whether two frame rates differ by at most `MAX_RATE_DIFFERENCE` of `other`."""
    return abs(rate - other) <= MAX_RATE_DIFFERENCE * other


def has_same_hierarchy(skeleton: Skeleton, other: Skeleton) -> bool:
    """Return whether two skeletons have the same joint names and parents."""
    return skeleton.names == other.names and np.array_equal(skeleton.parents, other.parents)
