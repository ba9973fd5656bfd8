"""NPZ files of Kimodo, with the joints of its skeletons: SOMA, SMPL-X without hands, the robot G1.

Names and order are those of the public definitions in github.com/nv-tlabs/kimodo (Apache-2.0).
"""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.errors import join_names
from mograft.io.clips import Clips, errors_of_file, single_clip
from mograft.io.npz import NpzArchive, open_npz_archive
from mograft.io.rest_pose import to_local
from mograft.io.smpl.body_models import BODY_JOINTS, smpl_parents
from mograft.motion import limits, rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton, usual_channels

RATE = 30.0
"""Frames per second of the models of Kimodo; their files do not state it."""

_ORTHONORMAL_TOLERANCE = 1e-3
_RIGID_TOLERANCE = 2e-5
"""Distance of a joint from its mean offset, as a fraction of the figure's largest extent, up to
which its bone is rigid. Positions in single precision, some metres from the origin, need it."""


class KimodoSkeleton(NamedTuple):
    """Joints of a skeleton of Kimodo."""

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]  # -1 at the root


def _skeleton(name: str, *texts: str) -> KimodoSkeleton:
    """Return the skeleton that texts describe.

    A text has chains of joints between ``|``, such as ``Chest LeftShoulder LeftArm``, each of which
    is the parent of the next. The first chain begins with the root, the others with a joint of an
    earlier chain. The joints are in the order of the texts.
    """
    chains = [chain.split() for text in texts for chain in text.split("|")]
    above = {chains[0][0]: ""}
    above |= {joint: parent for chain in chains for parent, joint in pairwise(chain)}
    joints = list(above)
    parents = [joints.index(parent) if parent else -1 for parent in above.values()]
    return KimodoSkeleton(name, tuple(joints), tuple(parents))


def _both_sides(text: str) -> str:
    """Return a text twice, with ``Left`` and then with ``Right`` in place of ``Side``.

    Names in lower case have ``left`` and ``right`` in place of ``side``.
    """
    sides = (("Left", "left"), ("Right", "right"))
    return "|".join(text.replace("Side", own).replace("side", lower) for own, lower in sides)


_TRUNK = "Hips Spine1 Spine2 Chest Neck1 Neck2 Head"
_FACE = "Head Jaw | Head LeftEye | Head RightEye"
_ARM = "Chest SideShoulder SideArm SideForeArm SideHand"
_LEG = "Hips SideLeg SideShin SideFoot SideToeBase"
_FINGERS = " | ".join(
    f"SideHand SideHand{finger}1 SideHand{finger}2 SideHand{finger}3"
    f"{'' if finger == 'Thumb' else f' SideHand{finger}4'} SideHand{finger}End"
    for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky")
)
_FINGER_ENDS = "SideHand SideHandThumbEnd | SideHand SideHandMiddleEnd"
_G1_LEG = (
    "pelvis_skel side_hip_pitch_skel side_hip_roll_skel side_hip_yaw_skel side_knee_skel"
    " side_ankle_pitch_skel side_ankle_roll_skel side_toe_base"
)
_G1_ARM = (
    "waist_pitch_skel side_shoulder_pitch_skel side_shoulder_roll_skel side_shoulder_yaw_skel"
    " side_elbow_skel side_wrist_roll_skel side_wrist_pitch_skel side_wrist_yaw_skel"
    " side_hand_roll_skel"
)
_G1_WAIST = "pelvis_skel waist_yaw_skel waist_roll_skel waist_pitch_skel"
_G1 = _skeleton("G1", "pelvis_skel", _both_sides(_G1_LEG), _G1_WAIST, _both_sides(_G1_ARM))
_FISTS, _HANDS = (_both_sides(f"{_ARM} | {own}") for own in (_FINGER_ENDS, _FINGERS))
SOMA_30 = _skeleton("SOMA", _TRUNK, _FACE, _FISTS, _both_sides(_LEG))
SOMA_77 = _skeleton("SOMA", f"{_TRUNK} HeadEnd", _FACE, _HANDS, _both_sides(f"{_LEG} SideToeEnd"))
_SMPL_X_22 = KimodoSkeleton("SMPL-X", BODY_JOINTS, tuple(smpl_parents(BODY_JOINTS).tolist()))

SKELETONS = {len(own.joints): own for own in (SOMA_30, SOMA_77, _G1, _SMPL_X_22)}
"""The skeletons by number of joints: files contain no names."""


def open_kimodo(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clip of a file of Kimodo; see `mograft.io.formats.Opener`.

    The number of joints determines the skeleton, a value of `SKELETONS`. Rotation matrices are
    relative to its rest pose. Offsets are the mean positions of the joints in the axes of their
    parents; a joint whose position differs from its offset in some frame has position channels.
    Axes are those of the file, and lengths are in metres.
    """
    archive = open_npz_archive(path)
    shape = archive.header("posed_joints", ("n_frames", "n_joints", 3)).shape
    n_frames, n_joints = shape[:2]
    archive.header("global_rot_mats", (n_frames, n_joints, 3, 3))
    if n_joints not in SKELETONS:
        known = ", ".join(f"{count} ({own.name})" for count, own in sorted(SKELETONS.items()))
        raise archive.error("posed_joints", f"expected {known} joints, got {n_joints}")
    if n_frames == 0:
        raise archive.error("posed_joints", "expected at least one frame, got none")
    with errors_of_file(path, "array `posed_joints`"):
        limits.check_frames(n_frames)
    others = [name for name in archive.headers if name not in ("posed_joints", "global_rot_mats")]
    notes = [f"frames per second: {RATE:g}, that of Kimodo's models; the file states none"]
    if others:
        notes.append(f"arrays that are not part of the motion: {join_names(others)}")
    kind = SKELETONS[n_joints]
    form = f"Kimodo {kind.name}"
    return single_clip(path, form, lambda: _to_motion(archive, kind, n_frames), rate, notes=notes)


def _to_motion(archive: NpzArchive, kind: KimodoSkeleton, n_frames: int) -> Motion:
    """Return the motion of a file of Kimodo."""
    n_joints = len(kind.joints)
    world_positions = archive.read_floats("posed_joints", (n_frames, n_joints, 3))
    matrices = archive.read_floats("global_rot_mats", (n_frames, n_joints, 3, 3))
    _check_matrices(archive, matrices)
    parents = np.array(kind.parents)
    world_rotations = rotations.from_matrices(matrices)
    local, positions = to_local(parents, world_rotations, world_positions)
    offsets = positions.mean(axis=0)
    offsets[0] = 0.0
    extent = float(np.ptp(world_positions, axis=1).max())
    is_rigid = np.abs(positions - offsets).max(axis=(0, 2)) <= _RIGID_TOLERANCE * extent
    is_rigid[0] = False
    positions[:, is_rigid] = offsets[is_rigid]
    skeleton = Skeleton(kind.joints, parents, offsets, usual_channels(~is_rigid))
    return Motion(skeleton, 1.0 / RATE, rotations.continuous_signs(local), positions)


def _check_matrices(archive: NpzArchive, matrices: FloatArray) -> None:
    """Raise `FormatError` if a matrix is not a rotation."""
    bounded = np.clip(matrices, -2.0, 2.0)  # products of larger numbers could overflow
    products = np.einsum("...ij,...kj->...ik", bounded, bounded)
    gaps = np.abs(products - np.eye(3)).max(axis=(-2, -1))
    invalid = (gaps > _ORTHONORMAL_TOLERANCE) | (np.linalg.det(bounded) < 0)
    if invalid.any():
        index = np.argwhere(invalid)[0].tolist()
        message = f"expected rotation matrices, got a matrix that is none at {index}"
        raise archive.error("global_rot_mats", message)
