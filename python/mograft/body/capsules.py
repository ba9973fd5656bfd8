"""The body as capsules, and how far it is from itself and from other things."""

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
"""Radius of each part's capsules, in skeleton heights."""


@dataclass(frozen=True, eq=False)
class Capsules:
    """A skeleton's flesh: all points within a radius of its bones. Made by `capsules`.

    Attributes
    ----------
    joints : ndarray of int, shape (n_capsules,)
        The joint that each hangs on.
    parts : tuple of str
        What each is, as in `mograft.body.anatomy`.
    sides : tuple of str
        ``"left"``, ``"right"`` or ``""``.
    bones : ndarray, shape (n_capsules, 3)
        From the joint to the other end, in the joint's frame and the file's unit.
    radii : ndarray, shape (n_capsules,)
        In the file's unit.
    """

    joints: IntArray
    parts: tuple[str, ...]
    sides: tuple[str, ...]
    bones: FloatArray
    radii: FloatArray

    def __len__(self) -> int:
        return len(self.joints)

    @cached_property
    def meetings(self) -> IntArray:
        """Which meet where a body touches itself, shape (n_pairs, 2).

        Each hand and forearm with the trunk, the head, the thighs and those of the other side.
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

    def ends(self, turned: FloatArray, placed: FloatArray) -> FloatArray:
        """Return where the capsules are.

        Parameters
        ----------
        turned : ndarray, shape (n_frames, n_joints, 4)
            World rotations of the joints.
        placed : ndarray, shape (n_frames, n_joints, 3)
            World positions of the joints.

        Returns
        -------
        ndarray, shape (n_frames, n_capsules, 2, 3)
            Both ends of each, in the file's unit.
        """
        return _core.capsule_ends(
            np.ascontiguousarray(turned),
            np.ascontiguousarray(placed),
            self.joints,
            np.ascontiguousarray(self.bones),
        )


def capsules(skeleton: Skeleton, radii: Mapping[str, float] | None = None) -> Capsules:
    """Return a skeleton's bones as capsules.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    radii : mapping of str to float, optional
        Radii in skeleton heights by part, instead of those of `RADII`; 0 leaves a part out.

    Returns
    -------
    Capsules
        One for each bone; a bone without length is a sphere. Fingers are within the hand's,
        which reaches to the end of the longest; the face and markers have none.

    Raises
    ------
    ValueError
        If a part is not known or a radius is negative.

    Examples
    --------
    >>> names, offsets = ["Hips", "LeftUpLeg", "LeftLeg"], [[0, 0, 0], [9, 0, 0], [0, -40, 0]]
    >>> skeleton = Skeleton(names, [-1, 0, 1], offsets)
    >>> capsules(skeleton, {"pelvis": 0}).parts
    ('thigh', 'shank')
    """
    given = {} if radii is None else dict(radii)
    for part, radius in given.items():
        if part not in RADII:
            raise ValueError(f"radii must be of {', '.join(RADII)}; got {part!r}")
        if not radius >= 0:
            raise ValueError(f"the radius of {part!r} must not be negative, got {radius}")
    wanted = {**RADII, **given}
    known, found = anatomy(skeleton), mass_model(skeleton)
    rest = skeleton.rest_positions()
    fleshy = [
        joint
        for joint, part in enumerate(known.parts)
        if wanted.get(part, 0.0) > 0 and joint not in known.details
    ]
    bones = found.bone.copy()
    for joint in known.joints("hand"):
        fingers = [f for f in known.joints("finger") if _hangs_on(skeleton, f, joint)]
        reach = [rest[f] + found.bone[f] - rest[joint] for f in fingers]
        if reach:
            bones[joint] = max(reach, key=lambda way: float(np.linalg.norm(way)))
    return Capsules(
        np.array(fleshy, np.int64),
        tuple(known.parts[joint] for joint in fleshy),
        tuple(known.sides[joint] for joint in fleshy),
        bones[fleshy],
        np.array([wanted[known.parts[joint]] for joint in fleshy]) * found.height,
    )


def clearance(
    ends: FloatArray,
    radii: FloatArray,
    others: FloatArray,
    other_radii: FloatArray,
    at: IntArray | None = None,
    pairs: IntArray | None = None,
) -> tuple[FloatArray, IntArray]:
    """Return how far two sets of capsules are apart, frame by frame.

    Parameters
    ----------
    ends : ndarray, shape (n_frames, n, 2, 3)
        Both ends of each capsule.
    radii : ndarray, shape (n,)
        Their radii.
    others : ndarray, shape (n_other_frames, m, 2, 3)
        Both ends of what they are compared with.
    other_radii : ndarray, shape (m,)
        Their radii.
    at : ndarray of int, shape (n_frames,), optional
        Which frame of the others each frame meets. Default: its own number, or the only one.
    pairs : ndarray of int, shape (n_pairs, 2), optional
        Which capsules are compared. Default: all with all.

    Returns
    -------
    distance : ndarray, shape (n_frames,)
        Between the nearest pair; negative by how deep they are in each other, infinite where
        there is no pair.
    which : ndarray of int, shape (n_frames, 2)
        That pair; of equally near ones the first. -1 where there is none.

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
    return _core.clearance(
        np.ascontiguousarray(ends),
        np.ascontiguousarray(radii),
        np.ascontiguousarray(others),
        np.ascontiguousarray(other_radii),
        np.ascontiguousarray(at, np.int64),
        (left, right),
    )


def box_clearance(
    ends: FloatArray, radii: FloatArray, center: FloatArray, half: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return how far capsules are from a box.

    Parameters
    ----------
    ends : ndarray, shape (n_frames, n, 2, 3)
        Both ends of each capsule.
    radii : ndarray, shape (n,)
        Their radii.
    center, half : ndarray, shape (3,)
        The box's middle and its half lengths along its own axes.
    rotation : ndarray, shape (4,)
        How it is turned.

    Returns
    -------
    ndarray, shape (n_frames, n)
        Negative by how deep they are in it. Exact to 1e-7 of a capsule's length.
    """
    return _core.box_clearance(
        np.ascontiguousarray(ends),
        np.ascontiguousarray(radii),
        center.tolist(),
        half.tolist(),
        rotation.tolist(),
    )


def _hangs_on(skeleton: Skeleton, joint: int, ancestor: int) -> bool:
    while joint > ancestor:
        joint = int(skeleton.parents[joint])
    return joint == ancestor
