"""The body models SMPL, SMPL-H and SMPL-X: joints, hierarchies and rest poses.

Names and order of the joints are those of the public package ``smplx`` (Loper et al. 2015, Romero
et al. 2017, Pavlakos et al. 2019). A rest pose is that of a skeleton that the user gives, or of the
stand-in skeleton. The models themselves are licensed; nothing here comes from them.

AMASS files contain rotations only, and the body models give the bone lengths.
The stand-in is a skeleton of published proportions of the body.

Heights, breadths and limb lengths are those of Drillis and Contini (1966), as reproduced by Winter,
Biomechanics and Motor Control of Human Movement, figure 4.1. As fractions of the stature: ankle
0.039, knee 0.285, hip 0.530, shoulder 0.818, chin 0.870 and eye 0.936 above the floor; half the
shoulder breadth 0.129; upper arm 0.186, forearm 0.146, hand 0.108. This project chose what that
source does not give: half the distance of the hip joints 0.050, the pelvis 0.030 above them, the
spine in four equal parts from there to the height of the shoulders, collars, balls of the feet,
fingers and the depth of the face. The pose is a T-pose, as in SMPL: y up, the left side at +x,
facing +z.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise, starmap

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import anatomy
from mograft.body.joint_names import ARM, LEG
from mograft.errors import join_names
from mograft.io.export_figure import UNITS, guess_unit
from mograft.motion.skeleton import CHANNELS, EndSite, Skeleton

BODY_JOINTS: tuple[str, ...] = (
    *("pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2"),
    *("left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar"),
    *("right_collar", "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow"),
    *("left_wrist", "right_wrist"),
)
"""The 22 joints that all three models share, in their common order."""

_BODY_PARENTS = (0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)
"""Indices of the parents of the body joints after the pelvis, as in ``kintree_table`` of SMPL."""

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_SIDES = ("left", "right")


def _hands() -> dict[str, str]:
    """Return the parents of the finger joints of both hands, by joint."""
    return {
        f"{side}_{finger}{joint}": f"{side}_{finger}{joint - 1}" if joint > 1 else f"{side}_wrist"
        for side in _SIDES
        for finger in _FINGERS
        for joint in (1, 2, 3)
    }


_PALMS = {f"{side}_hand": f"{side}_wrist" for side in _SIDES}
_FACE = dict.fromkeys(("jaw", "left_eye_smplhf", "right_eye_smplhf"), "head")

_BODY = dict(zip(BODY_JOINTS, ("", *(BODY_JOINTS[i] for i in _BODY_PARENTS)), strict=True))

PARENT_OF_JOINT = {**_BODY, **_PALMS, **_FACE, **_hands()}
"""The joints of all three models with their parents; the pelvis has none, ``""``."""


def smpl_parents(joints: Sequence[str]) -> IntArray:
    """Return the index of the parent of each joint; -1 at the pelvis."""
    parents = (PARENT_OF_JOINT[name] for name in joints)
    return np.array([joints.index(parent) if parent else -1 for parent in parents])


def smpl_channels(n_joints: int) -> tuple[tuple[str, ...], ...]:
    """Return the channels of the joints, which determine the angles in BVH files.

    The rotation order of the root is X, Z, Y. Its rotation contains about 90 degrees about x, from
    y up in the rest pose to z up in AMASS. In the usual order Z, X, Y, angles would be near gimbal
    lock.
    """
    root = (*CHANNELS[:3], "Xrotation", "Zrotation", "Yrotation")
    return (root, *[("Zrotation", "Xrotation", "Yrotation")] * (n_joints - 1))


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body model of the SMPL family."""

    name: str
    joints: tuple[str, ...]  # in the order of the columns of `poses`, three per joint
    columns: dict[str, slice]  # of `poses`, by the names of arrays that hold parts of it

    @property
    def n_columns(self) -> int:
        """Number of columns of `poses`: three per joint."""
        return 3 * len(self.joints)

    @property
    def parents(self) -> IntArray:
        """Index of each joint's parent, shape (n_joints,); -1 at the pelvis."""
        return smpl_parents(self.joints)


def _model(name: str, *joints: str, **widths: int) -> BodyModel:
    """Return a body model, given the numbers of columns of the arrays of its parts, in order."""
    bounds = pairwise(accumulate(widths.values(), initial=0))
    return BodyModel(name, joints, dict(zip(widths, starmap(slice, bounds), strict=True)))


SMPL = _model("SMPL", *BODY_JOINTS, *_PALMS, root_orient=3, pose_body=69)
SMPL_H = _model("SMPL-H", *BODY_JOINTS, *_hands(), root_orient=3, pose_body=63, pose_hand=90)
SMPL_X = _model(
    "SMPL-X",
    *BODY_JOINTS,
    *_FACE,
    *_hands(),
    root_orient=3,
    pose_body=63,
    pose_jaw=3,
    pose_eye=6,
    pose_hand=90,
)
MODELS = (SMPL, SMPL_H, SMPL_X)


STATURE = 1.7
"""Stature of the stand-in in metres."""

_PELVIS, _SHOULDER, _CHIN, _EYE = 0.560, 0.818, 0.870, 0.936
_WRIST, _HAND = 0.129 + 0.186 + 0.146, 0.108
_SPINE = [_PELVIS + (_SHOULDER - _PELVIS) * part / 4 for part in (1, 2, 3)]

# Positions of the joints in the middle and on the left, as fractions of the stature.
_POSITIONS = {
    "pelvis": (0.0, _PELVIS, 0.0),
    "spine1": (0.0, _SPINE[0], 0.0),
    "spine2": (0.0, _SPINE[1], 0.0),
    "spine3": (0.0, _SPINE[2], 0.0),
    "neck": (0.0, _SHOULDER, 0.0),
    "head": (0.0, _CHIN, 0.0),
    "jaw": (0.0, 0.880, 0.010),
    "left_eye_smplhf": (0.018, _EYE, 0.050),
    "left_hip": (0.050, 0.530, 0.0),
    "left_knee": (0.050, 0.285, 0.0),
    "left_ankle": (0.050, 0.039, 0.0),
    "left_foot": (0.050, 0.010, 0.075),
    "left_collar": (0.040, 0.800, 0.0),
    "left_shoulder": (0.129, _SHOULDER, 0.0),
    "left_elbow": (0.129 + 0.186, _SHOULDER, 0.0),
    "left_wrist": (_WRIST, _SHOULDER, 0.0),
    "left_hand": (_WRIST + 0.5 * _HAND, _SHOULDER, 0.0),
}
# Share of the hand from the wrist to each joint of a finger, and the distance to its left or right.
_FINGER_SHARES = {"thumb": (0.2, 0.38, 0.55)} | dict.fromkeys(
    ("index", "middle", "ring", "pinky"), (0.5, 0.72, 0.86)
)
_FINGER_SIDES = {"thumb": 0.016, "index": 0.012, "middle": 0.0, "ring": -0.010, "pinky": -0.019}
_POSITIONS |= {
    f"left_{finger}{joint}": (_WRIST + share * _HAND, _SHOULDER, side)
    for finger, side in _FINGER_SIDES.items()
    for joint, share in enumerate(_FINGER_SHARES[finger], 1)
}
# From the joint to the end of its bone.
_ENDS = {
    "head": (0.0, 1.0 - _CHIN, 0.0),
    "left_foot": (0.0, -0.010, 0.040),
    "left_hand": (0.5 * _HAND, 0.0, 0.0),
}

# A bone begins at the first joint of a body part and ends at the first joint of the next part.
_NEXT_PART = dict([*pairwise(LEG), *pairwise(ARM[:-1]), ("neck", "head")])


@cache
def stand_in(model: BodyModel) -> Skeleton:
    """Return the stand-in skeleton for a body model, in metres, with the pelvis at the origin."""
    joints, parents = model.joints, model.parents
    positions = np.array([_mirror(_POSITIONS, name) for name in joints])
    offsets = STATURE * (positions - positions[parents])
    offsets[0] = 0.0
    sites = tuple(
        EndSite(joint, STATURE * _mirror(_ENDS, name))
        for joint, name in enumerate(joints)
        if name.replace("right", "left") in _ENDS
    )
    return Skeleton(joints, parents, offsets, smpl_channels(len(joints)), sites)


def _mirror(vectors: dict[str, tuple[float, float, float]], name: str) -> FloatArray:
    """Return the vector of a joint; those on the right are mirror images of those on the left."""
    vector = np.array(vectors[name.replace("right", "left")])
    return vector * [-1.0, 1.0, 1.0] if name.startswith("right") else vector


def rest_skeleton(model: BodyModel, given: Skeleton | None) -> tuple[Skeleton, str]:
    """Return the skeleton of a body model in metres, and a note that states where it is from.

    Without a given skeleton, this is the stand-in. If the given skeleton has the joint names of
    SMPL, its rest pose is used unchanged. If it has other names, the result is the stand-in with
    the bone lengths of the given skeleton, which are assigned by body part. Raises ValueError if
    the given skeleton is not that of a human.
    """
    standard = stand_in(model)
    if given is None:
        note = f"a stand-in of {STATURE:g} m with published proportions, not the body of `betas`"
        return standard, f"offsets: {note}; give a skeleton for others"
    scale = UNITS[guess_unit(given)]
    indices = {_smpl_name(name): joint for joint, name in enumerate(given.names)}
    if indices.keys() >= set(BODY_JOINTS):
        return _named_skeleton(model, given, indices, scale)
    if not anatomy(given).human:
        expected, got = "that of a human with known joint names", join_names(given.names, 6)
        raise ValueError(f"`skeleton` must be {expected}, got {got}")
    note = "offsets: bone lengths of the given skeleton in the T-pose of the stand-in"
    return _scale(standard, _length_ratios(standard, given, scale)), note


def _named_skeleton(
    model: BodyModel, given: Skeleton, indices: dict[str, int], scale: float
) -> tuple[Skeleton, str]:
    """Return the skeleton of a body model with the rest pose of a skeleton with SMPL names.

    `indices` holds the index of each joint in `given` by SMPL name; lengths of `given` times
    `scale` are metres. Joints that `given` lacks get the offsets of the stand-in, scaled by the
    mean ratio of bone lengths. The result also has a note; see `rest_skeleton`.
    """
    standard = stand_in(model)
    positions = scale * given.rest_positions()
    ratio = float(np.mean(list(_length_ratios(standard, given, scale).values())))
    offsets, missing = ratio * standard.offsets, []
    for joint, name in enumerate(model.joints):
        parent = PARENT_OF_JOINT[name]
        if name not in indices or (parent and parent not in indices):
            missing.append(name)
            continue
        origin = positions[indices[parent]] if parent else np.zeros(3)
        offsets[joint] = positions[indices[name]] - origin
    sites = tuple(
        EndSite(joint, scale * site.offset)
        for joint, name in enumerate(model.joints)
        for site in given.end_sites
        if name in indices and site.parent == indices[name] and not standard.children[joint]
    )
    note = "offsets: those of the given skeleton"
    if missing:
        note += f"; of the stand-in for {join_names(missing)}"
    return Skeleton(model.joints, model.parents, offsets, standard.channels, sites), note


def _length_ratios(
    standard: Skeleton, given: Skeleton, scale: float
) -> dict[tuple[str, str], float]:
    """Return the ratio of the lengths of each bone in two skeletons, given to standard.

    The keys are body part and side; lengths of `given` are multiplied by `scale`. Raises ValueError
    if there is no ratio.
    """
    own, other = _bone_lengths(standard), _bone_lengths(given)
    ratios = {
        key: scale * other[key] / length
        for key, length in own.items()
        if length > 0 and other.get(key, 0.0) > 0
    }
    if not ratios:
        raise ValueError("`skeleton` must have bones longer than 0, got none")
    return ratios


def _bone_lengths(skeleton: Skeleton) -> dict[tuple[str, str], float]:
    """Return the length of each bone in the rest pose, by body part and side.

    A bone begins at the first joint of its part and ends at the first joint of the next part. Two
    bones of the pelvis, left and right, lead from the hips to the thighs, and the bone of the trunk
    leads from the hips to the neck.
    """
    known, positions = anatomy(skeleton), skeleton.rest_positions()
    first: dict[tuple[str, str], int] = {}
    for joint, key in enumerate(zip(known.parts, known.sides, strict=True)):
        first.setdefault(key, joint)
    lengths = {}
    for (part, side), joint in first.items():
        end = first.get((_NEXT_PART.get(part, ""), side))
        if end is not None:
            lengths[part, side] = float(np.linalg.norm(positions[end] - positions[joint]))
        if part in ("thigh", "neck"):
            bone = ("pelvis", side) if part == "thigh" else ("trunk", "")
            lengths[bone] = float(np.linalg.norm(positions[joint] - positions[known.hips]))
    return lengths


def _scale(standard: Skeleton, ratios: dict[tuple[str, str], float]) -> Skeleton:
    """Return the stand-in `standard` with the bones of each body part multiplied by its ratio.

    Parts without a ratio are multiplied by the mean of all ratios.
    """
    known = anatomy(standard)
    mean = float(np.mean(list(ratios.values())))
    scales = np.ones(standard.n_joints)
    bones = [*zip(known.parts, known.sides, strict=True)]
    for joint in range(1, standard.n_joints):
        part, side = bones[standard.parents[joint]]
        key = (part, bones[joint][1] if part == "pelvis" else side)
        if key == ("pelvis", ""):
            key = ("trunk", "")
        scales[joint] = ratios.get(key, mean)
    sites = tuple(EndSite(site.parent, mean * site.offset) for site in standard.end_sites)
    offsets = scales[:, None] * standard.offsets
    return Skeleton(standard.names, standard.parents, offsets, standard.channels, sites)


def _smpl_name(name: str) -> str:
    """Return the name that the package `smplx` uses for a joint, such as ``left_hip``.

    Bodies that the authors of SMPL distribute have variants of it: ``m_avg_L_Hip``, ``L_Hip`` and
    ``LeftHip``. Any other name is converted in the same way: to lower case, with underscores.
    """
    text = re.sub(r"^[mf]_avg_", "", name)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).casefold()
    text = re.sub(r"^l_", "left_", re.sub(r"^r_", "right_", text))
    return f"{text}_smplhf" if text in ("left_eye", "right_eye") else text
