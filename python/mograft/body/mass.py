"""What a skeleton weighs, how high it stands and what it stands on."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, make_read_only, restore
from mograft.body.anatomy import Anatomy, anatomy
from mograft.body.body_parts import ARM, LEG
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["Foot", "MassModel", "center_of_mass", "mass_model", "moments_of_inertia", "up_axis"]

# de Leva 1996, trunk and head turned to proximal = hips and neck: mass, place of the centre of
# mass from the proximal end and transverse radius of gyration, in % of body mass and segment
# length, each male and female.
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
# Where the mass of a segment goes if the skeleton has no joint for it.
_NEXT = {
    "head": "trunk",
    "hand": "forearm",
    "forearm": "upper_arm",
    "upper_arm": "trunk",
    "foot": "shank",
    "shank": "thigh",
    "thigh": "trunk",
}
_SEGMENT = {
    "pelvis": "trunk",
    "clavicle": "trunk",
    "tail": "trunk",
    "neck": "head",
    "finger": "hand",
    "toe": "foot",
}
# A uniform rod about its middle: 1 / sqrt(12).
_ROD_CENTER, _ROD_GYRATION = 0.5, 0.289
# Hips to ankles and hips to head joint, together and alone, in statures. The shares of the two
# are rounded means over human hierarchies of several makers, not independent ones; they vary by
# 0.04 (standard deviation), so a stature from one alone is the rougher.
_BOTH, _LEGS, _UPPER = 0.87, 0.525, 0.345


@dataclass(frozen=True)
class Foot:
    """One foot of a skeleton.

    Parameters
    ----------
    side : str
        ``"left"``, ``"right"``, or ``""`` where nothing tells.
    ankle : int
        The joint that the foot turns about.
    toe : int or None
        The joint at the ball of the foot, if the skeleton has one.
    """

    side: str
    ankle: int
    toe: int | None


@dataclass(frozen=True, eq=False)
class MassModel:
    """Masses and lengths of a skeleton's bones; made by `body`.

    Parameters
    ----------
    model : str
        ``"de Leva"``: a human's masses. ``"rods"``: masses as the lengths of the bones, for
        animals and skeletons whose names tell too little.
    height : float
        Stature in the file's unit, independent of the pose.
    height_from : str
        What it was measured by: ``"legs and head"``, ``"legs"``, ``"head"``,
        ``"longest path"``, or ``"nothing"`` (all offsets are zero; it is 1 then).
    mass : ndarray, shape (n_joints,)
        Of each joint's bone, in body masses; they sum to 1.
    bone : ndarray, shape (n_joints, 3)
        From the joint to the end of its bone, in the joint's frame and the file's unit.
    center : ndarray, shape (n_joints,)
        Centre of mass along the bone, in bone lengths from the joint.
    gyration : ndarray, shape (n_joints,)
        Transverse radius of gyration about the centre of mass, in bone lengths.
    hips : int
        The joint that the body hangs on.
    head : int or None
        The joint that the head turns about, if the skeleton has one.
    feet : tuple of Foot
        Left before right. Empty if no leg is known.
    unmatched : tuple of str
        Names of joints that are known only by their place.
    """

    model: str
    height: float
    height_from: str
    mass: FloatArray
    bone: FloatArray
    center: FloatArray
    gyration: FloatArray
    hips: int
    head: int | None
    feet: tuple[Foot, ...]
    unmatched: tuple[str, ...]

    def __post_init__(self) -> None:
        for array in (self.mass, self.bone, self.center, self.gyration):
            make_read_only(array)

    def __setstate__(self, state: dict[str, Any]) -> None:
        restore(self, state)

    def __repr__(self) -> str:
        return f"Body({self.model}, height {self.height:.4g}, {len(self.feet)} feet)"

    @cached_property
    def inertia(self) -> FloatArray:
        """Moment of inertia of each bone about its joint, transverse, shape (n_joints,).

        In body masses times squared statures: ``m L² (c² + r²)``.
        """
        lengths = np.linalg.norm(self.bone, axis=1) / self.height
        own: FloatArray = self.mass * lengths**2 * (self.center**2 + self.gyration**2)
        make_read_only(own)
        return own


def mass_model(skeleton: Skeleton, *, sex: str = "mean") -> MassModel:
    """Return what a skeleton's parts weigh, its stature and its feet.

    Parameters
    ----------
    skeleton : Skeleton
        Human, animal or anything of bones.
    sex : str
        ``"female"``, ``"male"`` or their ``"mean"``; of the masses of a human.

    Returns
    -------
    Body
        By `anatomy`: de Leva's masses for humans with known names, else rods.

    Raises
    ------
    ValueError
        If the sex is none of these.

    Notes
    -----
    de Leva, Journal of Biomechanics 29 (1996). A part of several joints shares its mass as
    the lengths of their bones, each a rod; the mass of a part without joints goes to the next
    one nearer to the trunk. The face, markers and what stands above the hips weigh nothing.

    The bone of a joint ends at the child with the largest subtree, at the mean of all children
    in the pelvis and trunk, and at the end site of a leaf. The stature is (hips to ankles + hips
    to head joint) / 0.87 along the bones, within some 8 %; hips to ankles / 0.525 or hips to
    head / 0.345 where only one is known, else the longest way along the bones.

    Examples
    --------
    >>> skeleton = Skeleton(
    ...     ["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "Neck", "Head"],
    ...     [-1, 0, 1, 2, 0, 4],
    ...     [[0, 0, 0], [9, 0, 0], [0, -40, 0], [0, -40, 0], [0, 48, 0], [0, 10, 0]],
    ... )
    >>> round(mass_model(skeleton).height)
    169
    """
    if sex not in _COLUMNS:
        raise ValueError(f"sex must be one of {', '.join(_COLUMNS)}, got {sex!r}")
    return _body(_Bones.of(skeleton), sex)


_COLUMNS = {"male": [0], "female": [1], "mean": [0, 1]}


@dataclass(frozen=True)
class _Bones:
    """A skeleton that equals others of the same names, hierarchy, offsets and end sites."""

    content: tuple[object, ...]
    skeleton: Skeleton = field(compare=False)

    @classmethod
    def of(cls, skeleton: Skeleton) -> "_Bones":
        sites = tuple((site.parent, site.offset.tobytes()) for site in skeleton.end_sites)
        content = (skeleton.names, skeleton.parents.tobytes(), skeleton.offsets.tobytes(), sites)
        return cls(content, skeleton)


# Asked several times of every clip, and the clips of an actor share their bones.
@lru_cache(maxsize=64)
def _body(bones: _Bones, sex: str) -> MassModel:
    skeleton = bones.skeleton
    known = anatomy(skeleton)
    bone = _bones(skeleton, known)
    lengths = np.linalg.norm(bone, axis=1)
    weighs = np.array([part != "other" for part in known.parts])
    weighs[list(known.details)] = False
    limbs = [(p, s) for p, s in zip(known.parts, known.sides, strict=True) if p in ARM + LEG]
    if known.human and all(side for _, side in limbs):
        model = "de Leva"
        mass, center, gyration = _de_leva(known, lengths, weighs, _COLUMNS[sex])
    else:
        model = "rods"
        mass = _shares(np.where(weighs, lengths, 0.0), weighs)
        center = np.full(skeleton.n_joints, _ROD_CENTER)
        gyration = np.full(skeleton.n_joints, _ROD_GYRATION)
    head = next(iter(known.joints("head")), None)
    if head is None:
        head = next(iter(reversed(known.joints("neck"))), None)
    feet = _feet(skeleton, known)
    height, height_from = _height(skeleton, known.hips, head, feet)
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
        unmatched=tuple(skeleton.names[joint] for joint in known.unmatched),
    )


def moments_of_inertia(body: MassModel, skeleton: Skeleton, kind: str = "own") -> FloatArray:
    """Return the moment of inertia that each joint turns.

    Parameters
    ----------
    body : Body
        Of that skeleton.
    skeleton : Skeleton
        What it weighs.
    kind : str
        ``"own"``: of the joint's own bone, for angular velocities in the world.
        ``"subtree"``: of all that hangs on the joint, in the rest pose, for velocities
        relative to the parent. ``"unit"``: 1 for each bone that has a length.

    Returns
    -------
    ndarray, shape (n_joints,)
        About the joint, in body masses times squared statures; 0 for what stands above the
        hips and, except in a subtree, for bones without length.

    Raises
    ------
    ValueError
        If the kind is none of these.

    Examples
    --------
    >>> skeleton = Skeleton(["a", "b", "c"], [-1, 0, 1], [[0, 0, 0], [0, 1, 0], [0, 1, 0]])
    >>> moments_of_inertia(mass_model(skeleton), skeleton, "unit")
    array([1., 1., 0.])
    """
    if kind not in ("own", "subtree", "unit"):
        raise ValueError(f"kind must be 'own', 'subtree' or 'unit', got {kind!r}")
    if kind == "own":
        return body.inertia
    lengths = np.linalg.norm(body.bone, axis=1)
    below_hips = np.zeros(skeleton.n_joints, dtype=bool)
    below_hips[body.hips] = True
    for joint, parent in enumerate(skeleton.parents):
        below_hips[joint] |= bool(parent >= 0 and below_hips[parent])
    if kind == "unit":
        return np.where(below_hips & (lengths > 0), 1.0, 0.0)
    joints = skeleton.rest_positions()
    centers = joints + body.bone * body.center[:, None]
    # About the joint: mass, first and second moments summed from the leaves upwards.
    mass = body.mass.copy()
    first = body.mass[:, None] * centers
    second = body.mass * ((centers**2).sum(axis=1) + (body.gyration * lengths) ** 2)
    for joint in range(skeleton.n_joints - 1, 0, -1):
        parent = skeleton.parents[joint]
        mass[parent] += mass[joint]
        first[parent] += first[joint]
        second[parent] += second[joint]
    about = second - 2 * (first * joints).sum(axis=1) + mass * (joints**2).sum(axis=1)
    return np.where(below_hips, np.maximum(about, 0.0), 0.0) / body.height**2


def center_of_mass(motion: Motion) -> FloatArray:
    """Return where the centre of mass is, by the masses of `body`.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    ndarray, shape (n_frames, 3)
        In the file's unit.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> center_of_mass(dance(strides=1).motion)[0].round().tolist()
    [-0.0, 91.0, 7.0]
    """
    known = mass_model(motion.skeleton)
    turns, joints = motion.world_transforms()
    # One joint at a time: the whole of a long clip at once is many arrays of its size.
    center = np.zeros((motion.n_frames, 3))
    for joint, mass in enumerate(known.mass.tolist()):
        along = known.bone[joint] * known.center[joint]
        center += mass * (joints[:, joint] + rotations.rotate(turns[:, joint], along))
    return center


def up_axis(motion: Motion) -> int:
    """Return the axis of the world that points up or down: 0, 1 or 2 for x, y or z.

    Parameters
    ----------
    motion : Motion
        Of a body that mostly stands.

    Returns
    -------
    int
        The axis along which the hips are farthest from the feet in the mean over all frames.
        Where they are not, as in a split, or where the feet are unknown, that along which the
        head is from the feet or the hips; 1 where nothing tells.
    """
    found = mass_model(motion.skeleton)
    places = motion.world_positions().mean(axis=0)
    hips = places[found.hips]
    feet = places[[foot.ankle for foot in found.feet]].mean(axis=0) if found.feet else hips
    # Not the head at once: that of an animal is mostly before its feet.
    apart = hips - feet
    if np.abs(apart).max() < 0.1 * found.height and found.head is not None:
        apart = places[found.head] - feet
    return int(np.argmax(np.abs(apart))) if apart.any() else 1


def _bones(skeleton: Skeleton, known: Anatomy) -> FloatArray:
    """Return the vector from each joint to the end of its bone."""
    size = np.ones(skeleton.n_joints, dtype=int)
    for joint in range(skeleton.n_joints - 1, 0, -1):
        size[skeleton.parents[joint]] += size[joint]
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    bones = np.zeros((skeleton.n_joints, 3))
    for joint, children in enumerate(skeleton.children):
        ends = [site.offset for site in skeleton.end_sites if site.parent == joint]
        carried = [child for child in children if child not in known.details] or list(children)
        if known.parts[joint] == "other":
            continue  # it moves the body as a whole and is no bone of it
        if carried and known.parts[joint] in ("pelvis", "trunk"):
            bones[joint] = skeleton.offsets[carried].mean(axis=0)
        elif carried:
            bones[joint] = skeleton.offsets[max(carried, key=lambda c: (size[c], lengths[c]))]
        elif ends:
            bones[joint] = max(ends, key=lambda end: float(np.linalg.norm(end)))
    return bones


def _shares(weights: FloatArray, among: npt.NDArray[np.bool_]) -> FloatArray:
    """Return weights that sum to 1; equal ones if all are zero."""
    total = float(weights.sum())
    return weights / total if total > 0 else among / max(int(among.sum()), 1)


def _de_leva(
    known: Anatomy, lengths: FloatArray, weighs: npt.NDArray[np.bool_], columns: list[int]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mass, center and gyration of each joint's bone."""
    n_joints = len(lengths)
    members: dict[tuple[str, str], list[int]] = {}
    for joint, (part, side) in enumerate(zip(known.parts, known.sides, strict=True)):
        if weighs[joint]:
            segment = _SEGMENT.get(part, part)
            both = segment in ("head", "trunk")
            members.setdefault((segment, "" if both else side), []).append(joint)
    heavy = dict.fromkeys(members, 0.0)
    for segment, (mass_percent, _, _) in _DE_LEVA.items():
        for side in ("",) if segment in ("head", "trunk") else ("left", "right"):
            bearer = segment
            while (bearer, "" if bearer == "trunk" else side) not in members:
                bearer = _NEXT[bearer]
            key = (bearer, "" if bearer == "trunk" else side)
            heavy[key] += float(np.mean([mass_percent[column] for column in columns]))
    mass = np.zeros(n_joints)
    center = np.full(n_joints, _ROD_CENTER)
    gyration = np.full(n_joints, _ROD_GYRATION)
    for (segment, side), joints in members.items():
        own = np.zeros(n_joints, dtype=bool)
        own[joints] = True
        mass += heavy[segment, side] * _shares(np.where(own, lengths, 0.0), own)
        whole = [joint for joint in joints if lengths[joint] > 0]
        if len(whole) == 1:
            _, centers, gyrations = _DE_LEVA[segment]
            center[whole[0]] = np.mean([centers[column] for column in columns]) / 100
            gyration[whole[0]] = np.mean([gyrations[column] for column in columns]) / 100
    return mass / mass.sum(), center, gyration


def _feet(skeleton: Skeleton, known: Anatomy) -> tuple[Foot, ...]:
    """Return the feet, left before right: the first joint of each, and its first toe."""
    feet = []
    for ankle in known.joints("foot"):
        parent = int(skeleton.parents[ankle])
        if parent >= 0 and known.parts[parent] == "foot":
            continue
        below = {ankle}
        toes = []
        for joint, parent in enumerate(skeleton.parents):
            if int(parent) in below:
                below.add(joint)
                if known.parts[joint] == "toe" and known.parts[parent] != "toe":
                    toes.append(joint)
        lengths = np.linalg.norm(skeleton.offsets, axis=1)
        toe = max(toes, key=lambda t: (len(skeleton.children[t]), lengths[t]), default=None)
        feet.append(Foot(known.sides[ankle], ankle, toe))
    return tuple(sorted(feet, key=lambda foot: (foot.side != "left", foot.side, foot.ankle)))


def _height(
    skeleton: Skeleton, hips: int, head: int | None, feet: tuple[Foot, ...]
) -> tuple[float, str]:
    """Return the stature and what it was measured by."""
    leg = float(np.mean([_path(skeleton, hips, foot.ankle) for foot in feet])) if feet else 0.0
    upper = _path(skeleton, hips, head) if head is not None else 0.0
    if leg > 0 and upper > 0:
        return (leg + upper) / _BOTH, "legs and head"
    if leg > 0:
        return leg / _LEGS, "legs"
    if upper > 0:
        return upper / _UPPER, "head"
    longest = _longest_path(skeleton)
    return (longest, "longest path") if longest > 0 else (1.0, "nothing")


def _longest_path(skeleton: Skeleton) -> float:
    """Return the longest way between two joints along the bones."""
    reach = np.zeros(skeleton.n_joints)
    longest = 0.0
    for joint in range(skeleton.n_joints - 1, 0, -1):
        parent = skeleton.parents[joint]
        way = float(np.linalg.norm(skeleton.offsets[joint])) + reach[joint]
        longest = max(longest, reach[parent] + way)
        reach[parent] = max(reach[parent], way)
    return longest


def _path(skeleton: Skeleton, a: int, b: int) -> float:
    """Return the length of the way from one joint to another along the bones."""
    ways = []
    for joint in (a, b):
        way = []
        while joint >= 0:
            way.append(joint)
            joint = int(skeleton.parents[joint])
        ways.append(way)
    between = set(ways[0]) ^ set(ways[1])
    return float(np.linalg.norm(skeleton.offsets[sorted(between)], axis=1).sum())
