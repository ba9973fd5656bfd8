"""Joints and hierarchies of the body models SMPL, SMPL-H and SMPL-X.

Names and order are those of the public package ``smplx`` (Loper et al. 2015, Romero et al. 2017,
Pavlakos et al. 2019). The models themselves are licensed; nothing here comes from them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import IntArray
from mograft.motion.skeleton import CHANNELS

_PARENT_OF_BODY_JOINT = {
    "pelvis": "",
    "left_hip": "pelvis",
    "right_hip": "pelvis",
    "spine1": "pelvis",
    "left_knee": "left_hip",
    "right_knee": "right_hip",
    "spine2": "spine1",
    "left_ankle": "left_knee",
    "right_ankle": "right_knee",
    "spine3": "spine2",
    "left_foot": "left_ankle",
    "right_foot": "right_ankle",
    "neck": "spine3",
    "left_collar": "spine3",
    "right_collar": "spine3",
    "head": "neck",
    "left_shoulder": "left_collar",
    "right_shoulder": "right_collar",
    "left_elbow": "left_shoulder",
    "right_elbow": "right_shoulder",
    "left_wrist": "left_elbow",
    "right_wrist": "right_elbow",
}
_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_SIDES = ("left", "right")

BODY_JOINTS: tuple[str, ...] = tuple(_PARENT_OF_BODY_JOINT)
"""The 22 joints that all three models share, in their common order."""


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

PARENT_OF_JOINT = {**_PARENT_OF_BODY_JOINT, **_PALMS, **_FACE, **_hands()}
"""The joints of all three models with their parents; the pelvis has none, ``""``."""


def smpl_parents(joints: Sequence[str]) -> IntArray:
    """Return the index of the parent of each joint; -1 at the pelvis."""
    return np.array(
        [joints.index(PARENT_OF_JOINT[name]) if name != "pelvis" else -1 for name in joints]
    )


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


SMPL = BodyModel(
    "SMPL", (*BODY_JOINTS, *_PALMS), {"root_orient": slice(0, 3), "pose_body": slice(3, 72)}
)
SMPL_H = BodyModel(
    "SMPL-H",
    (*BODY_JOINTS, *_hands()),
    {"root_orient": slice(0, 3), "pose_body": slice(3, 66), "pose_hand": slice(66, 156)},
)
SMPL_X = BodyModel(
    "SMPL-X",
    (*BODY_JOINTS, *_FACE, *_hands()),
    {
        "root_orient": slice(0, 3),
        "pose_body": slice(3, 66),
        "pose_jaw": slice(66, 69),
        "pose_eye": slice(69, 75),
        "pose_hand": slice(75, 165),
    },
)
MODELS = (SMPL, SMPL_H, SMPL_X)


def is_amass(names: frozenset[str]) -> bool:
    """Return whether an NPZ file with these arrays is an AMASS motion."""
    return "trans" in names and ("poses" in names or {"root_orient", "pose_body"} <= names)
