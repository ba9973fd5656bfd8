"""Mirror images of motions: left and right are exchanged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.containers import LazySequence
from mograft._util.validate import check_type
from mograft.body.anatomy import anatomy
from mograft.body.joint_names import OPPOSITE_SIDE
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import NO_FILE, Motion
from mograft.motion.skeleton import Skeleton

_MAX_ASYMMETRY = 0.05
"""Maximum distance of a bone from the mirror image of its partner, in skeleton heights."""


def partners(skeleton: Skeleton) -> IntArray:
    """Return for each joint its partner on the other side of the body, shape (n_joints,).

    Partners have the same body part on opposite sides, parents that are partners, and the same rank
    among siblings of that part: the partner of the first finger of one hand is the first finger of
    the other. A joint in the middle is its own partner. Raises ValueError if a joint has no
    partner.
    """
    known, found = anatomy(skeleton), np.zeros(skeleton.n_joints, np.int64)
    kinds = list(zip(known.parts, known.sides, strict=True))
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent < 0:
            continue
        part, side = kinds[joint]
        siblings = [j for j in skeleton.children[parent] if kinds[j] == (part, side)]
        opposite = part, OPPOSITE_SIDE[side]
        counterparts = [j for j in skeleton.children[found[parent]] if kinds[j] == opposite]
        if len(siblings) != len(counterparts):
            expected = "every left or right joint must have a partner on the other side"
            got = f"{skeleton.names[joint]} or one of its siblings has none"
            raise ValueError(f"to mirror a skeleton, {expected}; {got}")
        found[joint] = counterparts[siblings.index(joint)]
    return found


def mirror(motion: Motion) -> Motion:
    """Return the mirror image of a motion.

    Parameters
    ----------
    motion : Motion
        Motion of a skeleton in which every joint has a partner; see `partners`.

    Returns
    -------
    Motion
        Motion with the same joint names and hierarchy. Each bone is the mirror image of its
        partner. Mirroring twice returns the original motion.

    Raises
    ------
    ValueError
        If a joint has no partner or a bone is not the mirror image of its partner's bone. The
        message names the joints.

    Notes
    -----
    The mirror plane is vertical. If the rest pose is symmetric, the rotation (x, y, z, w) of a
    joint becomes the rotation (x, -y, -z, w) of its partner, where x is the axis normal to the
    mirror plane. Otherwise the local axes of partners also differ by a constant rotation, which is
    found from the offsets of the children and the mean pose of the motion.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> bool((mirror(mirror(motion)).rotations == motion.rotations).all())
    True
    """
    check_type("motion", motion, Motion)
    image = _Reflection.of(motion)
    skeleton, pair = motion.skeleton, image.pair
    quats, positions = np.empty_like(motion.rotations), np.empty_like(motion.positions)
    quats[:, pair] = image.mirror_rotations(motion.rotations)
    positions[:, pair] = image.mirror_vectors(motion.positions, image.parent_frame)
    offsets = np.empty_like(skeleton.offsets)
    offsets[pair] = image.mirror_vectors(skeleton.offsets, image.parent_frame)
    sites = []
    for site in skeleton.end_sites:
        offset = image.mirror_vectors(site.offset, image.frame[site.parent])
        sites.append(replace(site, parent=int(pair[site.parent]), offset=offset))
    sites.sort(key=lambda site: site.parent)
    mirrored = replace(skeleton, offsets=offsets, end_sites=tuple(sites))
    quats = quats if image.is_symmetric else rotations.continuous_signs(quats)
    return replace(
        motion,
        skeleton=mirrored,
        rotations=quats,
        positions=positions,
        channel_values=None,
        **NO_FILE,
    )


@dataclass(frozen=True, eq=False)
class _Reflection:
    """Reflection of the joints of a skeleton in a vertical plane."""

    pair: IntArray  # partner of each joint
    axis: int  # normal to the plane
    frame: FloatArray  # rotation from the reflected local axes to the partner's, (n_joints, 4)
    parent_frame: FloatArray  # `frame` of the parent, (n_joints, 4)
    is_symmetric: bool  # whether the rest pose is symmetric; then `frame` is the identity

    @classmethod
    def of(cls, motion: Motion) -> "_Reflection":
        skeleton = motion.skeleton
        pair = partners(skeleton)
        tolerance = _MAX_ASYMMETRY * mass_model(skeleton).height
        level = [axis for axis in range(3) if axis != up_axis(motion)]
        asymmetry = {axis: _asymmetry(skeleton.offsets, pair, axis) for axis in level}
        symmetric = [axis for axis in level if (asymmetry[axis] <= tolerance).all()]
        # If local axes are not mirrored, any vertical plane is valid, but mirroring twice must use
        # the same one.
        axis = min(symmetric, key=lambda a: float(asymmetry[a].sum()), default=level[0])
        is_symmetric = bool(symmetric)
        frame = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
        if not is_symmetric:
            frame = _partner_frames(motion, pair, axis, tolerance)
        parent_frame = frame[np.maximum(skeleton.parents, 0)]
        parent_frame[skeleton.parents < 0] = rotations.IDENTITY
        return cls(pair, axis, frame, parent_frame, is_symmetric)

    def mirror_rotations(self, quats: FloatArray) -> FloatArray:
        """Return the mirror images of local rotations: entry i is for the partner of joint i."""
        image = _reflect_rotations(quats, self.axis)
        if self.is_symmetric:
            return image
        from_parent = rotations.inverse(self.parent_frame)
        return rotations.multiply(rotations.multiply(from_parent, image), self.frame)

    def mirror_vectors(self, vectors: FloatArray, frame: FloatArray) -> FloatArray:
        """Return the mirror images of vectors, in the local axes of the partner joints.

        `frame` is the rotation to these axes: `parent_frame` for offsets and positions of joints,
        the joint's `frame` for an end site.
        """
        image = _reflect(vectors, self.axis)
        if self.is_symmetric:
            return image
        return rotations.rotate(rotations.inverse(frame), image)


def _reflect(vectors: FloatArray, axis: int) -> FloatArray:
    image = vectors.copy()
    image[..., axis] = -image[..., axis]
    return image


def _asymmetry(offsets: FloatArray, pair: IntArray, axis: int) -> FloatArray:
    """Return the distance of each joint's mirrored offset from its partner's; 0 at the root.

    `pair` holds the partner of each joint, `axis` is the normal of the mirror plane.
    """
    distance: FloatArray = np.linalg.norm(offsets[pair] - _reflect(offsets, axis), axis=1)
    distance[0] = 0.0
    return distance


def _reflect_rotations(quats: FloatArray, axis: int) -> FloatArray:
    image = quats.copy()
    image[..., :3] = -_reflect(quats[..., :3], axis)
    return image


def _partner_frames(motion: Motion, pair: IntArray, axis: int, tolerance: float) -> FloatArray:
    """Return for each joint the rotation from its reflected local axes to its partner's axes.

    Local axes are parallel or perpendicular to bones, so the candidates are the 24 rotations of a
    cube. A candidate must map the offsets of the partner's children to the reflected offsets within
    `tolerance`. Of these candidates, the function chooses the one for which the mirror image of the
    mean pose is closest to the mean pose of the motion.
    """
    skeleton = motion.skeleton
    reflected = _reflect(skeleton.offsets, axis)
    frame = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
    turns = _cube_rotations()
    hub = anatomy(skeleton).hips
    world_rotations = motion.world_transforms()[0][:: max(motion.n_frames // 200, 1)]
    to_hub = rotations.inverse(world_rotations[:, hub, None])
    relative = rotations.multiply(to_hub, world_rotations)
    mean = rotations.mean_of_products(np.einsum("fji,fjk->jik", relative, relative))
    image = rotations.inverse(_reflect_rotations(mean, axis))
    for joint in range(hub, skeleton.n_joints):
        children = list(skeleton.children[joint])
        rotated = rotations.rotate(turns[:, None], skeleton.offsets[pair[children]][None])
        distance = np.linalg.norm(rotated - reflected[children], axis=2)
        fits = (distance <= tolerance).all(axis=1)
        if not fits.any():
            worst = children[int(distance[distance.max(axis=1).argmin()].argmax())]
            name, partner = skeleton.names[worst], skeleton.names[pair[worst]]
            image_of = f"the mirror image of {partner}'s"
            wanted = "in the mirror plane" if name == partner else image_of
            text = f"bones must be symmetric to be mirrored, but the offset of {name} is not"
            raise ValueError(f"{text} {wanted}")
        to_partner = rotations.multiply(image[joint], frame[hub])
        expected = rotations.multiply(to_partner, mean[pair[joint]])
        # The hips have no reference pose: the first candidate of smallest distance is taken.
        cost = distance.sum(axis=1) if joint == hub else rotations.angle(turns, expected)
        frame[joint] = turns[int(np.where(fits, cost, np.inf).argmin())]
    return frame


@cache  # takes 10 ms, and few skeletons need it
def _cube_rotations() -> FloatArray:
    """Return the 24 rotations of a cube, the identity first."""
    axes = rotations.from_euler(np.indices((4, 4, 4)).reshape(3, -1).T * (np.pi / 2), "ZYX")
    found: list[FloatArray] = []
    for quat in axes:
        found += [quat] if all(rotations.angle(quat, other) > 1.0 for other in found) else []
    return np.array(found)


@dataclass(frozen=True, eq=False)
class MirroredClips(LazySequence[Motion]):
    """Clips followed by their mirror images, which are computed on access."""

    clips: Sequence[Motion]
    names: tuple[str, ...]  # of clips and mirror images

    def __len__(self) -> int:
        return 2 * len(self.clips)

    def item(self, index: int) -> Motion:
        """Return a clip or a mirror image."""
        if index < len(self.clips):
            return self.clips[index]
        return replace(mirror(self.clips[index - len(self.clips)]), name=self.names[index])
