"""Body parts recognised from the structure of a skeleton: limbs are mirrored pairs."""

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.body.joint_names import ARM, LEG
from mograft.motion.skeleton import Skeleton

_MAX_LIMBS = 128
"""Longest children of a joint that are compared with each other; all pairs would take hours."""


def recognise_structure(skeleton: Skeleton) -> tuple[list[str], list[str]]:
    """Return the part and the side of every joint, from the rest pose alone.

    A joint with the part ``""`` has the part of its parent. A side is ``"left"``, ``"right"`` or
    ``""``.
    """
    parts, sides = [""] * skeleton.n_joints, [""] * skeleton.n_joints
    shape = _Shape.from_skeleton(skeleton)
    pairs, axis = _mirrored_pairs(shape)
    longest = max((shape.length(a) for a, _ in pairs), default=0.0)
    # Eyes and breasts are mirrored pairs too, but short.
    limbs = [(a, b) for a, b in pairs if shape.length(a) >= 0.4 * longest]
    limbs.sort(key=lambda p: (len(skeleton.ancestors(p[0])), -shape.length(p[0]), p))
    legs = limbs[0] if limbs else None
    arms = max(limbs[1:], key=lambda pair: shape.length(pair[0]), default=None)
    hips = int(skeleton.parents[legs[0]]) if legs else 0
    for joint, part in _spine(shape, axis, legs, arms):
        parts[joint] = part
    for pair, roles, connector in ((legs, LEG, "pelvis"), (arms, ARM[1:], "clavicle")):
        for first in pair or ():
            for joint, part in _limb(shape, shape.chain(first), roles, connector):
                parts[joint] = part
    parts[hips] = "pelvis"
    left = _leftward(shape, legs)
    for a, b in pairs:
        gap = shape.middle[a] - shape.middle[b]
        a_is_left = (gap[np.argmax(np.abs(gap))] if left is None else gap @ left) >= 0
        for first, side in zip((a, b) if a_is_left else (b, a), ("left", "right"), strict=True):
            for joint in shape.subtree[first]:
                sides[joint] = side
    return parts, sides


def unbranched_chain(skeleton: Skeleton, first: int) -> list[int]:
    """Return the joints from `first` down to the first leaf or joint with several children."""
    chain = [first]
    while len(skeleton.children[chain[-1]]) == 1:
        chain += skeleton.children[chain[-1]]
    return chain


@dataclass(frozen=True)
class _Shape:
    """Rest positions and sizes of subtrees of a skeleton; entry i is the subtree of joint i."""

    skeleton: Skeleton
    positions: FloatArray  # rest pose
    subtree: list[list[int]]  # the joint and all joints below it
    middle: FloatArray  # mean rest position of the subtree
    reach: FloatArray  # length of the longest path down the hierarchy
    tips: FloatArray  # length of the joint's longest end site

    @classmethod
    def from_skeleton(cls, skeleton: Skeleton) -> "_Shape":
        positions = skeleton.rest_positions()
        lengths = np.linalg.norm(skeleton.offsets, axis=1)
        subtree: list[list[int]] = [[joint] for joint in range(skeleton.n_joints)]
        reach, tips = np.zeros(skeleton.n_joints), np.zeros(skeleton.n_joints)
        for site in skeleton.end_sites:
            tips[site.parent] = max(tips[site.parent], float(np.linalg.norm(site.offset)))
        for joint in range(skeleton.n_joints - 1, 0, -1):
            parent = skeleton.parents[joint]
            subtree[parent] += subtree[joint]
            reach[parent] = max(reach[parent], lengths[joint] + reach[joint])
        middle = np.array([positions[joints].mean(axis=0) for joints in subtree])
        return cls(skeleton, positions, subtree, middle, reach=reach, tips=tips)

    def length(self, joint: int) -> float:
        """Return the length of the longest path from the parent of `joint` down through `joint`."""
        return float(np.linalg.norm(self.skeleton.offsets[joint]) + self.reach[joint])

    def chain(self, joint: int) -> list[int]:
        """Return the joints of the longest path down the hierarchy, starting with `joint`."""
        found = [joint]
        while self.skeleton.children[found[-1]]:
            found.append(max(self.skeleton.children[found[-1]], key=self.length))
        return found


def _mirrored_pairs(shape: _Shape) -> tuple[list[tuple[int, int]], list[int]]:
    """Return the pairs of joints at which mirrored limbs begin, and the joints of the body axis."""
    pairs: list[tuple[int, int]] = []
    axis = [0]
    for joint in axis:  # the loop extends the list
        children = shape.skeleton.children[joint]
        limbs = sorted(sorted(children, key=shape.length)[-_MAX_LIMBS:])
        scores = sorted(
            (score, a, b)
            for a, b in combinations(limbs, 2)
            if (score := _asymmetry(shape, joint, a, b)) < 0.5
        )
        paired = set[int]()
        for _, a, b in scores:
            if paired.isdisjoint((a, b)):
                pairs.append((a, b))
                paired |= {a, b}
        axis += [child for child in children if child not in paired]
    return pairs, axis


def _asymmetry(shape: _Shape, joint: int, a: int, b: int) -> float:
    """Return how asymmetric the subtrees of two children of a joint are; 0 for mirror images.

    `a` and `b` are the children of `joint`.
    """
    sizes = len(shape.subtree[a]), len(shape.subtree[b])
    lengths = shape.length(a), shape.length(b)
    longer = max(lengths)
    score = abs(sizes[0] - sizes[1]) / max(sizes)
    if longer > 0:
        score += abs(lengths[0] - lengths[1]) / longer
        origin = shape.positions[joint]
        distances = [float(np.linalg.norm(shape.middle[child] - origin)) for child in (a, b)]
        score += abs(distances[0] - distances[1]) / longer
        if np.linalg.norm(shape.middle[a] - shape.middle[b]) < 0.02 * longer:
            score += 0.2  # the limbs coincide: unusual, but some files have such legs
    return score


def _limb(
    shape: _Shape, chain: list[int], roles: tuple[str, ...], connector: str
) -> list[tuple[int, str]]:
    """Return the joints of a limb with their parts, which are derived from its two long bones.

    `chain` holds the joints, `roles` the parts of the limb from the trunk outwards, and `connector`
    the part of the joints before the first of `roles`.
    """
    start, upper, lower = _long_bones(shape, chain, roles)
    parts = [connector] * start + [roles[0]] * (upper + 1 - start) + [roles[1]] * (lower - upper)
    parts += [roles[2], *[roles[3]] * len(chain)]
    return list(zip(chain, parts, strict=False))  # `chain` is shorter than `parts`


def _long_bones(shape: _Shape, chain: list[int], roles: tuple[str, ...]) -> tuple[int, int, int]:
    """Return three indices in `chain`: the start of the upper part, and the two long bones.

    `roles` is `LEG` or the parts of an arm. The bones of legs are searched from the start of the
    chain, those of arms from its end.
    """
    # The bone of a joint ends at the next joint, the last one at an end site.
    lengths = [float(np.linalg.norm(shape.skeleton.offsets[joint])) for joint in chain[1:]]
    lengths.append(float(shape.tips[chain[-1]]))
    longest = max(lengths)
    # A joint whose bone has no length, such as one before a roll joint, has the part of the next.
    bones = [index for index, length in enumerate(lengths) if length > 0.02 * longest]
    if longest == 0 or len(bones) < 2:
        return 0, 0, 1
    # Upper and lower bone are the longest two consecutive bones. A clavicle may be as long as
    # a forearm, and in unusual files a foot is as long as a thigh.
    pairs = [(lengths[a] + lengths[b], a, b) for a, b in pairwise(bones)]
    longest_pair = max(pairs)[0]
    ordered, share = (pairs, 0.85) if roles is LEG else (pairs[::-1], 0.9)
    upper, lower = next((a, b) for length, a, b in ordered if length >= share * longest_pair)
    before = [index for index in bones if index < upper]
    return (before[-1] + 1 if before else 0), upper, lower


def _spine(
    shape: _Shape, axis: list[int], legs: tuple[int, int] | None, arms: tuple[int, int] | None
) -> list[tuple[int, str]]:
    """Return the axial joints with their parts: "trunk" (up to the arms), "neck", "head", "tail".

    `axis` holds the axial joints; `legs` and `arms` the first joints of each pair of limbs.
    """
    skeleton = shape.skeleton
    hips = int(skeleton.parents[legs[0]]) if legs else 0
    between = [child for child in axis if skeleton.parents[child] == hips]
    found: list[tuple[int, str]] = []
    if arms is None:
        spine = max(between, key=shape.length, default=None)
        chain = [] if spine is None else unbranched_chain(skeleton, spine)
        found += [(joint, "trunk") for joint in chain[:-1]]
        # Without limbs, the end of the chain may not be a head.
        head = "head" if legs and len(chain) > 1 else "trunk"
        found += [(joint, head) for joint in chain[-1:]]
    else:
        chest = int(skeleton.parents[arms[0]])
        line = [chest, *skeleton.ancestors(chest)]
        core = skeleton.common_ancestor([chest, hips])
        spine = next((child for child in between if child in line), None)
        found += [(joint, "trunk") for joint in line[: line.index(core)]]
        upward = [child for child in axis if skeleton.parents[child] == chest]
        if chest != core and upward:
            chain = unbranched_chain(skeleton, max(upward, key=shape.length))
            found += [(joint, "neck") for joint in chain[:-1]]
            found += [(joint, "head") for joint in chain[-1:]]
    for child in between:
        if child != spine and len(shape.subtree[child]) > 1 and arms is not None:
            found += [(joint, "tail") for joint in shape.subtree[child]]
    return found


def _leftward(shape: _Shape, legs: tuple[int, int] | None) -> FloatArray | None:
    """Return a vector to the left of the body, from legs and feet in the rest pose.

    The result is None if the feet do not define it.
    """
    up, forward = np.zeros(3), np.zeros(3)
    for first in legs or ():
        chain = shape.chain(first)
        ankle = min(_long_bones(shape, chain, LEG)[2] + 1, len(chain) - 1)
        positions = shape.positions[chain]
        up += positions[0] - positions[ankle]
        ends = [s.offset for s in shape.skeleton.end_sites if s.parent == chain[-1]]
        tip = positions[-1] + (ends[0] if ends else 0.0)
        forward += tip - positions[ankle]
    height = float(np.linalg.norm(up))
    if not height:
        return None
    forward -= (forward @ up) / height**2 * up
    return np.cross(up, forward) if np.linalg.norm(forward) > 0.05 * height else None
