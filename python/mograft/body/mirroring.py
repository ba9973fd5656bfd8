"""Motions as a mirror shows them: what the left did, the right does."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.validate import check_type
from mograft.body.anatomy import anatomy
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

__all__ = ["MirroredClips", "mirror", "partners"]

_ALIKE = 0.05
"""Skeleton heights by which a bone may differ from the mirror image of its partner."""

_OPPOSITE = {"left": "right", "right": "left", "": ""}


def partners(skeleton: Skeleton) -> IntArray:
    """Return the joint on the other side of the body for each joint.

    Parameters
    ----------
    skeleton : Skeleton
        Human or animal.

    Returns
    -------
    ndarray of int, shape (n_joints,)
        Joints in the middle are their own partners.

    Raises
    ------
    ValueError
        If a joint has none; names it.

    Notes
    -----
    Partners are the same part of the body on the other side, below partners, and the same in
    the order of these: the first finger of the one hand goes with the first of the other.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> skeleton = dance(strides=1).motion.skeleton
    >>> skeleton.names[3], skeleton.names[partners(skeleton)[3]]
    ('LeftFoot', 'RightFoot')
    """
    known = anatomy(skeleton)
    found = np.zeros(skeleton.n_joints, np.int64)

    def like(parent: int, part: str, side: str) -> list[int]:
        return [
            child
            for child in skeleton.children[parent]
            if (known.parts[child], known.sides[child]) == (part, side)
        ]

    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent < 0:
            continue
        part, side = known.parts[joint], known.sides[joint]
        here = like(parent, part, side)
        there = like(int(found[parent]), part, _OPPOSITE[side])
        if len(here) != len(there):
            raise ValueError(
                f"every joint must have a partner on the other side to be mirrored, "
                f"{skeleton.names[joint]} has none"
            )
        found[joint] = there[here.index(joint)]
    return found


def mirror(motion: Motion) -> Motion:
    """Return a motion as a mirror shows it.

    Parameters
    ----------
    motion : Motion
        Of a skeleton whose joints have partners; see `partners`.

    Returns
    -------
    Motion
        Of the same joint names and hierarchy; the bones are those of the other side. Its own
        mirror image is the motion.

    Raises
    ------
    ValueError
        If a joint has no partner, or a bone is not the mirror image of its partner's; names
        them.

    Notes
    -----
    The mirror stands upright. With bones that are mirror images in the rest pose, a joint's
    rotation (x, y, z, w) becomes (x, -y, -z, w) of its partner, x being the axis through the
    mirror. Else the joints' own axes are not: a constant turn of each joint, found from where
    its children are and from the motion's mean pose, puts them right.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> bool((mirror(mirror(motion)).rotations == motion.rotations).all())
    True
    """
    check_type("motion", motion, Motion)
    image = _Image.of(motion)
    skeleton, pair = motion.skeleton, image.pair
    quats, places = np.empty_like(motion.rotations), np.empty_like(motion.positions)
    quats[:, pair] = image.turns(motion.rotations)
    places[:, pair] = image.places(motion.positions)
    offsets = np.empty_like(skeleton.offsets)
    offsets[pair] = image.places(skeleton.offsets)
    sites = tuple(
        replace(site, parent=int(pair[site.parent]), offset=image.below(site))
        for site in skeleton.end_sites
    )
    own = Skeleton(
        skeleton.names,
        skeleton.parents,
        offsets,
        skeleton.channels,
        tuple(sorted(sites, key=lambda site: site.parent)),
    )
    return replace(
        motion,
        skeleton=own,
        rotations=quats if image.is_plain else rotations.continuous_signs(quats),
        positions=places,
        channel_values=None,
        path=None,
        repairs=(),
    )


@dataclass(frozen=True, eq=False)
class _Image:
    """How joints look in a mirror.

    `axis` goes through the mirror; `turn` (n_joints, 4) leads from the reflected axes of each
    joint to its partner's own, `above` (n_joints, 4) does of its parent.
    """

    pair: IntArray
    axis: int
    turn: FloatArray
    above: FloatArray
    is_plain: bool

    @classmethod
    def of(cls, motion: Motion) -> "_Image":
        skeleton = motion.skeleton
        pair = partners(skeleton)
        alike = _ALIKE * mass_model(skeleton).height
        level = [axis for axis in range(3) if axis != up_axis(motion)]
        off = {axis: _missed(skeleton.offsets, pair, axis) for axis in level}
        through = [axis for axis in level if (off[axis] <= alike).all()]
        # Where the axes of joints are their own, any upright mirror does, and the image of the
        # image needs the same one.
        axis = min(through, key=lambda own: float(off[own].sum()), default=level[0])
        is_plain = bool(through)
        turn = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
        if not is_plain:
            turn = _own_axes(motion, pair, axis, alike)
        above = turn[np.maximum(skeleton.parents, 0)]
        above[skeleton.parents < 0] = rotations.IDENTITY
        return cls(pair, axis, turn, above, is_plain)

    def turns(self, quats: FloatArray) -> FloatArray:
        """Return the partners' rotations; a rotation's axis turns the other way in a mirror."""
        seen = _turned_back(quats, self.axis)
        if self.is_plain:
            return seen
        back = rotations.inverse(self.above)
        return rotations.multiply(rotations.multiply(back, seen), self.turn)

    def places(self, places: FloatArray) -> FloatArray:
        """Return the partners' translations from their parents."""
        seen = _reflected(places, self.axis)
        return seen if self.is_plain else rotations.rotate(rotations.inverse(self.above), seen)

    def below(self, site: EndSite) -> FloatArray:
        """Return the offset of an end site of a joint's partner."""
        seen = _reflected(site.offset, self.axis)
        if self.is_plain:
            return seen
        return rotations.rotate(rotations.inverse(self.turn[site.parent]), seen)


def _reflected(vectors: FloatArray, axis: int) -> FloatArray:
    seen = vectors.copy()
    seen[..., axis] = -seen[..., axis]
    return seen


def _missed(offsets: FloatArray, pair: IntArray, axis: int) -> FloatArray:
    """Return by how much each bone but the root's is no mirror image of its partner's."""
    off: FloatArray = np.linalg.norm(offsets[pair] - _reflected(offsets, axis), axis=1)
    off[0] = 0.0
    return off


def _turned_back(quats: FloatArray, axis: int) -> FloatArray:
    seen = quats.copy()
    seen[..., :3] = -_reflected(quats[..., :3], axis)
    return seen


def _own_axes(motion: Motion, pair: IntArray, axis: int, alike: float) -> FloatArray:
    """Return the turns that lead from joints' reflected axes to their partners' own.

    Axes lie along bones and across them: of all quarter turns and those made of them that lead
    the partner's children to where the reflected ones are, the one that makes the mirror image
    of the motion's mean pose most like it.
    """
    skeleton = motion.skeleton
    seen = _reflected(skeleton.offsets, axis)
    turn = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
    hub = anatomy(skeleton).hips
    turned = motion.world_transforms()[0][:: max(motion.n_frames // 200, 1)]
    mean = _mean(rotations.multiply(rotations.inverse(turned[:, hub, None]), turned))
    image = rotations.inverse(_turned_back(mean, axis))
    for joint in range(hub, skeleton.n_joints):
        below = list(skeleton.children[joint])
        led = rotations.rotate(_QUARTERS[:, None], skeleton.offsets[pair[below]][None])
        missed = np.linalg.norm(led - seen[below], axis=2)
        fits = (missed <= alike).all(axis=1)
        if not fits.any():
            worst = below[int(missed[missed.max(axis=1).argmin()].argmax())]
            raise ValueError(
                "bones must be mirror images to be mirrored: those of "
                f"{skeleton.names[worst]} and {skeleton.names[pair[worst]]} are not"
            )
        like = _product(image[joint], turn[hub], mean[pair[joint]])
        # The hub's own has nothing to be compared with: the least turn that fits best.
        off = missed.sum(axis=1) if joint == hub else rotations.angle(_QUARTERS, like)
        turn[joint] = _QUARTERS[int(np.where(fits, off, np.inf).argmin())]
    return turn


def _quarters() -> FloatArray:
    """Return the 24 rotations of a cube, the identity first."""
    axes = rotations.from_euler(np.indices((4, 4, 4)).reshape(3, -1).T * (np.pi / 2), "ZYX")
    found: list[FloatArray] = []
    for quat in axes:
        if all(rotations.angle(quat, other) > 1.0 for other in found):
            found.append(quat)
    return np.array(found)


_QUARTERS = _quarters()


def _product(*turns: FloatArray) -> FloatArray:
    whole = turns[0]
    for turn in turns[1:]:
        whole = rotations.multiply(whole, turn)
    return whole


def _mean(quats: FloatArray) -> FloatArray:
    """Return the mean rotation of each joint: the largest eigenvector of Σ q qᵀ."""
    sums = np.einsum("fji,fjk->jik", quats, quats)
    mean: FloatArray = np.linalg.eigh(sums)[1][:, :, -1]
    return mean


@dataclass(frozen=True, eq=False)
class MirroredClips(Sequence[Motion]):
    """Clips, and behind them their mirror images, each made when it is asked for."""

    clips: Sequence[Motion]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return 2 * len(self.clips)

    @overload
    def __getitem__(self, index: int) -> Motion: ...
    @overload
    def __getitem__(self, index: slice) -> list[Motion]: ...
    def __getitem__(self, index: int | slice) -> Motion | list[Motion]:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        at = range(len(self))[index]
        if at < len(self.clips):
            return self.clips[at]
        return replace(mirror(self.clips[at - len(self.clips)]), name=self.names[at])
