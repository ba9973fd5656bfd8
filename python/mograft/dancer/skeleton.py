"""The skeleton of the dancer and its dimensions, in cm; for its axes see `mograft.dancer`."""

from typing import TypeAlias

import numpy as np

from mograft.motion.skeleton import EndSite, Skeleton

Vector: TypeAlias = tuple[float, float, float]

# Name, parent, offset from the parent in cm.
JOINTS: tuple[tuple[str, str, Vector], ...] = (
    ("Hips", "", (0, 0, 0)),
    ("LeftUpLeg", "Hips", (9, -4, 0)),
    ("LeftLeg", "LeftUpLeg", (0, -42, 0)),
    ("LeftFoot", "LeftLeg", (0, -41, 0)),
    ("RightUpLeg", "Hips", (-9, -4, 0)),
    ("RightLeg", "RightUpLeg", (0, -42, 0)),
    ("RightFoot", "RightLeg", (0, -41, 0)),
    ("Spine", "Hips", (0, 12, 0)),
    ("Neck", "Spine", (0, 36, 0)),
    ("Head", "Neck", (0, 11, 1)),
    ("LeftShoulder", "Spine", (4, 31, 1)),
    ("LeftArm", "LeftShoulder", (13, 0, -1)),
    ("LeftForeArm", "LeftArm", (27, 0, 0)),
    ("LeftHand", "LeftForeArm", (25, 0, 0)),
    ("RightShoulder", "Spine", (-4, 31, 1)),
    ("RightArm", "RightShoulder", (-13, 0, -1)),
    ("RightForeArm", "RightArm", (-27, 0, 0)),
    ("RightHand", "RightForeArm", (-25, 0, 0)),
)
# Joint, offset of its end site in cm.
TIPS: tuple[tuple[str, Vector], ...] = (
    ("LeftFoot", (0, -7, 15)),
    ("RightFoot", (0, -7, 15)),
    ("Head", (0, 17, 1)),
    ("LeftHand", (16, 0, 0)),
    ("RightHand", (-16, 0, 0)),
)
INDEX = {name: joint for joint, (name, _, _) in enumerate(JOINTS)}
OFFSETS = np.array([offset for _, _, offset in JOINTS], dtype=np.float64)

X, Y, Z = np.eye(3)
# Lengths of thigh and shank, and of upper arm and forearm.
LEG_BONES = -OFFSETS[[INDEX["LeftLeg"], INDEX["LeftFoot"]], 1]
ARM_BONES = OFFSETS[[INDEX["LeftForeArm"], INDEX["LeftHand"]], 0]
# The sole is ANKLE_HEIGHT below the ankle and extends along z from the heel to the toe.
ANKLE_HEIGHT, TOE, HEEL = 7.0, 15.0, -5.0
ANKLE_BACK = 3.0  # distance of the ankle behind the hip, which puts the hip over the sole
TOE_OUT = np.radians(7.0)
# Legs and arms are never fully extended: the direction of the bend would be undefined and its
# speed unbounded.
LEG_REACH = 0.994 * LEG_BONES.sum()
ARM_REACH = 0.985 * ARM_BONES.sum()


def make_skeleton() -> Skeleton:
    """Return the skeleton of the dancer: 18 joints, 57 channels, rotations in the order ZYX."""
    rotations = ("Zrotation", "Yrotation", "Xrotation")
    root = ("Xposition", "Yposition", "Zposition", *rotations)
    parents = np.array([INDEX.get(parent, -1) for _, parent, _ in JOINTS])
    channels = (root, *[rotations] * (len(JOINTS) - 1))
    tips = tuple(EndSite(INDEX[name], np.array(offset)) for name, offset in TIPS)
    return Skeleton(tuple(INDEX), parents, OFFSETS, channels, tips)
