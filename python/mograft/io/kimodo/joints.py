"""Joints and hierarchies of the skeletons of Kimodo: SOMA, SMPL-X without hands, and the robot G1.

Names and order are those of the public definitions in github.com/nv-tlabs/kimodo (Apache-2.0).
"""

from dataclasses import dataclass

from mograft.io.smpl.joints import BODY_JOINTS, smpl_parents


@dataclass(frozen=True)
class KimodoSkeleton:
    """Joints of a skeleton of Kimodo."""

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]  # -1 at the root


def _skeleton(name: str, text: str) -> KimodoSkeleton:
    """Return the skeleton that a text describes.

    The text has parts between ``|``, such as ``Chest > LeftShoulder LeftArm``: the names of joints,
    each of which is the parent of the next. The joint before ``>`` is the parent of the first. The
    first part begins with the root and has no ``>``. The joints are in the order of the text.
    """
    joints: list[str] = []
    parents: list[int] = []
    for part in text.split("|"):
        above, _, below = part.rpartition(">")
        parent = joints.index(above.strip()) if above.strip() else -1
        for joint in below.split():
            joints.append(joint)
            parents.append(parent)
            parent = len(joints) - 1
    return KimodoSkeleton(name, tuple(joints), tuple(parents))


def _both_sides(text: str) -> str:
    """Return a text twice, with ``Left`` and then with ``Right`` in place of ``Side``."""
    return f"{text} | {text}".replace("Side", "Left", text.count("Side")).replace("Side", "Right")


_TRUNK = "Hips Spine1 Spine2 Chest Neck1 Neck2 Head"
_FACE = "Head > Jaw | Head > LeftEye | Head > RightEye"
_ARM = "Chest > SideShoulder SideArm SideForeArm SideHand"
_LEG = "Hips > SideLeg SideShin SideFoot SideToeBase"
_FINGERS = " | ".join(
    f"SideHand > SideHand{finger}1 SideHand{finger}2 SideHand{finger}3"
    f"{'' if finger == 'Thumb' else f' SideHand{finger}4'} SideHand{finger}End"
    for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky")
)
_FINGER_ENDS = "SideHand > SideHandThumbEnd | SideHand > SideHandMiddleEnd"
_G1_LEG = (
    "pelvis_skel > side_hip_pitch_skel side_hip_roll_skel side_hip_yaw_skel side_knee_skel"
    " side_ankle_pitch_skel side_ankle_roll_skel side_toe_base"
)
_G1_ARM = (
    "waist_pitch_skel > side_shoulder_pitch_skel side_shoulder_roll_skel side_shoulder_yaw_skel"
    " side_elbow_skel side_wrist_roll_skel side_wrist_pitch_skel side_wrist_yaw_skel"
    " side_hand_roll_skel"
)
_G1 = " | ".join(
    [
        "pelvis_skel",
        *(_G1_LEG.replace("side", side) for side in ("left", "right")),
        "pelvis_skel > waist_yaw_skel waist_roll_skel waist_pitch_skel",
        *(_G1_ARM.replace("side", side) for side in ("left", "right")),
    ]
)

SOMA_30 = _skeleton(
    "SOMA", " | ".join([_TRUNK, _FACE, _both_sides(f"{_ARM} | {_FINGER_ENDS}"), _both_sides(_LEG)])
)
SOMA_77 = _skeleton(
    "SOMA",
    " | ".join(
        [
            f"{_TRUNK} HeadEnd",
            _FACE,
            _both_sides(f"{_ARM} | {_FINGERS}"),
            _both_sides(f"{_LEG} SideToeEnd"),
        ]
    ),
)
_SMPL_X_22 = KimodoSkeleton("SMPL-X", BODY_JOINTS, tuple(smpl_parents(BODY_JOINTS).tolist()))

SKELETONS = {
    len(skeleton.joints): skeleton
    for skeleton in (SOMA_30, SOMA_77, _skeleton("G1", _G1), _SMPL_X_22)
}
"""The skeletons by number of joints: files contain no names."""


def is_kimodo(names: frozenset[str]) -> bool:
    """Return whether an NPZ file with these arrays is a motion of Kimodo."""
    return {"posed_joints", "global_rot_mats"} <= names
