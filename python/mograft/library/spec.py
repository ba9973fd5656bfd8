"""The parameters that all clips of a library share; conversion of clips of other hierarchies."""

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.anatomy import anatomy
from mograft.body.joint_matching import match_joints
from mograft.body.mass import mass_model, mean_world_positions, up_axis, up_sign
from mograft.io.export_figure import UNITS, guess_unit
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, Skeleton

Match: TypeAlias = Literal["names", "anatomy"]
"""How the joints of clips correspond to those of the library.

"names": clips must have the joint names and the hierarchy of the library. "anatomy": joints of
other hierarchies are matched by body part.
"""

MAX_RATE_DIFFERENCE = 1e-3
"""Relative difference up to which two frame rates count as equal: files round frame times, for
instance 1/30 s to 0.033."""

_NEXT_PART = {"thigh": "shank", "shank": "foot", "upper_arm": "forearm", "forearm": "hand"}
"""Parts whose bones are aligned in the rest pose, each with the part at the end of its bone."""

_MAX_AXIS_ANGLE = np.radians(25.0)
"""Largest angle between the rest poses' trunks up to which they count as parallel to the axes."""


@dataclass(frozen=True, eq=False)
class LibrarySpec:
    """The parameters that all clips of a library share."""

    skeleton: Skeleton  # with the joint names and the hierarchy of every clip
    rate: float  # frames per second
    root: int  # the joint that carries the body through the world
    up: int  # the axis that points up: 0, 1 or 2
    match: Match = "names"  # how clips of other hierarchies fit
    rest: Skeleton | None = None  # the rest pose of files that store none, as for `read`

    def fit(self, motion: Motion, label: str) -> Motion:
        """Return a motion with the hierarchy of the library.

        Raises SkeletonMismatchError if the motion has another hierarchy and joints are matched by
        name, or if its joints cannot be matched by anatomy. The message calls the motion `label`.
        """
        if self.match == "anatomy":
            return conform(motion, self.skeleton, up=self.up, root=self.root, name=label)
        self.skeleton.check_same_hierarchy(motion.skeleton, label)
        return motion

    def convert(self, motion: Motion, label: str) -> Motion:
        """Return a motion with the hierarchy and the rate of the library; raise as `fit`."""
        fitted = self.fit(motion, label)
        return fitted if rates_match(fitted.rate, self.rate) else fitted.resample(self.rate)

    def is_equivalent(self, other: "LibrarySpec") -> bool:
        """Return whether ingest gives the same results with another specification."""
        parameters = (self.rate, self.root, self.up, self.match)
        is_same = parameters == (other.rate, other.root, other.up, other.match)
        return is_same and self.skeleton.has_same_hierarchy(other.skeleton)


def rates_match(rate: float, other: float) -> bool:
    """Return whether two frame rates differ by at most `MAX_RATE_DIFFERENCE` of `other`."""
    return abs(rate - other) <= MAX_RATE_DIFFERENCE * other


def describe_match(skeleton: Skeleton, other: Skeleton, name: str = "the clip") -> str:
    """Return a text that lists the joints without a counterpart; "" if the hierarchies are equal.

    Raises SkeletonMismatchError if the skeletons cannot be matched. The message calls the other
    skeleton `name`.
    """
    if skeleton.has_same_hierarchy(other):
        return ""
    return match_joints(skeleton, other, name).describe() or "every joint has a counterpart"


def conform(
    motion: Motion, skeleton: Skeleton, *, up: int, root: int, name: str | None = None
) -> Motion:
    """Return a motion with the names and the hierarchy of another skeleton, matched by anatomy.

    Parameters
    ----------
    motion : Motion
        The motion.
    skeleton : Skeleton
        The hierarchy and the rest pose of the result.
    up : int
        The axis of the result that points up, 0 to 2.
    root : int
        The joint of `skeleton` that carries the body.
    name : str, optional
        The name of the motion in errors. Default: `motion.name`.

    Returns
    -------
    Motion
        The motion itself if it has the hierarchy of `skeleton`.

    Raises
    ------
    SkeletonMismatchError
        If fewer than half of the joints of arms and legs have a counterpart.

    Notes
    -----
    Matched joints keep their world rotations, the hips their positions, and bones their lengths;
    unit and up axis become those of `skeleton`. Local rotations become relative to the rest pose of
    `skeleton`. This needs a rotation between the two rest poses for each joint: the rotation that
    aligns the trunks of the two figures and, for a bone of an arm or a leg, in addition the
    shortest arc that aligns the bone. Joints of `skeleton` without a counterpart keep their rest
    rotation. Joints of the clip without a counterpart are dropped; if they bend, the positions of
    the joints below them change.
    """
    other = motion.skeleton
    if other.has_same_hierarchy(skeleton):
        return motion
    sources = match_joints(skeleton, other, name or motion.name or "the clip").sources
    alignment = align_rest_poses(skeleton, other, sources)
    scale = UNITS[guess_unit(other)] / UNITS[guess_unit(skeleton)]
    growth = scale * mass_model(other).height / mass_model(skeleton).height
    offsets = _offsets(skeleton, other, sources, alignment, (scale, growth))
    sites = tuple(replace(site, offset=growth * site.offset) for site in skeleton.end_sites)
    skeleton = replace(skeleton, offsets=offsets, end_sites=sites)
    hips = anatomy(skeleton).hips
    # An ancestor of the hips without counterpart carries the body if it is the root.
    carrier = root if sources[root] < 0 and root in skeleton.ancestors(hips) else None
    is_free = _free_joints(motion, skeleton, sources)
    is_free[hips] &= carrier is None
    axis = up_axis(motion)
    sign = up_sign(other, mean_world_positions(motion)[:, axis])
    turn = rotations.shortest_arc(sign * np.eye(3)[axis], np.eye(3)[up])
    world_rotations, world_positions = motion.world_transforms()
    targets = scale * rotations.rotate(turn, world_positions)
    quats = np.tile(rotations.IDENTITY, (motion.n_frames, skeleton.n_joints, 1))
    positions = np.tile(skeleton.offsets, (motion.n_frames, 1, 1))
    turned, places = np.empty_like(quats), np.empty_like(positions)
    for joint, parent in enumerate(skeleton.parents.tolist()):
        source = int(sources[joint])
        above = rotations.IDENTITY if parent < 0 else turned[:, parent]
        origin = np.zeros(3) if parent < 0 else places[:, parent]
        if source >= 0:
            world = rotations.multiply(turn, world_rotations[:, source])
            world = rotations.multiply(world, alignment[joint])
            quats[:, joint] = rotations.multiply(rotations.inverse(above), world)
        if joint == carrier:
            between = [hips, *(a for a in skeleton.ancestors(hips) if a > joint)]
            arm = targets[:, sources[hips]] - skeleton.offsets[between].sum(axis=0)
            positions[:, joint] = arm - origin
        elif is_free[joint]:
            arm = targets[:, source] - origin
            positions[:, joint] = rotations.rotate(rotations.inverse(above), arm)
        turned[:, joint] = rotations.multiply(above, quats[:, joint])
        places[:, joint] = origin + rotations.rotate(above, positions[:, joint])
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    channels = tuple(
        names if not free or CHANNELS[0] in names else (*CHANNELS[:3], *names)
        for names, free in zip(skeleton.channels, is_free.tolist(), strict=True)
    )
    return Motion(
        replace(skeleton, channels=channels),
        motion.frame_time,
        rotations.continuous_signs(quats),
        positions,
        name=motion.name,
        path=motion.path,
        repairs=motion.repairs,
    )


def _free_joints(motion: Motion, skeleton: Skeleton, sources: IntArray) -> BoolArray:
    """Return whether each joint takes its position from the clip, shape (n_joints,).

    These are the hips, their ancestors, and the joints whose position relative to the parent
    varies in the clip if the parents correspond, too. It is False for joints without a counterpart.
    """
    hips = anatomy(skeleton).hips
    is_free = np.zeros(skeleton.n_joints, bool)
    is_free[[hips, *skeleton.ancestors(hips)]] = True
    for joint, parent in enumerate(skeleton.parents.tolist()):
        source = sources[joint]
        if parent >= 0 and source >= 0 and motion.is_translated[source]:
            is_free[joint] |= motion.skeleton.parents[source] == sources[parent]
    return is_free & (sources >= 0)


def align_rest_poses(skeleton: Skeleton, other: Skeleton, sources: IntArray) -> FloatArray:
    """Return for each joint the rotation from its rest pose to that of the other skeleton.

    The shape is (n_joints, 4), xyzw. The rotation turns the bone of a joint from its direction in
    the rest pose of `skeleton` to the direction of the matched bone in that of `other`.
    """
    own, theirs = skeleton.rest_positions(), other.rest_positions()
    known = anatomy(skeleton)
    figure = _figure_rotation(skeleton, other, sources)
    alignment = np.tile(figure, (skeleton.n_joints, 1))
    for joint, parent in enumerate(skeleton.parents.tolist()):
        part, side = known.parts[joint], known.sides[joint]
        if sources[joint] < 0 or part not in (*_NEXT_PART, "hand", "finger"):
            continue
        above = known.parts[parent] if parent >= 0 else ""
        if part in ("hand", "finger") or above == part:
            alignment[joint] = alignment[parent]  # hands, fingers and roll joints follow the limb
            continue
        ends = [j for j in known.joints(_NEXT_PART[part], side=side) if sources[j] >= 0]
        if ends:
            bone = rotations.rotate(figure, own[ends[0]] - own[joint])
            target = theirs[sources[ends[0]]] - theirs[sources[joint]]
            alignment[joint] = rotations.multiply(rotations.shortest_arc(bone, target), figure)
    return alignment


def _figure_rotation(skeleton: Skeleton, other: Skeleton, sources: IntArray) -> FloatArray:
    """Return the rotation, xyzw, from the trunk in the rest pose to that of the other skeleton.

    The trunk is described by the direction between the thighs and that from the thighs to shoulders
    and head. A result within 25 degrees of a rotation that maps axes to axes is replaced by that
    rotation: the remaining difference is due to differently curved trunks. The result is the
    identity if the directions are unknown.
    """
    known = anatomy(skeleton)
    thighs = [known.joints("thigh", side=side)[:1] for side in ("left", "right")]
    tops = [j for j in known.joints("clavicle", "upper_arm", "neck", "head") if sources[j] >= 0]
    joints = [*thighs[0], *thighs[1]]
    if len(joints) < 2 or not tops or (sources[joints] < 0).any():
        return rotations.IDENTITY.copy()
    axes = []
    for positions, index in (
        (skeleton.rest_positions(), np.arange(skeleton.n_joints)),
        (other.rest_positions(), sources),
    ):
        left, right = positions[index[joints]]
        up = positions[index[tops]].mean(axis=0) - (left + right) / 2
        side = left - right - up * ((left - right) @ up) / max(up @ up, 1e-30)
        rows = np.array([side, up, np.cross(side, up)])
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        if (lengths < 1e-12).any():
            return rotations.IDENTITY.copy()
        axes.append(rows / lengths)
    matrix = axes[1].T @ axes[0]
    nearest = np.zeros((3, 3))
    columns = np.abs(matrix).argmax(axis=1)
    nearest[np.arange(3), columns] = np.sign(matrix[np.arange(3), columns])
    exact = rotations.from_matrices(matrix)
    if len(set(columns.tolist())) == 3 and np.linalg.det(nearest) > 0:
        snapped = rotations.from_matrices(nearest)
        if rotations.angle(exact, snapped) <= _MAX_AXIS_ANGLE:
            return snapped
    return exact


def _offsets(
    skeleton: Skeleton,
    other: Skeleton,
    sources: IntArray,
    alignment: FloatArray,
    scales: tuple[float, float],
) -> FloatArray:
    """Return the offsets of the skeleton with the bone lengths of the other one, (n_joints, 3).

    `scales` are the factors for lengths of `other`, and for offsets of joints of `skeleton` that
    have no counterpart.
    """
    scale, absent_scale = scales
    theirs = other.rest_positions()
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    offsets = absent_scale * skeleton.offsets
    is_set = sources >= 0
    for joint in np.flatnonzero(sources >= 0).tolist():
        ancestors = skeleton.ancestors(joint)
        above = next((a for a in ancestors if sources[a] >= 0), None)
        if above is None:
            continue
        bone = scale * (theirs[sources[joint]] - theirs[sources[above]])
        arm = rotations.rotate(rotations.inverse(alignment[above]), bone)
        # Absent joints between divide the bone as in the skeleton.
        between = ancestors[: ancestors.index(above)]
        whole = lengths[[joint, *between]].sum()
        for absent in between:
            if not is_set[absent] and whole > 0:
                offsets[absent] = lengths[absent] / whole * arm
                is_set[absent] = True
        offsets[joint] = arm - offsets[between].sum(axis=0)
    return offsets
