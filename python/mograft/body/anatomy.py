"""Body part and side of each joint of a skeleton, from joint names or structure."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import IntArray, as_indices
from mograft.body.joint_names import (
    ANIMAL_WORDS,
    ARM,
    LEG,
    OPPOSITE_SIDE,
    part_of_words,
    read_names,
)
from mograft.body.limb_structure import recognise_structure, unbranched_chain
from mograft.errors import join_names, suggest_name
from mograft.motion.skeleton import Skeleton

_BONES_OF_END = {
    **dict.fromkeys(("hand", "finger"), ("forearm", "upper_arm")),
    **dict.fromkeys(("foot", "toe"), ("shank", "thigh")),
}
"""For each part at the end of a limb: the parts of the lower and of the upper bone."""

_USUAL_PARTS = {"leg": "shank", "shoulder": "upper_arm", "hip": "thigh"}
"""The part that an ambiguous name means without a skeleton."""


@dataclass(frozen=True)
class Anatomy:
    """Body part and side of each joint of a skeleton.

    A joint belongs to the body part that it moves: an elbow to ``"forearm"``, a knee to
    ``"shank"``. The hips, and the joints between them and the legs, belong to ``"pelvis"``.
    Ancestors of the hips, which move the whole body, have the part ``"other"``.
    """

    parts: tuple[str, ...]  # of `mograft.body.joint_names.PARTS`, per joint
    sides: tuple[str, ...]  # "left", "right" or "", per joint
    hips: int  # lowest common ancestor of all body parts: the root, or a joint below helper joints
    unmatched: tuple[int, ...]  # joints whose names are unknown
    details: tuple[int, ...]  # joints of the face, and markers
    human: bool  # whether the names describe a human: two legs below hips, no tail, no paws

    def joints(self, *parts: str, side: str | None = None) -> list[int]:
        """Return the indices of the joints of the given body parts; `side` None means all sides."""
        kinds = enumerate(zip(self.parts, self.sides, strict=True))
        return [joint for joint, (part, own) in kinds if part in parts and side in (None, own)]

    def highest(self, part: str, skeleton: Skeleton) -> list[int]:
        """Return the joints of a body part whose parents do not belong to it."""
        above = skeleton.parents.tolist()
        return [j for j in self.joints(part) if above[j] < 0 or self.parts[above[j]] != part]


@lru_cache(maxsize=64)
def anatomy(skeleton: Skeleton) -> Anatomy:
    """Recognise the body part and the side of each joint of a human or an animal.

    Known names have priority. Namespaces, case, separators and a prefix shared by at least 90 % of
    the names are ignored. The hierarchy resolves ambiguous names: ``LeftShoulder`` is the upper arm
    if its child is an elbow, and the clavicle if its child is an arm. A joint with an unknown name
    has the part of its parent; below a hand it is a finger, below a foot a toe. If the names
    contain no legs or no arms, mirrored pairs of limbs in the rest pose give the missing parts; the
    pair nearest to the root is the legs. If the names contain no sides, the feet are assumed to
    point forward in the rest pose. Without feet, the left limb of a pair is the one with the larger
    coordinate on the axis on which the two limbs are farthest apart.
    """
    words, sides = read_names(skeleton.names)
    named = _resolve_ambiguous(skeleton, [*map(part_of_words, words)], words, sides)
    legs, arms = (any(part in limb for part in named) for limb in (LEG, ARM))
    guess = guessed_sides = [""] * skeleton.n_joints
    if not (legs and arms):
        guess, guessed_sides = recognise_structure(skeleton)
        if any(named):  # only the limbs without known names
            missing = (() if legs else LEG) + (() if arms else ARM)
            guess = [part if part in missing else "" for part in guess]
    elif any(part in ARM + LEG and not side for part, side in zip(named, sides, strict=True)):
        guessed_sides = recognise_structure(skeleton)[1]
    pairs = [(a, b) for a, b in zip(sides, guessed_sides, strict=True) if a and b]
    if sum(a != b for a, b in pairs) > len(pairs) / 2:  # the guessed sides are swapped
        guessed_sides = [OPPOSITE_SIDE[side] for side in guessed_sides]
    known = [part or guessed for part, guessed in zip(named, guess, strict=True)]
    hips = skeleton.common_ancestor([joint for joint, part in enumerate(known) if part])
    parts = _fill(skeleton, known, hips)
    full_sides: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        inherits = parent >= 0 and parts[joint] in (*ARM, *LEG, "pelvis")
        above = full_sides[parent] if inherits else ""
        full_sides.append(sides[joint] or guessed_sides[joint] or above)
    structural = any(not part and guessed for part, guessed in zip(named, guess, strict=True))
    two_legs = {("thigh", "left"), ("thigh", "right")} <= set(zip(parts, full_sides, strict=True))
    animal = any(ANIMAL_WORDS & set(joint_words) for joint_words in words) or "tail" in parts
    return Anatomy(
        parts=tuple(parts),
        sides=tuple(full_sides),
        hips=hips,
        unmatched=tuple(joint for joint, part in enumerate(named) if not part),
        details=_details(skeleton, parts),
        human=two_legs and parts[hips] == "pelvis" and not animal and not structural,
    )


def find_joint(skeleton: Skeleton, name: str, *, is_part: bool = False) -> int:
    """Return the index of the joint named `name`.

    With `is_part` the name may also be that of a body part, such as "chest" or "left hand". Raise
    ValueError if there is no such joint or more than one. The message names the joint of the body
    part that the name means, as names differ between figures, or else the most similar name.
    """
    if name in skeleton.names:
        return skeleton.index(name)
    joint = _counterpart(skeleton, name)
    if joint is None and is_part and not suggest_name(name, skeleton.names):
        known = f"{join_names(skeleton.names, 24)}, and parts such as 'chest' or 'left hand'"
        raise ValueError(f"no joint or body part is named {name!r}, but {known}")
    if joint is None:
        return skeleton.index(name)
    if not is_part:
        raise ValueError(f"no joint is named {name!r}{suggest_joint(skeleton, name)}")
    return joint


def suggest_joint(skeleton: Skeleton, name: str) -> str:
    """Return the joint of the part that a name means, or else of the most similar name, as text."""
    joint = _counterpart(skeleton, name)
    if joint is None:
        return suggest_name(name, skeleton.names)
    return f"; did you mean {skeleton.names[joint]!r}, the same body part?"


def _counterpart(skeleton: Skeleton, name: str) -> int | None:
    """Return the joint of the part and side that a name means, and of most of its words."""
    (words,), (side,) = read_names((name,))
    part, own_words = part_of_words(words), read_names(skeleton.names)[0]
    part = _USUAL_PARTS.get(part, part)
    # Of the trunk the top, where the arms begin, unless another joint has the words.
    joints = anatomy(skeleton).joints(part, side=side)[:: -1 if part == "trunk" else 1]
    return max(joints, key=lambda joint: len({*own_words[joint]} & {*words}), default=None)


def root_carriers(skeleton: Skeleton) -> list[int]:
    """Return the ancestors of the hips of a skeleton with legs, from the hips upwards.

    They are helper joints such as ``joint_Root``, which often stays on the floor. The distance from
    them to the hips is a translation of the body and not a bone.
    """
    known = anatomy(skeleton)
    return list(skeleton.ancestors(known.hips)) if known.joints(*LEG) else []


def feature_joints(skeleton: Skeleton, joints: npt.ArrayLike) -> IntArray:
    """Return those of the given joints whose rotations are compared between segments.

    The order of the joints is kept. Fingers, toes, joints of the face and markers are excluded,
    because their number would outweigh the limbs. If no joint remains, all given joints are
    returned.
    """
    indices = as_indices("joints", joints, ("n",))
    known = anatomy(skeleton)
    kept = indices[~np.isin(indices, [*known.joints("finger", "toe"), *known.details])]
    return kept if len(kept) else indices


def highest_of_part(skeleton: Skeleton, joint: int) -> int:
    """Return the highest joint that is reached from `joint` upwards through joints of its part.

    This skips roll joints. If the parent has another part, the result is `joint` itself.
    """
    parts = anatomy(skeleton).parts
    while skeleton.parents[joint] >= 0 and parts[skeleton.parents[joint]] == parts[joint]:
        joint = int(skeleton.parents[joint])
    return joint


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
    above = next((j for j in skeleton.ancestors(end) if parts[j] in (lower, upper)), 0)
    middle = highest_of_part(skeleton, above)
    start = int(skeleton.parents[middle])
    if parts[above] != lower or start < 0 or parts[start] != upper:
        return None
    return TwoBoneLimb(highest_of_part(skeleton, start), middle, end)


def _resolve_ambiguous(
    skeleton: Skeleton, named: list[str], words: list[tuple[str, ...]], sides: list[str]
) -> list[str]:
    """Return the part of each joint, with ambiguous names resolved by the joints above and below.

    For each joint, `words` holds the known words of its name, `named` the part that they mean, and
    `sides` its side.
    """
    children, parents = skeleton.children, skeleton.parents.tolist()
    has_grandchildren = [any(children[child] for child in own) for own in children]
    below: list[set[str]] = [set() for _ in named]
    for joint in range(len(named) - 1, 0, -1):
        parent = parents[joint]
        if not children[joint] and has_grandchildren[parent]:
            continue  # a marker, even if it is named after a bone
        below[parent] |= below[joint] | {named[joint]}
        if sides[joint] and named[joint] == "hip":
            below[parent].add("thigh")
    parts = list(named)
    parts_above: list[str] = []  # of the nearest ancestor whose name means a part
    for joint, part in enumerate(named):
        parent = parents[joint]
        parts_above.append("" if parent < 0 else parts[parent] or parts_above[parent])
        above = parts_above[joint] or part
        if part == "hip":
            # LHipJoint above a thigh belongs to the pelvis; LeftHip above a knee is the thigh.
            on_pelvis = not sides[joint] or "thigh" in below[joint]
            parts[joint] = "pelvis" if on_pelvis else "thigh"
        elif part == "leg":
            upper = above not in LEG or bool(below[joint] & {"thigh", "shank"})
            parts[joint] = "thigh" if upper else "shank"
        elif part == "shoulder":
            leaf = not children[joint]
            parts[joint] = "clavicle" if leaf or "upper_arm" in below[joint] else "upper_arm"
        elif part == "foot" and above == "foot" and "ankle" in words[parent]:
            parts[joint] = "toe"
    if "head" not in parts:
        above_arms = _above_arms(skeleton, parts)
        for joint in above_arms:
            parts[joint] = "neck"
        # A single neck joint may move the head too; of several, the last is the head.
        if parts.count("neck") > 1:
            parts[max(joint for joint, part in enumerate(parts) if part == "neck")] = "head"
    return parts


def _above_arms(skeleton: Skeleton, parts: list[str]) -> list[int]:
    """Return the trunk joints between arms and head; empty if the name of a joint means neck."""
    arms = [joint for joint, part in enumerate(parts) if part in ARM]
    if not arms or "neck" in parts:
        return []
    chest = skeleton.common_ancestor(arms)
    for child in skeleton.children[chest]:
        chain = unbranched_chain(skeleton, child)
        if len(chain) > 1 and all(parts[joint] == "trunk" for joint in chain):
            return chain
    return []


def _fill(skeleton: Skeleton, known: list[str], hips: int) -> list[str]:
    """Return the part of every joint: from `known` if plausible, else from the part of the parent.

    In `known`, a joint without a recognised name has the part ``""``.
    """
    legs = [joint for joint, part in enumerate(known) if part in LEG]
    leg_ancestors = {above for joint in legs for above in skeleton.ancestors(joint)}
    above_hips = set(skeleton.ancestors(hips))
    parts: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        name = known[joint]
        above = parts[parent] if parent >= 0 else ""
        if joint in above_hips:
            part = "other"
        elif joint == hips and not name:
            part = "pelvis"
        elif joint in leg_ancestors and name not in LEG:
            # An ancestor of the legs moves them, whatever its name.
            part = above if above in LEG else "pelvis"
        elif above in ("head", "finger", "toe"):
            part = above
        elif name:
            # A head below a leg or a forearm below a hand is a marker.
            misplaced = name in ("neck", "head") and above in ARM + LEG
            part = above if misplaced or _comes_before(name, above) else name
        else:
            part = {"hand": "finger", "foot": "toe"}.get(above, above)
        parts.append(part)
    return parts


def _comes_before(part: str, above: str) -> bool:
    """Return whether both parts are in one limb, and `part` is closer to the trunk than `above`."""
    limbs = (limb for limb in (ARM, LEG) if part in limb and above in limb)
    return any(limb.index(part) < limb.index(above) for limb in limbs)


def _details(skeleton: Skeleton, parts: list[str]) -> tuple[int, ...]:
    """Return the joints of the face, and the markers.

    A marker is a leaf joint that has siblings and the same body part as its parent.
    """
    found = []
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0 and parts[joint] == parts[parent]:
            beside = len(skeleton.children[parent]) > 1 and not skeleton.children[joint]
            if parts[joint] == "head" or (beside and parts[joint] not in ("finger", "toe", "tail")):
                found.append(joint)
    return tuple(found)
