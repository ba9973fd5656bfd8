"""`TwoBoneLimb`: an arm or leg that brings a joint to a target."""

from dataclasses import dataclass

from mograft.body.anatomy import anatomy
from mograft.body.hierarchy import highest_of_part
from mograft.motion.skeleton import Skeleton

_BONES_OF_END = {
    "hand": ("forearm", "upper_arm"),
    "finger": ("forearm", "upper_arm"),
    "foot": ("shank", "thigh"),
    "toe": ("shank", "thigh"),
}
"""For each part at the end of a limb: the parts of the lower and of the upper bone."""


@dataclass(frozen=True)
class TwoBoneLimb:
    """The joints of an arm or leg: shoulder or hip, elbow or knee, and a joint of hand or foot."""

    start: int
    middle: int
    end: int


def find_limb(skeleton: Skeleton, end: int) -> TwoBoneLimb | None:
    """Return the limb whose two bones bring the joint `end` to a target.

    The result is None if `end` is not part of a hand or foot, or if the limb above it does not have
    two bones.
    """
    parts = anatomy(skeleton).parts
    lower, upper = _BONES_OF_END.get(parts[end], ("", ""))
    bones = (joint for joint in skeleton.ancestors(end) if parts[joint] in (lower, upper))
    above = next(bones, -1)
    if above < 0 or parts[above] != lower:
        return None
    middle = highest_of_part(skeleton, parts, above)
    start = int(skeleton.parents[middle])
    if start < 0 or parts[start] != upper:
        return None
    return TwoBoneLimb(highest_of_part(skeleton, parts, start), middle, end)
