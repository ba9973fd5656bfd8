"""What is drawn of a motion: nodes with y up, bones and their widths; the projection of films."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.body.anatomy import Anatomy, anatomy, root_carriers
from mograft.body.capsules import RADII
from mograft.body.mass import mass_model, mean_world_positions, up_axis, up_sign
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_MAX_TIPS = 12

_SPINE = ("trunk", "neck", "head")
_FINGER_RADIUS = 0.006
_DETAIL_RADIUS = 0.005
_OTHER_RADIUS = 0.012
"""Radii of bones without a capsule in `RADII`, in heights."""

_UPRIGHT = (
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
)
"""For each vertical axis, the rotation matrix that maps it to the y axis."""


class Bone(NamedTuple):
    """A bone as pages draw it: a capsule, or the shape of a head, hand or foot."""

    joint: int
    end: FloatArray  # The other end in the axes of the joint.
    radius: float
    kind: str  # "head", "hand" or "foot", otherwise "".


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnSkeleton:
    """The nodes and bones of a motion as pages and films show them.

    The nodes are the joints, then the end sites, then for some skeletons the top of the head.
    """

    motion: Motion
    to_y_up: FloatArray  # Rotation matrix from the axes of the motion to those of `positions`.
    parents: list[int]  # The node at which the bone of each node begins; -1 without a bone.
    root: int  # The joint whose path the camera follows.
    height: float  # Of the body.
    tips: list[int]  # The nodes at the ends of the limbs, fingers excepted; at most 12.
    ends: list[tuple[int, FloatArray]]  # Joint and offset of each node that is no joint.
    bones: list[Bone]  # In the order of the nodes, then others.

    @classmethod
    def of(cls, motion: Motion) -> "DrawnSkeleton":
        """Return the nodes and bones of a motion."""
        skeleton = motion.skeleton
        known = anatomy(skeleton)
        mass = mass_model(skeleton)
        parents = node_parents(motion)
        ends = [(site.parent, site.offset) for site in skeleton.end_sites]
        top = _head_without_end(motion)
        if top is not None:
            parents, ends = [*parents, top], [*ends, (top, mass.bone[top])]
        root = motion.locomotion_root()
        return cls(
            motion=motion,
            to_y_up=_to_y_up(motion),
            parents=parents,
            root=known.hips if root in root_carriers(skeleton) else root,
            height=mass.height,
            tips=_limb_tips(known, parents),
            ends=ends,
            bones=_drawn_bones(skeleton, parents, ends, mass.height),
        )

    @cached_property
    def positions(self) -> FloatArray:
        """World positions, (n_frames, n_nodes, 3), in the unit of the motion, y up."""
        return np.concatenate(list(self._blocks()))

    @cached_property
    def floor(self) -> float:
        """Height of the floor."""
        lowest = [own[:, :, 1].min(axis=1) for own in self._blocks()]
        return float(np.percentile(np.concatenate(lowest), 5))

    def _blocks(self) -> Iterator[FloatArray]:
        """Yield the positions of the nodes in consecutive ranges of frames."""
        is_drawn, hips = _drawn_nodes(self.parents), anatomy(self.motion.skeleton).hips
        for _, turns, joints in self.motion.world_blocks():
            sites = (joints[:, j] + rotations.rotate(turns[:, j], end) for j, end in self.ends)
            positions = np.concatenate([joints, *(site[:, None] for site in sites)], axis=1)
            positions[:, ~is_drawn] = joints[:, [hips]]
            yield positions @ self.to_y_up.T


def node_parents(motion: Motion) -> list[int]:
    """Return the index of the parent of each joint, then of each end site; -1 without a bone.

    No bone ends at the root of the hierarchy, and none starts at an ancestor of the hips.
    """
    skeleton = motion.skeleton
    carriers = root_carriers(skeleton)
    parents = [*skeleton.parents.tolist(), *(site.parent for site in skeleton.end_sites)]
    return [-1 if parent in carriers else parent for parent in parents]


def _drawn_nodes(parents: list[int]) -> BoolArray:
    """Return whether each node is an end of a bone."""
    ends = {end for bone in enumerate(parents) if bone[1] >= 0 for end in bone}
    return np.isin(np.arange(len(parents)), list(ends))


def _head_without_end(motion: Motion) -> int | None:
    """Return the head if its only children are details such as eyes, otherwise None.

    The end of the bone of such a head is that of the mass model.
    """
    head, details = mass_model(motion.skeleton).head, set(anatomy(motion.skeleton).details)
    on_head = {node for node, parent in enumerate(node_parents(motion)) if parent == head}
    return head if head is not None and on_head and on_head <= details else None


def _drawn_bones(
    skeleton: Skeleton, parents: list[int], ends: list[tuple[int, FloatArray]], height: float
) -> list[Bone]:
    known = anatomy(skeleton)
    offsets = [*skeleton.offsets, *(offset for _, offset in ends)]
    parts = [*known.parts, *(known.parts[joint] for joint, _ in ends)]
    bones = []
    for node, joint in enumerate(parents):
        if joint < 0:
            continue
        part, shape = parts[joint], ""
        radius = RADII.get(part, _FINGER_RADIUS if part == "finger" else _OTHER_RADIUS)
        if {node, joint} & set(known.details):
            radius = _DETAIL_RADIUS  # Eyes as wide as the head would look like a second head.
        elif part == "trunk" and parts[node] not in _SPINE:
            radius = RADII["clavicle"]  # From the trunk to a limb.
        elif part == "foot" or (node >= skeleton.n_joints and part in ("head", "hand")):
            shape = part
        elif part == "pelvis":  # It is wider than the trunk, in which it ends.
            radius = 1.06 * radius if parts[node] == "trunk" else RADII["thigh"]
        bones.append(Bone(joint, offsets[node], radius * height, shape))
    # A trunk without neck ends at the shoulders; robots often have one.
    spine = {joint for node, joint in enumerate(parents) if parts[node] in _SPINE}
    for joint in set(known.joints("trunk")) & set(parents) - spine:
        bones.append(Bone(joint, mass_model(skeleton).bone[joint], RADII["trunk"] * height, ""))
    return bones


def _limb_tips(known: Anatomy, parents: list[int]) -> list[int]:
    inner = {parent for parent in parents if parent >= 0}
    leaves = [node for node, p in enumerate(parents) if p >= 0 and node not in inner]
    return [node for node in leaves if known.parts[parents[node]] != "finger"][:_MAX_TIPS]


def _to_y_up(motion: Motion) -> FloatArray:
    """Return the rotation matrix that makes the y axis point up; it does not mirror."""
    axis = up_axis(motion)
    means = mean_world_positions(motion)[:, axis]
    hidden = ~_drawn_nodes(node_parents(motion))[: len(means)]
    means = np.where(hidden, means[anatomy(motion.skeleton).hips], means)
    sign = up_sign(motion.skeleton, means)
    return np.array(_UPRIGHT[axis]) * np.array([[sign], [sign], [1.0]])


def project(
    offsets: FloatArray, yaw: float, tilt: float = 0.0, distance: float = inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the picture of points by a camera that looks at the middle of a figure.

    Parameters
    ----------
    offsets : ndarray, shape (..., 3)
        Offsets of the points from the middle of the figure in body heights, y up.
    yaw : float
        Angle about the vertical axis between the camera and the direction +z, positive towards +x,
        in radians.
    tilt : float
        Angle of the view below the horizontal, in radians.
    distance : float
        Distance from the middle of the figure in body heights. Infinite: a parallel projection.

    Returns
    -------
    right, up, size : ndarray, shape (...)
        Coordinates to the right and up in the picture, and the share of full size: 1 at the
        distance of the middle, and above 1 nearer.
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, up, z = np.moveaxis(offsets, -1, 0)
    across, near = cos * x - sin * z, sin * x + cos * z
    high = np.cos(tilt) * up - np.sin(tilt) * near
    near = np.cos(tilt) * near + np.sin(tilt) * up
    size = 1.0 / (1.0 - near / distance)
    return size * across, size * high, size


def front_yaw(skeleton: Skeleton, positions: FloatArray) -> float:
    """Return the yaw of the direction in which a figure faces, 0 for +z; 0 if it has no thighs.

    `positions` are those of the nodes in one frame with y up, shape (n_nodes, 3).
    """
    thighs = [anatomy(skeleton).joints("thigh", side=side) for side in ("left", "right")]
    if not all(thighs):
        return 0.0
    x, _, z = positions[thighs[0][0]] - positions[thighs[1][0]]
    return float(np.arctan2(-z, x))
