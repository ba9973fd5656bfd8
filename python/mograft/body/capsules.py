"""Capsules around the bones of a skeleton, and distances between capsules."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import anatomy
from mograft.body.mass import mass_model
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
    """Capsules around the bones of a skeleton; created by `capsules`.

    Attributes
    ----------
    joints : ndarray of int, shape (n_capsules,)
        The joint of each capsule.
    parts : tuple of str
        Body part of each, as in `mograft.body.anatomy`.
    sides : tuple of str
        ``"left"``, ``"right"`` or ``""``.
    bones : ndarray, shape (n_capsules, 3)
        Vector from the joint to the other end, in the joint frame and the unit of the file.
    radii : ndarray, shape (n_capsules,)
        In the unit of the file.
    """

    joints: IntArray
    parts: tuple[str, ...]
    sides: tuple[str, ...]
    bones: FloatArray
    radii: FloatArray

    def __len__(self) -> int:
        return len(self.joints)

    @cached_property
    def self_collision_pairs(self) -> IntArray:
        """Pairs of capsules that are tested for self-collision, shape (n_pairs, 2).

        Each hand and forearm with trunk, head, thighs and the other hand and forearm.
        """
        kinds = list(zip(self.parts, self.sides, strict=True))
        pairs = [
            (a, b)
            for a, (part, side) in enumerate(kinds)
            for b, (other, other_side) in enumerate(kinds)
            if part in ("hand", "forearm")
            and (
                other in ("pelvis", "trunk", "head", "thigh")
                or (other in ("hand", "forearm") and side != other_side)
            )
        ]
        return np.array(pairs, np.int64).reshape(-1, 2)

    def ends(self, world_rotations: FloatArray, world_positions: FloatArray) -> FloatArray:
        """Return the end points of the capsules in some poses.

        Parameters
        ----------
        world_rotations : ndarray, shape (n_frames, n_joints, 4)
            World rotations of the joints.
        world_positions : ndarray, shape (n_frames, n_joints, 3)
            World positions of the joints.

        Returns
        -------
        ndarray, shape (n_frames, n_capsules, 2, 3)
            Both ends of each capsule, in the unit of the file.
        """
        return _core.capsule_ends(
            np.ascontiguousarray(world_rotations),
            np.ascontiguousarray(world_positions),
            self.joints,
            np.ascontiguousarray(self.bones),
        )


def capsules(skeleton: Skeleton, radii: Mapping[str, float] | None = None) -> Capsules:
    """Return capsules around the bones of a skeleton.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    radii : mapping of str to float, optional
        Radii in skeleton heights by body part, replacing those of `RADII`; 0 omits a part.

    Returns
    -------
    Capsules
        One per bone; a bone of length 0 gives a sphere. The capsule of a hand reaches to the tip
        of the longest finger. Joints of the face and markers have no capsule.

    Raises
    ------
    ValueError
        If a body part is unknown or a radius is negative.

    Examples
    --------
    >>> names, offsets = ["Hips", "LeftUpLeg", "LeftLeg"], [[0, 0, 0], [9, 0, 0], [0, -40, 0]]
    >>> skeleton = Skeleton(names, [-1, 0, 1], offsets)
    >>> capsules(skeleton, {"pelvis": 0}).parts
    ('thigh', 'shank')
    """
    changed = {} if radii is None else dict(radii)
    for part, radius in changed.items():
        if part not in RADII:
            raise ValueError(f"`radii` must have keys of {', '.join(RADII)}, got {part!r}")
        if not radius >= 0:
            raise ValueError(f"the radius of {part!r} must not be negative, got {radius}")
    radius_of_part = {**RADII, **changed}
    known, found = anatomy(skeleton), mass_model(skeleton)
    rest = skeleton.rest_positions()
    joints = [
        joint
        for joint, part in enumerate(known.parts)
        if radius_of_part.get(part, 0.0) > 0 and joint not in known.details
    ]
    bones = found.bone.copy()
    for joint in known.joints("hand"):
        fingers = [f for f in known.joints("finger") if joint in skeleton.ancestors(f)]
        reach = [rest[f] + found.bone[f] - rest[joint] for f in fingers]
        if reach:
            bones[joint] = max(reach, key=lambda vector: float(np.linalg.norm(vector)))
    return Capsules(
        np.array(joints, np.int64),
        tuple(known.parts[joint] for joint in joints),
        tuple(known.sides[joint] for joint in joints),
        bones[joints],
        np.array([radius_of_part[known.parts[joint]] for joint in joints]) * found.height,
    )


def clearance(
    ends: FloatArray,
    radii: FloatArray,
    others: FloatArray,
    other_radii: FloatArray,
    at: IntArray | None = None,
    pairs: IntArray | None = None,
) -> tuple[FloatArray, IntArray]:
    """Return the distance between two sets of capsules in every frame.

    Parameters
    ----------
    ends : ndarray, shape (n_frames, n, 2, 3)
        Both ends of each capsule.
    radii : ndarray, shape (n,)
        Radii of the capsules.
    others : ndarray, shape (n_other_frames, m, 2, 3)
        Both ends of the capsules of the other set.
    other_radii : ndarray, shape (m,)
        Radii of the other set.
    at : ndarray of int, shape (n_frames,), optional
        Frame of `others` for each frame. Default: the same index, or the only frame.
    pairs : ndarray of int, shape (n_pairs, 2), optional
        Pairs of capsules to compare. Default: all pairs.

    Returns
    -------
    distance : ndarray, shape (n_frames,)
        Distance of the nearest pair; negative by the penetration depth, infinite without
        pairs.
    which : ndarray of int, shape (n_frames, 2)
        The nearest pair; ties go to the first. -1 without pairs.

    Notes
    -----
    Closest points of two segments after Ericson, Real-Time Collision Detection (2005), 5.1.9.

    Examples
    --------
    >>> ends = np.array([[[[0.0, 0, 0], [1, 0, 0]]]])
    >>> distance, which = clearance(ends, np.array([0.25]), ends + [0, 2, 0], np.array([0.5]))
    >>> float(distance[0])
    1.25
    """
    if at is None:
        at = np.arange(len(ends)) if len(others) > 1 else np.zeros(len(ends), np.int64)
    if pairs is None:
        left, right = np.indices((len(radii), len(other_radii))).reshape(2, -1)
    else:
        left, right = np.ascontiguousarray(pairs.T, np.int64)
    arrays = (np.ascontiguousarray(array) for array in (ends, radii, others, other_radii))
    ends, radii, others, other_radii = arrays
    at = np.ascontiguousarray(at, np.int64)
    return _core.clearance(ends, radii, others, other_radii, at, (left, right))


def box_clearance(
    ends: FloatArray, radii: FloatArray, center: FloatArray, half: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return the distance of capsules from a box.

    Parameters
    ----------
    ends : ndarray, shape (n_frames, n, 2, 3)
        Both ends of each capsule.
    radii : ndarray, shape (n,)
        Radii of the capsules.
    center, half : ndarray, shape (3,)
        Centre of the box and half its lengths along its axes.
    rotation : ndarray, shape (4,)
        Orientation of the box.

    Returns
    -------
    ndarray, shape (n_frames, n)
        Distances, negative by the penetration depth; exact to 1e-7 of the capsule length.
    """
    return _core.box_clearance(
        np.ascontiguousarray(ends),
        np.ascontiguousarray(radii),
        center.tolist(),
        half.tolist(),
        rotation.tolist(),
    )
