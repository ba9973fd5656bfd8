"""The mesh in exported files: one slim octahedron per bone."""

from typing import NamedTuple

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import root_carriers
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model
from mograft.io.units import ExportTransform
from mograft.motion.skeleton import Skeleton

_CORNERS_PER_BONE = 24


class BoneMesh(NamedTuple):
    """Triangles of the bones in the rest pose: 24 corners per bone, 3 for each of its 8 faces."""

    points: FloatArray  # corners in metres, y up, shape (24 * n_bones, 3)
    normals: FloatArray  # their normals, same shape
    joints: IntArray  # the joint that each corner is bound to, shape (24 * n_bones,)


def bone_mesh(skeleton: Skeleton, transform: ExportTransform) -> BoneMesh:
    """Return the mesh of the bones in the rest pose, in metres with y up.

    No bone starts at a joint above the hips. If no bone is long enough to be visible, one bone is
    added at the root, because a skin needs a mesh.
    """
    carriers = root_carriers(skeleton)
    rest = transform.points(skeleton.rest_positions())
    thickness = 0.016 * transform.scale * mass_model(skeleton).height
    bones = [(int(p), rest[j]) for j, p in enumerate(skeleton.parents)]
    bones += [(s.parent, rest[s.parent] + transform.points(s.offset)) for s in skeleton.end_sites]
    bones = [
        (joint, end)
        for joint, end in bones
        if joint >= 0 and joint not in carriers and _is_visible(rest[joint], end, thickness)
    ]
    bones = bones or [(0, rest[0] + [0, max(thickness, 0.01), 0])]
    octahedra = [_octahedron(rest[joint], end, thickness) for joint, end in bones]
    return BoneMesh(
        np.concatenate([points for points, _ in octahedra]),
        np.concatenate([normals for _, normals in octahedra]),
        np.repeat([joint for joint, _ in bones], _CORNERS_PER_BONE),
    )


def _is_visible(start: FloatArray, end: FloatArray, thickness: float) -> bool:
    """Return whether a bone is long enough that its octahedron does not degenerate in float32."""
    min_length = max(1e-5, 1e-4 * thickness, 1e-5 * float(np.abs(start).max()))
    return float(np.linalg.norm(end - start)) >= min_length


def _octahedron(
    start: FloatArray, end: FloatArray, thickness: float
) -> tuple[FloatArray, FloatArray]:
    """Return the corners and normals, (24, 3) each, of the octahedron of a bone."""
    along = end - start
    length = float(np.linalg.norm(along))
    along = along / length
    side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    side /= np.linalg.norm(side)
    other_side = np.cross(along, side)
    waist = start + 0.15 * length * along
    half_width = min(thickness, 0.25 * length)
    ring = [waist + half_width * axis for axis in (side, other_side, -side, -other_side)]
    faces = []
    for corner, next_corner in zip(ring, [*ring[1:], ring[0]], strict=True):
        faces += [(start, next_corner, corner), (end, corner, next_corner)]
    points = np.array(faces)
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return points.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def joint_group_indices(skeleton: Skeleton, groups: JointGroups | str | None) -> IntArray:
    """Return for each joint the index of its group, shape (n_joints,).

    `groups` may be the name of a preset. None means legs, torso and two arms as groups, or a single
    group if the skeleton lacks one of these parts.
    """
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, skeleton)
    if groups is None:
        try:
            groups = JointGroups.preset("lower_torso_larm_rarm", skeleton)
        except ValueError:
            return np.zeros(skeleton.n_joints, np.int64)
    indices = np.zeros(skeleton.n_joints, np.int64)
    for index, joints in enumerate(groups.resolve(skeleton).values()):
        indices[joints] = index
    return indices
