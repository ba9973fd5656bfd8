"""The mesh in exported files, one slim octahedron per bone, and the colours of joint groups."""

from typing import NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.anatomy import root_carriers
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model
from mograft.io.units import ExportTransform
from mograft.motion.skeleton import Skeleton

PALETTE = ("#3b6ea8", "#d9596b", "#2b8a57", "#b08a00", "#8a5cb8", "#2492ad", "#9c5a2e", "#6b7280")
"""Colours of the joint groups, in order; if there are more groups, the colours repeat."""

_CORNERS_PER_BONE = 24


class BoneMesh(NamedTuple):
    """Triangles of the bones in the rest pose: 24 corners per bone, 3 for each of its 8 faces."""

    points: FloatArray  # corners in metres, y up, shape (24 * n_bones, 3)
    normals: FloatArray  # their normals, same shape
    joints: IntArray  # the joint that each corner is bound to, shape (24 * n_bones,)
    colours: FloatArray  # of the joints' groups, linear RGB from 0 to 1, shape (24 * n_bones, 3)


def bone_mesh(
    skeleton: Skeleton, transform: ExportTransform, groups: JointGroups | str | None = None
) -> BoneMesh:
    """Return the mesh of the bones in the rest pose, in metres with y up.

    A bone leads from a joint to a child or an end site. Ancestors of the hips have no bones. If no
    bone is long enough to be visible, one bone is added at the root, because a skin needs a mesh.
    `groups` may be the name of a preset. None means legs, torso and two arms as groups, or a single
    group if the skeleton lacks one of these parts.
    """
    group_indices = _group_indices(skeleton, groups)
    rest = transform.points(skeleton.rest_positions())
    thickness = 0.016 * transform.scale * mass_model(skeleton).height
    sites = skeleton.end_sites
    joints = np.concatenate([skeleton.parents, np.array([s.parent for s in sites], np.int64)])
    offsets = np.array([site.offset for site in sites]).reshape(-1, 3)
    ends = np.concatenate([rest, rest[joints[len(rest) :]] + transform.points(offsets)])
    chosen = (joints >= 0) & ~np.isin(joints, root_carriers(skeleton))
    chosen &= _are_visible(rest[joints], ends, thickness)
    joints, ends = joints[chosen], ends[chosen]
    if not len(joints):
        joints = np.zeros(1, np.int64)
        ends = rest[:1] + np.array([0.0, max(thickness, 0.01, 1e-5 * np.abs(rest[0]).max()), 0.0])
    points, normals = _octahedra(rest[joints], ends, thickness)
    joints = np.repeat(joints, _CORNERS_PER_BONE)
    srgb = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in PALETTE])
    return BoneMesh(points, normals, joints, srgb[group_indices[joints] % len(PALETTE)] ** 2.2)


def _are_visible(starts: FloatArray, ends: FloatArray, thickness: float) -> BoolArray:
    """Return which bones are long enough that their octahedra do not degenerate in float32."""
    min_lengths = np.maximum(max(1e-5, 1e-4 * thickness), 1e-5 * np.abs(starts).max(axis=1))
    return np.asarray(_lengths(ends - starts) >= min_lengths)


def _octahedra(
    starts: FloatArray, ends: FloatArray, thickness: float
) -> tuple[FloatArray, FloatArray]:
    """Return the corners and normals, (24 * n_bones, 3) each, of the octahedra of bones."""
    along = ends - starts
    lengths = _lengths(along)[:, None]
    along = along / lengths
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    side /= _lengths(side)[:, None]
    other_side = np.cross(along, side)
    waist = starts + 0.15 * lengths * along
    half_widths = np.minimum(thickness, 0.25 * lengths)
    ring = [waist + half_widths * axis for axis in (side, other_side, -side, -other_side)]
    faces = []
    for corner, next_corner in zip(ring, [*ring[1:], ring[0]], strict=True):
        faces += [(starts, next_corner, corner), (ends, corner, next_corner)]
    points = np.moveaxis(np.array(faces), 2, 0)  # bones, faces, corners, coordinates
    normals = np.cross(points[:, :, 1] - points[:, :, 0], points[:, :, 2] - points[:, :, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return points.reshape(-1, 3), np.repeat(normals.reshape(-1, 3), 3, axis=0)


def _lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors, shape (n,), rounded as `np.linalg.norm` of each one."""
    return np.sqrt(np.matmul(vectors[:, None], vectors[:, :, None])[:, 0, 0])


def _group_indices(skeleton: Skeleton, groups: JointGroups | str | None) -> IntArray:
    """Return for each joint the index of its group, shape (n_joints,)."""
    indices = np.zeros(skeleton.n_joints, np.int64)
    try:
        if groups is None or isinstance(groups, str):
            groups = JointGroups.preset(groups or "lower_torso_larm_rarm", skeleton)
    except ValueError:
        if groups is not None:
            raise
        return indices
    for index, joints in enumerate(groups.resolve(skeleton).values()):
        indices[joints] = index
    return indices
