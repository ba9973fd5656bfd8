"""Clips of other hierarchies as motions of a library's skeleton, matched by anatomy."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.body.anatomy import anatomy
from mograft.body.joint_matching import JointMatch, match_joints
from mograft.body.mass import mass_model, mean_world_positions, up_axis, up_sign
from mograft.errors import SkeletonMismatchError
from mograft.io.export_figure import UNITS, guess_unit
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, Skeleton

_NEXT_PART = {"thigh": "shank", "shank": "foot", "upper_arm": "forearm", "forearm": "hand"}
"""Parts whose bones are aligned in the rest pose, each with the part at the end of its bone."""

_MAX_AXIS_ANGLE = np.radians(25.0)
"""Largest angle between the rest poses' trunks up to which they count as parallel to the axes."""


@dataclass(frozen=True, eq=False)
class Conformer:
    """The conversion of motions of one skeleton to the hierarchy of another one.

    World rotations and the positions of the body are kept, except that unit and up axis are
    converted. Local rotations become relative to the rest pose of the hierarchy.
    """

    skeleton: Skeleton  # of the results: names and parents of the hierarchy, lengths of the clip
    match: JointMatch
    alignment: FloatArray  # result of `_align_rest_poses`, shape (n_joints, 4)
    scale: float  # units of the hierarchy per unit of the clip

    @classmethod
    def of(cls, skeleton: Skeleton, other: Skeleton, name: str = "a clip") -> "Conformer":
        """Return the conversion from `other` to the hierarchy of `skeleton`; see `match_joints`."""
        match = match_joints(skeleton, other, name)
        alignment = _align_rest_poses(skeleton, other, match)
        scale = UNITS[guess_unit(other)] / UNITS[guess_unit(skeleton)]
        growth = scale * mass_model(other).height / mass_model(skeleton).height
        offsets = _offsets(skeleton, other, match, alignment, (scale, growth))
        sites = tuple(replace(site, offset=growth * site.offset) for site in skeleton.end_sites)
        return cls(replace(skeleton, offsets=offsets, end_sites=sites), match, alignment, scale)

    def apply(self, motion: Motion, up: int, root: int) -> Motion:
        """Return a motion on the skeleton, in a world where the axis `up` points up.

        The translation of the body is assigned to the joint `root` if this is an ancestor of the
        hips and has no counterpart, otherwise to the hips.
        """
        skeleton, sources = self.skeleton, self.match.sources
        hips = anatomy(skeleton).hips
        carrier = root if sources[root] < 0 and root in skeleton.ancestors(hips) else None
        is_free = self._free_joints(motion)
        is_free[hips] &= carrier is None
        axis = up_axis(motion)
        sign = up_sign(motion.skeleton, mean_world_positions(motion)[:, axis])
        turn = rotations.shortest_arc(sign * np.eye(3)[axis], np.eye(3)[up])
        world_rotations, world_positions = motion.world_transforms()
        targets = self.scale * rotations.rotate(turn, world_positions)
        quats = np.tile(rotations.IDENTITY, (motion.n_frames, skeleton.n_joints, 1))
        positions = np.tile(skeleton.offsets, (motion.n_frames, 1, 1))
        turned, places = np.empty_like(quats), np.empty_like(positions)
        for joint, parent in enumerate(skeleton.parents.tolist()):
            source = int(sources[joint])
            above = rotations.IDENTITY if parent < 0 else turned[:, parent]
            origin = np.zeros(3) if parent < 0 else places[:, parent]
            if source >= 0:
                world = rotations.multiply(turn, world_rotations[:, source])
                world = rotations.multiply(world, self.alignment[joint])
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
        return Motion(
            _with_position_channels(skeleton, is_free),
            motion.frame_time,
            rotations.continuous_signs(quats),
            positions,
            name=motion.name,
            path=motion.path,
            repairs=motion.repairs,
        )

    def _free_joints(self, motion: Motion) -> BoolArray:
        """Return whether each joint takes its position from the clip, shape (n_joints,).

        These are the hips, their ancestors, and the joints whose position relative to the parent
        varies in the clip if the parents correspond, too. It is False for joints without a
        counterpart.
        """
        skeleton, sources = self.skeleton, self.match.sources
        hips = anatomy(skeleton).hips
        is_free = np.zeros(skeleton.n_joints, bool)
        is_free[[hips, *skeleton.ancestors(hips)]] = True
        for joint, parent in enumerate(skeleton.parents.tolist()):
            source = sources[joint]
            if parent >= 0 and source >= 0 and motion.is_translated[source]:
                is_free[joint] |= motion.skeleton.parents[source] == sources[parent]
        return is_free & (sources >= 0)


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
    own = motion.skeleton
    if own.has_same_hierarchy(skeleton):
        return motion
    try:
        conformer = _conformer(_Key(skeleton), _Key(own))
    except SkeletonMismatchError:
        # Raises the error with the name of the motion.
        conformer = Conformer.of(skeleton, own, name or motion.name or "the clip")
    return conformer.apply(motion, up, root)


@dataclass(frozen=True, eq=False)
class _Key:
    """A skeleton as the key of a cache: two keys are equal if the skeletons have equal content."""

    skeleton: Skeleton

    @property
    def _content(self) -> tuple[object, ...]:
        own = self.skeleton
        sites = [(s.parent, s.offset.tobytes(), s.before, s.name) for s in own.end_sites]
        return own.names, own.channels, own.parents.tobytes(), own.offsets.tobytes(), *sites

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)


@lru_cache(maxsize=16)
def _conformer(skeleton: _Key, other: _Key) -> Conformer:
    """Return the conversion between two skeletons; it is cached, because clips share skeletons."""
    return Conformer.of(skeleton.skeleton, other.skeleton)


def _align_rest_poses(skeleton: Skeleton, other: Skeleton, match: JointMatch) -> FloatArray:
    """Return for each joint the rotation from its rest pose to that of the other skeleton.

    The shape is (n_joints, 4), xyzw. The rotation turns the bone of a joint from its direction in
    the rest pose of `skeleton` to the direction of the matched bone in that of `other`.
    """
    own, theirs = skeleton.rest_positions(), other.rest_positions()
    known, sources = anatomy(skeleton), match.sources
    figure = _figure_rotation(skeleton, other, match)
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


def _figure_rotation(skeleton: Skeleton, other: Skeleton, match: JointMatch) -> FloatArray:
    """Return the rotation, xyzw, from the trunk in the rest pose to that of the other skeleton.

    The trunk is described by the direction between the thighs and that from the thighs to shoulders
    and head. A result within 25 degrees of a rotation that maps axes to axes is replaced by that
    rotation: the remaining difference is due to differently curved trunks. The result is the
    identity if the directions are unknown.
    """
    known, sources = anatomy(skeleton), match.sources
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
    match: JointMatch,
    alignment: FloatArray,
    scales: tuple[float, float],
) -> FloatArray:
    """Return the offsets of the skeleton with the bone lengths of the other one, (n_joints, 3).

    `scales` are the factors for lengths of `other`, and for offsets of joints of `skeleton` that
    have no counterpart.
    """
    scale, absent_scale = scales
    theirs, sources = other.rest_positions(), match.sources
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


def _with_position_channels(skeleton: Skeleton, is_free: BoolArray) -> Skeleton:
    """Return the skeleton with position channels for the joints where `is_free`."""
    channels = tuple(
        names if not free or CHANNELS[0] in names else (*CHANNELS[:3], *names)
        for names, free in zip(skeleton.channels, is_free.tolist(), strict=True)
    )
    return replace(skeleton, channels=channels)
