"""The mesh of the bones, computed one bone at a time."""

import numpy as np

from mograft.body.anatomy import root_carriers
from mograft.body.mass import mass_model


def bone_mesh(skeleton, transform):
    """Return points and normals, (24 * n_bones, 3) each, and the joint of each corner."""
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
    length = max(thickness, 0.01, 1e-5 * np.abs(rest[0]).max())
    bones = bones or [(0, rest[0] + [0, length, 0])]
    octahedra = [_octahedron(rest[joint], end, thickness) for joint, end in bones]
    points, normals = map(np.concatenate, zip(*octahedra, strict=True))
    return points, normals, np.repeat([joint for joint, _ in bones], 24)


def _is_visible(start, end, thickness):
    """Return whether a bone is long enough that its octahedron does not degenerate in float32."""
    min_length = max(1e-5, 1e-4 * thickness, 1e-5 * float(np.abs(start).max()))
    return float(np.linalg.norm(end - start)) >= min_length


def _octahedron(start, end, thickness):
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
