"""A rest pose for SMPL joints without a body model: published proportions of the body.

Heights, breadths and limb lengths are those of Drillis and Contini (1966), as reproduced by Winter,
Biomechanics and Motor Control of Human Movement, figure 4.1. As fractions of the stature: ankle
0.039, knee 0.285, hip 0.530, shoulder 0.818, chin 0.870 and eye 0.936 above the floor; half the
shoulder breadth 0.129; upper arm 0.186, forearm 0.146, hand 0.108. This project chose what that
source does not give: half the distance of the hip joints 0.050, the pelvis 0.030 above them, the
spine in four equal parts from there to the height of the shoulders, collars, balls of the feet,
fingers and the depth of the face. The pose is a T-pose, as in SMPL: y up, the left side at +x,
facing +z.
"""

from functools import cache

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.io.smpl.joints import BodyModel, smpl_channels
from mograft.motion.skeleton import EndSite, Skeleton

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
# From the joint to the end of its bone.
_ENDS = {
    "head": (0.0, 1.0 - _CHIN, 0.0),
    "left_foot": (0.0, -0.010, 0.040),
    "left_hand": (0.5 * _HAND, 0.0, 0.0),
}


@cache
def stand_in(model: BodyModel) -> Skeleton:
    """Return the stand-in skeleton for a body model, in metres, with the pelvis at the origin."""
    positions = {name: _position(name) for name in model.joints}
    parents = model.parents
    offsets = [
        np.zeros(3) if parent < 0 else positions[name] - positions[model.joints[parent]]
        for name, parent in zip(model.joints, parents.tolist(), strict=True)
    ]
    sites = tuple(
        EndSite(joint, STATURE * _mirror(_ENDS, name))
        for joint, name in enumerate(model.joints)
        if name.replace("right", "left") in _ENDS
    )
    return Skeleton(
        model.joints,
        parents,
        STATURE * np.array(offsets),
        smpl_channels(len(model.joints)),
        end_sites=sites,
    )


def _position(name: str) -> FloatArray:
    """Return the position of a joint as fractions of the stature."""
    left = name.replace("right", "left")
    if left in _POSITIONS:
        return _mirror(_POSITIONS, name)
    finger, joint = left.removeprefix("left_")[:-1], int(left[-1])
    reach = _WRIST + _FINGER_SHARES[finger][joint - 1] * _HAND
    return _mirror({left: (reach, _SHOULDER, _FINGER_SIDES[finger])}, name)


def _mirror(vectors: dict[str, tuple[float, float, float]], name: str) -> FloatArray:
    """Return the vector of a joint; those on the right are mirror images of those on the left."""
    vector = np.array(vectors[name.replace("right", "left")])
    return vector * [-1.0, 1.0, 1.0] if name.startswith("right") else vector
