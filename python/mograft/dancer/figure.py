"""The figure that dances: joints, lengths and feet, in cm.

At rest it stands in a T-pose, faces z and has its left side at x.
"""

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
# Joint, end of its bone in cm.
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
THIGH, SHANK, UPPER_ARM, FOREARM = np.linalg.norm(
    [OFFSETS[INDEX[end]] for end in ("LeftLeg", "LeftFoot", "LeftForeArm", "LeftHand")], axis=-1
).tolist()
# The sole is below the ankle; it reaches from the toe, the tip of the foot, back to the heel.
ANKLE_HEIGHT, TOE, HEEL = 7.0, 15.0, -5.0
ANKLE_BACK = 3.0  # how far the ankle stands behind the hip, so that the sole carries
TOE_OUT = np.radians(7.0)
# A leg is never quite straight: there the knee would have no direction and a huge speed.
LEG_REACH = 0.994 * (THIGH + SHANK)
ARM_REACH = 0.985 * (UPPER_ARM + FOREARM)


def skeleton() -> Skeleton:
    """Return the figure: 18 joints, 57 channels, rotations in the order ZYX."""
    turns = ("Zrotation", "Yrotation", "Xrotation")
    root = ("Xposition", "Yposition", "Zposition", *turns)
    return Skeleton(
        tuple(INDEX),
        np.array([INDEX.get(parent, -1) for _, parent, _ in JOINTS]),
        OFFSETS,
        (root, *[turns] * (len(JOINTS) - 1)),
        tuple(EndSite(INDEX[name], np.array(offset)) for name, offset in TIPS),
    )
