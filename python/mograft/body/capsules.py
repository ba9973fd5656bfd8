"""Capsules around the bones of a skeleton, world poses of a body, and clearances."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.anatomy import anatomy
from mograft.body.mass import mass_model, up_axis
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["RADII", "Capsules", "box_clearance", "capsules", "clearance"]

RADII: Mapping[str, float] = {
    "pelvis": 0.075,
    "trunk": 0.075,
    "clavicle": 0.03,
    "neck": 0.035,
    "head": 0.055,
    "upper_arm": 0.027,
    "forearm": 0.022,
    "hand": 0.02,
    "thigh": 0.045,
    "shank": 0.032,
    "foot": 0.025,
    "toe": 0.02,
    "tail": 0.02,
}
"""Capsule radius of each body part, in skeleton heights."""


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules around the bones of a skeleton; created by `capsules`."""

    joints: IntArray  # (n_capsules,)
    parts: tuple[str, ...]  # body part of each, as in `Anatomy`
    sides: tuple[str, ...]  # "left", "right" or ""
    bones: FloatArray  # from the joint to the other end, in its local axes, (n_capsules, 3)
    radii: FloatArray  # in the unit of the file, as `bones`

    def __len__(self) -> int:
        return len(self.joints)

    @cached_property
    def self_collision_pairs(self) -> IntArray:
        """Pairs of capsules that are tested for self-collision, shape (n_pairs, 2).

        Hands and forearms are tested against pelvis, trunk, head, thighs, and the hand and forearm
        of the other side.
        """
        body, arms = ("pelvis", "trunk", "head", "thigh"), ("hand", "forearm")
        kinds = list(enumerate(zip(self.parts, self.sides, strict=True)))
        own = [(a, side) for a, (part, side) in kinds if part in arms]
        pairs = [
            (a, b)
            for a, side in own
            for b, (other, other_side) in kinds
            if other in body or (other in arms and side != other_side)
        ]
        return np.array(pairs, np.int64).reshape(-1, 2)

    def ends(self, world_rotations: FloatArray, world_positions: FloatArray) -> FloatArray:
        """Return both ends of each capsule, shape (n_frames, n_capsules, 2, 3).

        `world_rotations`, xyzw, has shape (n_frames, n_joints, 4), `world_positions` (n_frames,
        n_joints, 3).
        """
        world = np.ascontiguousarray(world_rotations), np.ascontiguousarray(world_positions)
        return _core.capsule_ends(*world, self.joints, np.ascontiguousarray(self.bones))


def capsules(skeleton: Skeleton) -> Capsules:
    """Return capsules around the bones of a skeleton, one per bone.

    A bone of length 0 gives a sphere. The capsule of a hand reaches to the tip of the longest
    finger. Fingers, joints of the face, markers and ancestors of the hips have no capsule.
    """
    known, found = anatomy(skeleton), mass_model(skeleton)
    rest = skeleton.rest_positions()
    joints = [j for j, part in enumerate(known.parts) if part in RADII and j not in known.details]
    bones = found.bone.copy()
    for joint in known.joints("hand"):
        fingers = [f for f in known.joints("finger") if joint in skeleton.ancestors(f)]
        reach = [rest[f] + found.bone[f] - rest[joint] for f in fingers]
        if reach:
            bones[joint] = max(reach, key=lambda vector: float(np.linalg.norm(vector)))
    parts, sides = (tuple(own[joint] for joint in joints) for own in (known.parts, known.sides))
    radii = np.array([RADII[part] for part in parts]) * found.height
    return Capsules(np.array(joints, np.int64), parts, sides, bones[joints], radii)


@dataclass(frozen=True, eq=False)
class Poses:
    """World poses of a body in selected frames of a base motion.

    Attributes
    ----------
    skeleton : Skeleton
        The skeleton.
    frames : ndarray of int, shape (n,)
        Frame of the base motion of each pose; a frame may occur several times.
    rotations : ndarray, shape (n, n_joints, 4)
        World rotations.
    positions : ndarray, shape (n, n_joints, 3)
        World positions.
    frame_time : float
        Seconds from one frame to the next.
    capsules : Capsules
        Capsules around the bones.
    height : float
        Stature in the unit of the file.
    up : int
        Index of the vertical axis.
    """

    skeleton: Skeleton
    frames: IntArray
    rotations: FloatArray
    positions: FloatArray
    frame_time: float
    capsules: Capsules
    height: float
    up: int

    @classmethod
    def from_motion(cls, motion: Motion, shape: Capsules | None = None) -> "Poses":
        """Return the world poses of all frames of a motion.

        `shape` are the capsules that represent the body; by default those that `capsules` returns.
        """
        skeleton = motion.skeleton
        world_rotations, positions = motion.world_transforms()
        return cls(
            skeleton=skeleton,
            frames=np.arange(motion.n_frames),
            rotations=world_rotations,
            positions=positions,
            frame_time=motion.frame_time,
            capsules=capsules(skeleton) if shape is None else shape,
            height=mass_model(skeleton).height,
            up=up_axis(motion),
        )

    def with_poses(
        self, frames: IntArray, world_rotations: FloatArray, positions: FloatArray
    ) -> "Poses":
        """Return the same body with other poses."""
        return replace(self, frames=frames, rotations=world_rotations, positions=positions)

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: IntArray | BoolArray | slice) -> "Poses":
        return self.with_poses(self.frames[index], self.rotations[index], self.positions[index])

    @cached_property
    def ends(self) -> FloatArray:
        """Both ends of each capsule, shape (n, n_capsules, 2, 3)."""
        return self.capsules.ends(self.rotations, self.positions)

    def joint_positions(self, joint: str) -> FloatArray:
        """Return the world positions of the joint with this name, shape (n, 3)."""
        return self.positions[:, self.skeleton.index(joint)]


def clearance(
    ends: FloatArray,
    radii: FloatArray,
    others: FloatArray,
    other_radii: FloatArray,
    at: IntArray | None,
    pairs: IntArray,
) -> tuple[FloatArray, IntArray]:
    """Return the smallest distance between two sets of capsules, and the nearest pair, per frame.

    The first set has the ends `ends`, shape (n_frames, n, 2, 3), and the radii `radii`, shape (n,).
    The second set has the ends `others`, shape (n_other_frames, m, 2, 3), and the radii
    `other_radii`, shape (m,). Frame i of `ends` is compared with frame ``at[i]`` of `others`. If
    `at` is None, frame i is compared with frame i, or with the only frame of `others` if there is
    one.
    `pairs`, shape (n_pairs, 2), holds the indices of the capsules to compare in each set. The
    distances, shape (n_frames,), are minus the penetration depth if capsules
    overlap. The pairs of smallest distance have shape (n_frames, 2); ties go to the first. If
    `pairs` is empty, the distances are infinite and the indices -1. The closest points of two line
    segments follow Ericson, Real-Time Collision Detection (2005), 5.1.9.
    """
    if at is None:
        at = np.arange(len(ends)) if len(others) > 1 else np.zeros(len(ends), np.int64)
    left, right = np.ascontiguousarray(pairs.T, np.int64)
    first = np.ascontiguousarray(ends), np.ascontiguousarray(radii)
    second = np.ascontiguousarray(others), np.ascontiguousarray(other_radii)
    return _core.clearance(*first, *second, np.ascontiguousarray(at, np.int64), (left, right))


def box_clearance(
    ends: FloatArray, radii: FloatArray, center: FloatArray, half: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return the distance of each capsule from a box in every frame, shape (n_frames, n).

    The capsules have the ends `ends`, shape (n_frames, n, 2, 3), and `radii`, shape (n,). The box
    has its centre at `center`, half its side lengths in `half`, and its orientation as a
    quaternion, xyzw, in `rotation`. If a capsule penetrates the box, the distance is minus the
    depth. Distances are exact to 1e-7 of the capsule length.
    """
    box = (own.tolist() for own in (center, half, rotation))
    return _core.box_clearance(np.ascontiguousarray(ends), np.ascontiguousarray(radii), *box)
