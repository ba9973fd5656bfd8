"""The figure that files show: slim bones, coloured by joint group, in metres with y up."""

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["PALETTE", "UNITS", "bones", "members", "scale_of", "to_y_up", "unit_of"]

UNITS = {"m": 1.0, "CMU": 0.056444, "inch": 0.0254, "cm": 0.01, "mm": 0.001}
"""Metres in a unit; CMU's is 1/0.45 inches."""

PALETTE = ("#3b6ea8", "#d9596b", "#2b8a57", "#b08a00", "#8a5cb8", "#2492ad", "#9c5a2e", "#6b7280")
"""Colours of joint groups, in their order; the pages use the same."""

_STATURE = 1.7


def unit_of(skeleton: Skeleton) -> str:
    """Return the unit that makes a skeleton's stature most like a grown human's.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.

    Returns
    -------
    str
        A key of `UNITS`. BVH files do not tell their unit, so this is a guess, and wrong for
        small children and for animals.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> unit_of(dance(strides=1).motion.skeleton)
    'cm'
    """
    height = mass_model(skeleton).height
    return min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / _STATURE)))


def scale_of(skeleton: Skeleton, scale: float | None) -> tuple[float, str]:
    """Return the metres in a unit, and the unit's name, ``"given"`` where it was not guessed.

    Raises
    ------
    ValueError
        If the scale is not above 0.
    """
    if scale is None:
        unit = unit_of(skeleton)
        return UNITS[unit], unit
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale must be above 0 metres in a unit, got {scale}")
    return float(scale), "given"


def bones(
    skeleton: Skeleton, scale: float, turn: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the bones at rest as triangles: an octahedron each, bound to its joint.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    scale : float
        Metres in its unit.
    turn : ndarray, shape (4,)
        What turns up to y, xyzw.

    Returns
    -------
    points, normals : ndarray, shape (24 * n_bones, 3)
        Three corners for each of the eight faces of each bone, in metres, y up.
    joint : ndarray of int, shape (24 * n_bones,)
        The joint that each corner goes with.
    """
    rest = scale * rotations.rotate(turn, skeleton.rest_positions())
    thick = 0.016 * scale * mass_model(skeleton).height
    ends = [(int(p), rest[j]) for j, p in enumerate(skeleton.parents) if p >= 0]
    for site in skeleton.end_sites:
        end = rest[site.parent] + scale * rotations.rotate(turn, site.offset)
        ends.append((site.parent, end))
    places: list[FloatArray] = []
    normals: list[FloatArray] = []
    owners: list[int] = []
    for joint, end in ends:
        shape = _octahedron(rest[joint], end, thick)
        if shape is not None:
            places.append(shape[0])
            normals.append(shape[1])
            owners.append(joint)
    if not places:
        # A skin needs a mesh: a lone joint is shown by a bone of its own.
        lone = _octahedron(rest[0], rest[0] + [0, max(thick, 0.01), 0], thick)
        assert lone is not None  # Its length is not 0.
        places, normals, owners = [lone[0]], [lone[1]], [0]
    return np.concatenate(places), np.concatenate(normals), np.repeat(owners, 24)


def _octahedron(
    start: FloatArray, end: FloatArray, thick: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return the corners and normals of a bone's eight faces, (24, 3) each; None of no length."""
    along = end - start
    length = float(np.linalg.norm(along))
    # float32 would lose the shape of anything smaller.
    if length < max(1e-5, 1e-4 * thick, 1e-5 * float(np.abs(start).max())):
        return None
    along = along / length
    aside = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    aside /= np.linalg.norm(aside)
    round_ = np.cross(along, aside)
    waist = start + 0.15 * length * along
    wide = min(thick, 0.25 * length)
    corners = [waist + wide * way for way in (aside, round_, -aside, -round_)]
    faces = []
    for at in range(4):
        here, there = corners[at], corners[(at + 1) % 4]
        faces += [(start, there, here), (end, here, there)]
    points = np.array(faces)
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return points.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def to_y_up(motion: Motion) -> FloatArray:
    """Return the rotation that turns what is up in a motion to y, xyzw."""
    axis = up_axis(motion)
    known = mass_model(motion.skeleton)
    feet = [foot.ankle for foot in known.feet] or [known.hips]
    high = known.head if known.head is not None else known.hips
    world = motion.world_positions()[..., axis]
    half = np.sqrt(0.5)
    turn = np.array([[0, 0, half, half], [0, 0, 0, 1.0], [-half, 0, 0, half]][axis])
    if world[:, high].mean() < world[:, feet].mean():
        turn = rotations.multiply(np.array([0, 0, 1.0, 0]), turn)
    return turn


def members(skeleton: Skeleton, groups: JointGroups | str | None) -> IntArray:
    """Return the index of each joint's group."""
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, skeleton)
    if groups is None:
        try:
            groups = JointGroups.preset("lower_torso_larm_rarm", skeleton)
        except ValueError:
            return np.zeros(skeleton.n_joints, np.int64)
    group = np.zeros(skeleton.n_joints, np.int64)
    for index, joints in enumerate(groups.resolve(skeleton).values()):
        group[joints] = index
    return group
