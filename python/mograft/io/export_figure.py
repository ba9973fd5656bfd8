"""Units, axes and the mesh of exported figures: metres, y up, in single precision."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import root_carriers
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model, mean_world_positions, up_axis, up_sign
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

UNITS = {"m": 1.0, "CMU": 0.056444, "inch": 0.0254, "cm": 0.01, "mm": 0.001}
"""Metres per unit; the unit of the CMU recordings is 1/0.45 inches."""

_HUMAN_HEIGHT = 1.7  # metres
_MAX_SINGLE = 1e38  # sums of three such values are finite in single precision

_HALF = np.sqrt(0.5)
_FROM_AXES = np.array([[0, 0, _HALF, _HALF], [0, 0, 0, 1.0], [-_HALF, 0, 0, _HALF]])
ROTATIONS_TO_Y_UP = np.concatenate(
    [_FROM_AXES, rotations.multiply(np.array([0, 0, 1.0, 0]), _FROM_AXES)]
)
"""Rotations, xyzw, that map each axis to y, and then those that map the opposite directions."""

PALETTE = ("#3b6ea8", "#d9596b", "#2b8a57", "#b08a00", "#8a5cb8", "#2492ad", "#9c5a2e", "#6b7280")
"""Colours of the joint groups, in order; if there are more groups, the colours repeat."""

_CORNERS_PER_BONE = 24


@dataclass(frozen=True, eq=False)
class ExportTransform:
    """The transform of a motion to metres and y up: a scale factor and a rotation of the root.

    The local rotations of all joints but the root do not change.
    """

    scale: float  # metres per unit of length
    unit: str  # key of `UNITS` if the scale was guessed, else "given"
    up_axis: int  # vertical axis of the motion, 0 to 2
    to_y_up: FloatArray  # rotation from the up direction of the motion to y, shape (4,), xyzw

    @classmethod
    def of(cls, motion: Motion, scale: float | None) -> "ExportTransform":
        """Return the transform of a motion; if `scale` is None, `guess_unit` determines it.

        Raises ValueError if `scale`, in metres per unit, is not above 0.
        """
        unit = "given" if scale is not None else guess_unit(motion.skeleton)
        if scale is None:
            scale = UNITS[unit]
        elif not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"`scale` must be above 0 metres per unit, got {scale}")
        axis = up_axis(motion)
        # The head may be below the feet on this axis.
        is_flipped = up_sign(motion.skeleton, mean_world_positions(motion)[:, axis]) < 0
        return cls(float(scale), unit, axis, ROTATIONS_TO_Y_UP[axis + 3 * is_flipped])

    @property
    def metadata(self) -> dict[str, float | str]:
        """The entries by which an exported file documents the transform."""
        up = "xyz"[self.up_axis]
        return {"metres_in_a_unit": self.scale, "unit": self.unit, "up_in_the_motion": up}

    def points(self, points: FloatArray) -> FloatArray:
        """Rotate and scale points or vectors, shape (..., 3)."""
        return self.scale * rotations.rotate(self.to_y_up, points)

    def local_transforms(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Return the transformed local rotations and positions of a motion.

        Rotations have shape (n_frames, n_joints, 4) and do not change sign from frame to frame.
        Positions have shape (n_frames, n_joints, 3). Raises ValueError if one is too large for
        single precision.
        """
        quats, positions = motion.rotations.copy(), self.scale * motion.positions
        hint = f" m; `scale` is {self.scale:.6g}"
        owner = motion.name or "the motion"
        check_single_precision("position", positions, motion.skeleton, owner, hint)
        quats[:, 0] = rotations.multiply(self.to_y_up, quats[:, 0])
        positions[:, 0] = rotations.rotate(self.to_y_up, positions[:, 0])
        return rotations.continuous_signs(quats), positions


def guess_unit(skeleton: Skeleton) -> str:
    """Return the unit, a key of `UNITS`, for which the height of a skeleton is nearest to 1.7 m.

    The nearest height is that whose ratio to 1.7 m is nearest to 1. BVH files do not state their
    unit. The guess may be wrong for children and animals.
    """
    height = mass_model(skeleton).height
    return min(UNITS, key=lambda unit: abs(np.log(height * UNITS[unit] / _HUMAN_HEIGHT)))


def check_single_precision(
    kind: str, values: FloatArray, skeleton: Skeleton, owner: str = "", hint: str = ""
) -> None:
    """Raise ValueError if a value is too large for single precision.

    `values` have shape (n_joints, 3) or (n_frames, n_joints, 3). The message states what the values
    are (`kind`, such as "position"), the joint, the frame, the motion (`owner`) and the value, and
    ends with `hint`.
    """
    largest = np.abs(values).max(initial=0.0)
    if largest <= _MAX_SINGLE:
        return
    index = tuple(np.argwhere(~(np.abs(values) <= _MAX_SINGLE))[0])
    frame = f" in frame {index[0]}" if values.ndim == 3 else ""
    owner = f" of {owner}" if owner else ""
    name, got = f"the {kind} of {skeleton.names[index[-2]]}{frame}{owner}", values[index]
    expected = "within the range of single precision, -1e38 to 1e38"
    raise ValueError(f"{name} must be {expected}, got {got:.6g}{hint}")


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
    # Octahedra of shorter bones would degenerate in single precision.
    shortest = 1e-5 * np.abs(rest[joints]).max(axis=1)
    shortest = np.maximum(max(1e-5, 1e-4 * thickness), shortest)
    chosen &= _lengths(ends - rest[joints]) >= shortest
    joints, ends = joints[chosen], ends[chosen]
    if not len(joints):
        joints = np.zeros(1, np.int64)
        ends = rest[:1] + np.array([0.0, max(thickness, 0.01, 1e-5 * np.abs(rest[0]).max()), 0.0])
    points, normals = _octahedra(rest[joints], ends, thickness)
    joints = np.repeat(joints, _CORNERS_PER_BONE)
    srgb = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in PALETTE])
    return BoneMesh(points, normals, joints, srgb[group_indices[joints] % len(PALETTE)] ** 2.2)


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
