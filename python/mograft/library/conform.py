"""Clips of other hierarchies as motions of a library's skeleton, matched by anatomy."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.body.anatomy import anatomy
from mograft.body.joint_matching import JointMatch, match_joints
from mograft.body.mass import mass_model, mean_world_positions, up_axis
from mograft.errors import SkeletonMismatchError
from mograft.io.units import UNITS, guess_unit
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import CHANNELS, Skeleton

_NEXT_PART = {
    "thigh": "shank",
    "shank": "foot",
    "upper_arm": "forearm",
    "forearm": "hand",
}
"""Parts whose bones are aligned in the rest pose, each with the part at the end of its bone."""

_MAX_AXIS_ANGLE = np.radians(25.0)
"""Largest angle between the rest poses' trunks up to which they count as parallel to the axes."""


@dataclass(frozen=True, eq=False)
class Conformer:
    """The conversion of motions of one skeleton to the hierarchy of another one.

    World rotations and the positions of the body stay as they are, apart from unit and up axis;
    local rotations become relative to the rest pose of the hierarchy.
    """

    skeleton: Skeleton  # of the results: names and parents of the hierarchy, lengths of the clip
    match: JointMatch
    alignment: FloatArray  # rotation from rest axes to those of the clip, (n_joints, 4)
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
        """Return a motion on the skeleton, with the axis `up` upwards.

        If the joint `root` is an ancestor of the hips without a counterpart, it carries the body.
        """
        skeleton, sources = self.skeleton, self.match.sources
        hips = anatomy(skeleton).hips
        carrier = root if sources[root] < 0 and root in skeleton.ancestors(hips) else None
        is_free = self._free_joints(motion)
        is_free[hips] &= carrier is None
        turn = _turn_up(motion, up)
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

        These are the matched hips with their ancestors, and joints that move relative to a parent
        that has a counterpart.
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


def conform(motion: Motion, skeleton: Skeleton, *, up: int, root: int) -> Motion:
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
    `skeleton`: for each bone of arms and legs, the shortest arc between its directions in the two
    rest poses, and for the other joints the rotation between the two figures. Joints without a
    counterpart stay at rest. Joints of the clip without one are dropped; if they bend, the joints
    below them are displaced.
    """
    own = motion.skeleton
    if own.names == skeleton.names and np.array_equal(own.parents, skeleton.parents):
        return motion
    try:
        conformer = _conformer(_Key(skeleton), _Key(own))
    except SkeletonMismatchError:
        conformer = Conformer.of(skeleton, own, motion.name or "the clip")  # names the clip
    return conformer.apply(motion, up, root)


@dataclass(frozen=True, eq=False)
class _Key:
    """A skeleton with the equality of its content, for caches."""

    skeleton: Skeleton

    @property
    def _content(self) -> tuple[object, ...]:
        own = self.skeleton
        return own.names, own.channels, own.parents.tobytes(), own.offsets.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)


@lru_cache(maxsize=16)
def _conformer(skeleton: _Key, other: _Key) -> Conformer:
    """Return the conversion between two skeletons, which the clips of a source share."""
    return Conformer.of(skeleton.skeleton, other.skeleton)


def _align_rest_poses(skeleton: Skeleton, other: Skeleton, match: JointMatch) -> FloatArray:
    """Return the rotation of each joint from rest axes to those of the other skeleton.

    The shape is (n_joints, 4). In the other's world, it turns the bone of a joint from its rest
    direction to that of the counterpart.
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
            alignment[joint] = alignment[parent]  # as its limb, of which it may be a roll joint
            continue
        ends = [j for j in known.joints(_NEXT_PART[part], side=side) if sources[j] >= 0]
        if ends:
            bone = rotations.rotate(figure, own[ends[0]] - own[joint])
            target = theirs[sources[ends[0]]] - theirs[sources[joint]]
            alignment[joint] = rotations.multiply(rotations.shortest_arc(bone, target), figure)
    return alignment


def _figure_rotation(skeleton: Skeleton, other: Skeleton, match: JointMatch) -> FloatArray:
    """Return the rotation from the rest figure of a skeleton to that of the other one, xyzw.

    Rotations near a permutation of the axes become that permutation: trunks differ in curvature.
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
    growth: tuple[float, float],
) -> FloatArray:
    """Return the offsets of the clip's bones in the rest axes of the skeleton, (n_joints, 3).

    `growth` has the factors of the other's lengths and of the lengths of absent joints.
    """
    scale, absent_scale = growth
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


def _turn_up(motion: Motion, up: int) -> FloatArray:
    """Return the rotation from the up direction of a motion to the axis `up`, xyzw."""
    model, axis = mass_model(motion.skeleton), up_axis(motion)
    means = mean_world_positions(motion)[:, axis]
    low = [foot.ankle for foot in model.feet] or [model.hips]
    high = model.head if model.head is not None else model.hips
    sign = -1.0 if means[high] < means[low].mean() else 1.0
    return rotations.shortest_arc(sign * np.eye(3)[axis], np.eye(3)[up])


def _with_position_channels(skeleton: Skeleton, is_free: BoolArray) -> Skeleton:
    """Return the skeleton with position channels for the joints that may move."""
    channels = tuple(
        names if not free or CHANNELS[0] in names else (*CHANNELS[:3], *names)
        for names, free in zip(skeleton.channels, is_free.tolist(), strict=True)
    )
    return replace(skeleton, channels=channels)
