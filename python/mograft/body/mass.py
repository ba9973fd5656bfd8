"""Mass model, stature and feet of a skeleton."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, ReadOnlyArrays, make_read_only
from mograft._util.containers import remember
from mograft._util.validate import check_choice
from mograft.body.anatomy import Anatomy, anatomy
from mograft.body.joint_names import ARM, LEG
from mograft.config import CHOICES
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

# Lengths in statures: hips to ankles plus hips to head joint, and each alone. They are rounded
# means over human skeletons of several sources. The two single lengths have a standard deviation
# of 0.04.
_LEGS_AND_HEAD, _LEGS, _HEAD = 0.87, 0.525, 0.345
# de Leva 1996, with hips and neck as the proximal ends of trunk and head. Mass in % of body mass,
# then centre of mass from the proximal end and transverse radius of gyration, both in % of
# segment length; each (male, female).
_DE_LEVA = {
    "head": ((6.94, 6.68), (50.0, 51.6), (31.5, 29.5)),
    "trunk": ((43.46, 42.57), (48.6, 50.4), (30.6, 29.2)),
    "upper_arm": ((2.71, 2.55), (57.7, 57.5), (26.9, 26.0)),
    "forearm": ((1.62, 1.38), (45.7, 45.6), (26.5, 25.7)),
    "hand": ((0.61, 0.56), (36.2, 34.3), (23.5, 20.8)),
    "thigh": ((14.16, 14.78), (41.0, 36.1), (32.9, 36.4)),
    "shank": ((4.33, 4.81), (44.0, 43.5), (24.6, 26.3)),
    "foot": ((1.37, 1.29), (44.2, 40.1), (24.5, 27.9)),
}
# The segment to which the mass of a segment without joints is added.
_LIMBS = (("hand", "forearm", "upper_arm", "trunk"), ("foot", "shank", "thigh", "trunk"))
_FALLBACK_SEGMENT = {"head": "trunk", **dict(pair for limb in _LIMBS for pair in pairwise(limb))}
_SEGMENT_OF_PART = dict.fromkeys(("pelvis", "clavicle", "tail"), "trunk")
_SEGMENT_OF_PART |= {"neck": "head", "finger": "hand", "toe": "foot"}
# Uniform rod about its middle: radius of gyration 1 / sqrt(12).
_ROD_CENTER, _ROD_GYRATION = 0.5, 0.289


@dataclass(frozen=True)
class Foot:
    """One foot of a skeleton."""

    side: str  # "left", "right" or "" if unknown
    ankle: int
    toe: int | None  # the joint at the ball of the foot, if the skeleton has one


@dataclass(frozen=True, eq=False)
class MassModel(ReadOnlyArrays):
    """Stature, feet, and masses and lengths of the bones of a skeleton; created by `mass_model`."""

    model: str  # "de Leva" (human) or "rods": masses proportional to bone length
    height: float  # stature in the unit of the file, independent of the pose; 1 if unknown
    height_from: str  # "legs and head", "legs", "head", "longest path" or "nothing"
    mass: FloatArray  # share of body mass of each joint's bone, (n_joints,); the sum is 1
    bone: FloatArray  # from the joint to the end of its bone, in its local axes, (n_joints, 3)
    center: FloatArray  # centre of mass along the bone, in bone lengths from the joint
    gyration: FloatArray  # transverse radius about the centre of mass, in bone lengths
    hips: int  # the lowest common ancestor of all body parts
    head: int | None
    feet: tuple[Foot, ...]  # left before right; empty if the skeleton has no known leg
    unmatched: tuple[str, ...]  # joints whose names are unknown

    def __repr__(self) -> str:
        return f"MassModel({self.model}, height {self.height:.4g}, {len(self.feet)} feet)"

    @cached_property
    def inertia(self) -> FloatArray:
        """Transverse moment of inertia of each bone about its joint, shape (n_joints,).

        The moment is ``m L² (c² + r²)``, with mass m and length L of the bone; centre of mass c and
        radius of gyration r are in bone lengths. The unit is body mass times squared stature.
        """
        lengths = np.linalg.norm(self.bone, axis=1) / self.height
        moments: FloatArray = self.mass * lengths**2 * (self.center**2 + self.gyration**2)
        make_read_only(moments)
        return moments


def mass_model(skeleton: Skeleton) -> MassModel:
    """Return the mass model, stature and feet of a skeleton.

    Humans with known joint names have the masses of de Leva, Journal of Biomechanics 29 (1996), the
    means of men and women. If a body part has several joints, its mass is divided in proportion to
    bone length, and each bone is a uniform rod. The mass of a part without joints is added to the
    next part towards the trunk. Joints of the face, markers and ancestors of the hips have mass 0.
    In other skeletons each bone is a uniform rod with mass proportional to its length.
    """
    return remember(skeleton, "mass model", lambda: _compute_mass_model(skeleton))


def _compute_mass_model(skeleton: Skeleton) -> MassModel:
    known = anatomy(skeleton)
    bone = _bone_vectors(skeleton, known)
    lengths = np.linalg.norm(bone, axis=1)
    has_mass = np.array([part != "other" for part in known.parts])
    has_mass[list(known.details)] = False
    limbs = [(p, s) for p, s in zip(known.parts, known.sides, strict=True) if p in ARM + LEG]
    model, mass = "rods", _rod_masses(lengths, has_mass)
    center, gyration = (np.full(len(lengths), own) for own in (_ROD_CENTER, _ROD_GYRATION))
    if known.human and all(side for _, side in limbs):
        model = "de Leva"
        mass = _de_leva_masses(known, lengths, has_mass, center, gyration)
    head = next(iter(known.joints("head") or known.joints("neck")[::-1]), None)
    feet = _feet(skeleton, known)
    height, height_from = _height(skeleton, known.hips, head, feet)
    unmatched = tuple(skeleton.names[joint] for joint in known.unmatched)
    return MassModel(
        model=model,
        height=height,
        height_from=height_from,
        mass=mass,
        bone=bone,
        center=center,
        gyration=gyration,
        hips=known.hips,
        head=head,
        feet=feet,
        unmatched=unmatched,
    )


def moments_of_inertia(body: MassModel, skeleton: Skeleton, inertia: str = "own") -> FloatArray:
    """Return the moment of inertia about each joint, shape (n_joints,).

    `inertia` selects the bones, as in `Config`. ``"own"`` counts only the bone of the joint, for
    angular velocities relative to the world. ``"subtree"`` counts all bones from the joint
    downwards in the rest pose, for angular velocities relative to the parent. Both are in body
    masses times squared statures. ``"unit"`` is 1 for every bone of nonzero length. Ancestors of
    the hips have moment 0.
    """
    check_choice("inertia", inertia, CHOICES["inertia"])
    if inertia == "own":
        return body.inertia
    lengths = np.linalg.norm(body.bone, axis=1)
    below_hips = skeleton.subtree_mask([body.hips])
    if inertia == "unit":
        return np.where(below_hips & (lengths > 0), 1.0, 0.0)
    joints = skeleton.rest_positions()
    centers = joints + body.bone * body.center[:, None]
    # Sum mass, first and second moments from the leaves upwards, then shift to the joint.
    mass, first = body.mass.copy(), body.mass[:, None] * centers
    second = body.mass * ((centers**2).sum(axis=1) + (body.gyration * lengths) ** 2)
    for joint in range(skeleton.n_joints - 1, 0, -1):
        for moment in (mass, first, second):
            moment[skeleton.parents[joint]] += moment[joint]
    moments = second - 2 * (first * joints).sum(axis=1) + mass * (joints**2).sum(axis=1)
    return np.where(below_hips, np.maximum(moments, 0.0), 0.0) / body.height**2


def center_of_mass(motion: Motion) -> FloatArray:
    """Return the centre of mass in every frame, shape (n_frames, 3), in the unit of the file."""
    known = mass_model(motion.skeleton)
    center = np.zeros((motion.n_frames, 3))
    for frames, world_rotations, positions in motion.world_blocks():
        for joint, mass in enumerate(known.mass.tolist()):
            if mass > 0.0:
                local_center = known.bone[joint] * known.center[joint]
                rotated = rotations.rotate(world_rotations[:, joint], local_center)
                center[frames] += mass * (positions[:, joint] + rotated)
    return center


def mean_world_positions(motion: Motion) -> FloatArray:
    """Return the mean world position of each joint, shape (n_joints, 3), cached for the motion."""

    def compute() -> FloatArray:
        total = np.zeros(motion.positions.shape[1:])
        for _, _, positions in motion.world_blocks():
            total = np.concatenate([total[None], positions]).sum(axis=0)
        return total / motion.n_frames

    return remember(motion, "mean world positions", compute)


def up_axis(motion: Motion) -> int:
    """Return the vertical axis of the world, 0 to 2, from a motion that is mostly upright.

    It is the axis along which the mean positions of hips and feet differ most. If this difference
    is below 0.1 statures (as in a split), the head is compared with the feet instead. If the feet
    are unknown, the head is compared with the hips. If feet and head are unknown, the result is 1.
    """
    found = mass_model(motion.skeleton)
    means = mean_world_positions(motion)
    hips = means[found.hips]
    feet = means[[foot.ankle for foot in found.feet]].mean(axis=0) if found.feet else hips
    # Hips first: the head of an animal is in front of its feet.
    offset = hips - feet
    if np.abs(offset).max() < 0.1 * found.height and found.head is not None:
        offset = means[found.head] - feet
    return int(np.argmax(np.abs(offset))) if offset.any() else 1


def up_sign(skeleton: Skeleton, heights: FloatArray) -> float:
    """Return -1.0 if the head is below the feet, else 1.0.

    `heights`, shape (n_joints,), are coordinates of the joints along the vertical axis. If head or
    feet are unknown, the hips take their place.
    """
    found = mass_model(skeleton)
    low = [foot.ankle for foot in found.feet] or [found.hips]
    high = found.hips if found.head is None else found.head
    return -1.0 if heights[high] < heights[low].mean() else 1.0


def _rod_masses(lengths: FloatArray, has_mass: BoolArray) -> FloatArray:
    """Return the mass of each bone as a uniform rod; the sum is 1.

    Masses are proportional to the lengths; if all lengths are 0, they are equal. Joints without
    `has_mass` have mass 0.
    """
    weights = np.where(has_mass, lengths, 0.0)
    total = float(weights.sum())
    return weights / total if total > 0 else has_mass / max(int(has_mass.sum()), 1)


def _de_leva_masses(
    known: Anatomy,
    lengths: FloatArray,
    has_mass: BoolArray,
    center: FloatArray,
    gyration: FloatArray,
) -> FloatArray:
    """Return the mass of each bone from de Leva's table; set centres and radii, in place.

    If a body segment has several bones, its mass is divided in proportion to their lengths, and
    their centres of mass and radii of gyration stay those of uniform rods.
    """
    members: dict[tuple[str, str], list[int]] = {}
    for joint, (part, side) in enumerate(zip(known.parts, known.sides, strict=True)):
        if has_mass[joint]:
            segment = _SEGMENT_OF_PART.get(part, part)
            is_central = segment in ("head", "trunk")
            members.setdefault((segment, "" if is_central else side), []).append(joint)
    segment_mass = dict.fromkeys(members, 0.0)
    for segment, (mass_percent, _, _) in _DE_LEVA.items():
        for side in ("",) if segment in ("head", "trunk") else ("left", "right"):
            receiver = segment
            while (key := (receiver, "" if receiver == "trunk" else side)) not in members:
                receiver = _FALLBACK_SEGMENT[receiver]
            segment_mass[key] += float(np.mean(mass_percent))
    mass = np.zeros(len(lengths))
    for (segment, side), joints in members.items():
        is_member = np.isin(np.arange(len(lengths)), joints)
        mass += segment_mass[segment, side] * _rod_masses(lengths, is_member)
        bones = [joint for joint in joints if lengths[joint] > 0]
        if len(bones) == 1:
            _, centers, gyrations = _DE_LEVA[segment]
            center[bones[0]], gyration[bones[0]] = np.mean([centers, gyrations], axis=1) / 100
    return mass / mass.sum()


def _bone_vectors(skeleton: Skeleton, known: Anatomy) -> FloatArray:
    """Return the vector from each joint to the end of its bone, shape (n_joints, 3).

    A bone ends at the child with the largest subtree. In pelvis and trunk it ends at the mean of
    all children. Joints of the face and markers count only if there are no other children. The
    bone of a leaf joint ends at its farthest end site. Ancestors of the hips have no bone.
    """
    size = np.ones(skeleton.n_joints, dtype=int)
    for joint in range(skeleton.n_joints - 1, 0, -1):
        size[skeleton.parents[joint]] += size[joint]
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    bones, details = np.zeros((skeleton.n_joints, 3)), set(known.details)
    for joint, children in enumerate(skeleton.children):
        ends = [s.offset for s in skeleton.children_and_sites[joint] if isinstance(s, EndSite)]
        main = [child for child in children if child not in details] or list(children)
        if known.parts[joint] == "other":
            continue  # an ancestor of the hips has no bone
        if main and known.parts[joint] in ("pelvis", "trunk"):
            bones[joint] = skeleton.offsets[main].mean(axis=0)
        elif main:
            bones[joint] = skeleton.offsets[max(main, key=lambda c: (size[c], lengths[c]))]
        elif ends:
            bones[joint] = max(ends, key=lambda end: float(np.linalg.norm(end)))
    return bones


def _feet(skeleton: Skeleton, known: Anatomy) -> tuple[Foot, ...]:
    """Return the feet, left before right, each with its ankle and the joint at its ball."""
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    feet = []
    for ankle in known.highest("foot", skeleton):
        is_below = skeleton.subtree_mask([ankle])
        toes = [joint for joint in known.highest("toe", skeleton) if is_below[joint]]
        toe = max(toes, key=lambda t: (len(skeleton.children[t]), lengths[t]), default=None)
        feet.append(Foot(known.sides[ankle], ankle, toe))
    return tuple(sorted(feet, key=lambda foot: (foot.side != "left", foot.side, foot.ankle)))


def _height(
    skeleton: Skeleton, hips: int, head: int | None, feet: tuple[Foot, ...]
) -> tuple[float, str]:
    """Return the stature, measured along the bones, and the name of the measured distances.

    The stature is (hips to ankles + hips to head joint) / 0.87. If only one distance is known, the
    stature is (hips to ankles) / 0.525, or (hips to head joint) / 0.345. If neither is known, the
    stature is the longest path between two joints, or 1 if all bones have length 0.
    """
    legs = [path_length(skeleton, hips, foot.ankle) for foot in feet]
    leg = float(np.mean(legs)) if legs else 0.0
    upper = path_length(skeleton, hips, head) if head is not None else 0.0
    if leg > 0 and upper > 0:
        return (leg + upper) / _LEGS_AND_HEAD, "legs and head"
    if leg > 0 or upper > 0:
        return (leg / _LEGS, "legs") if leg > 0 else (upper / _HEAD, "head")
    reach, longest = np.zeros(skeleton.n_joints), 0.0
    for joint in range(skeleton.n_joints - 1, 0, -1):
        parent = skeleton.parents[joint]
        length = float(np.linalg.norm(skeleton.offsets[joint])) + reach[joint]
        longest = max(longest, reach[parent] + length)
        reach[parent] = max(reach[parent], length)
    return (longest, "longest path") if longest > 0 else (1.0, "nothing")


def path_length(skeleton: Skeleton, a: int, b: int) -> float:
    """Return the length of the path between joints `a` and `b` along the bones."""
    between = {a, *skeleton.ancestors(a)} ^ {b, *skeleton.ancestors(b)}
    return float(np.linalg.norm(skeleton.offsets[sorted(between)], axis=1).sum())
