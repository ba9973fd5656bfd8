"""What is drawn of a motion: nodes with y up, bones between them, and their widths."""

from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.body.anatomy import Anatomy, anatomy, root_carriers
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion

_MAX_TIPS = 12

_BONE_WIDTHS = {
    "head": 2.6,
    "neck": 1.1,
    "trunk": 1.9,
    "pelvis": 1.9,
    "clavicle": 1.2,
    "upper_arm": 1.3,
    "forearm": 1.1,
    "hand": 0.9,
    "finger": 0.4,
    "thigh": 1.7,
    "shank": 1.4,
    "foot": 1.2,
    "toe": 1.0,
}
"""Width of the bones of a body part; 1 is about a fiftieth of the height."""

_TRUNK_TO_LIMB_WIDTH = 1.1
_DETAIL_WIDTH = 0.4


_UPRIGHT = (
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
)
"""For each vertical axis, the rotation matrix that maps it to the y axis."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnSkeleton:
    """The nodes and bones of a motion as pages and films show them.

    The nodes are the joints, then the end sites, then for some skeletons the top of the head.
    """

    positions: FloatArray  # World, (n_frames, n_nodes, 3), in the unit of the motion, y up.
    to_y_up: FloatArray  # Rotation matrix from the axes of the motion to those of `positions`.
    parents: list[int]  # The node at which the bone of each node begins; -1 without a bone.
    root: int  # The joint whose path the camera follows.
    height: float  # Of the body.
    floor: float  # Height of the floor.
    widths: list[float]  # Of each node's bone; 1 is about a fiftieth of the body height.
    tips: list[int]  # The nodes at the ends of the limbs, fingers excepted; at most 12.

    @classmethod
    def of(cls, motion: Motion) -> "DrawnSkeleton":
        """Return the nodes of a motion."""
        skeleton = motion.skeleton
        known = anatomy(skeleton)
        mass = mass_model(skeleton)
        parents = node_parents(motion)
        positions = node_positions(motion)
        on_head = {node for node, parent in enumerate(parents) if parent == mass.head}
        if mass.head is not None and on_head and on_head <= set(known.details):
            # The only children of the head are details such as eyes: the mass model sets its end.
            turns, joints = motion.world_transforms()
            top = joints[:, mass.head] + rotations.rotate(turns[:, mass.head], mass.bone[mass.head])
            positions = np.concatenate([positions, top[:, None]], axis=1)
            parents.append(mass.head)
        to_y_up = _to_y_up(positions, motion)
        positions = positions @ to_y_up.T
        root = motion.locomotion_root()
        lowest = positions[:, :, 1].min(axis=1)
        return cls(
            positions=positions,
            to_y_up=to_y_up,
            parents=parents,
            root=known.hips if root in root_carriers(skeleton) else root,
            height=mass.height,
            floor=float(np.percentile(lowest, 5)),
            widths=_bone_widths(known, parents),
            tips=_limb_tips(known, parents),
        )

    def with_positions(self, positions: FloatArray) -> "DrawnSkeleton":
        """Return the skeleton with other positions of its nodes."""
        return replace(self, positions=positions)


def node_parents(motion: Motion) -> list[int]:
    """Return the index of the parent of each joint, then of each end site; -1 without a bone.

    No bone ends at the root of the hierarchy, and none starts at an ancestor of the hips.
    """
    skeleton = motion.skeleton
    carriers = root_carriers(skeleton)
    parents = [*skeleton.parents.tolist(), *(site.parent for site in skeleton.end_sites)]
    return [-1 if parent in carriers else parent for parent in parents]


def node_positions(motion: Motion) -> FloatArray:
    """Return the world positions of joints and end sites, shape (n_frames, n_nodes, 3).

    Nodes that are not an end of any bone, such as a root on the floor, get the position of the
    hips, because their true position may be far from the body.
    """
    turns, joints = motion.world_transforms()
    sites = [
        joints[:, site.parent] + rotations.rotate(turns[:, site.parent], site.offset)
        for site in motion.skeleton.end_sites
    ]
    positions = np.concatenate([joints, *(site[:, None] for site in sites)], axis=1)
    bones = [(node, parent) for node, parent in enumerate(node_parents(motion)) if parent >= 0]
    is_drawn = np.zeros(positions.shape[1], bool)
    is_drawn[[end for bone in bones for end in bone]] = True
    positions[:, ~is_drawn] = joints[:, [anatomy(motion.skeleton).hips]]
    return positions


def _bone_widths(known: Anatomy, parents: list[int]) -> list[float]:
    by_joint = [_BONE_WIDTHS.get(part, 1.0) for part in known.parts]
    above = [max(parent, 0) for parent in parents]
    widths = [by_joint[node] for node in above]
    for joint, part in enumerate(known.parts):
        is_trunk = widths[joint] == _BONE_WIDTHS["trunk"]
        if is_trunk and part not in ("trunk", "neck", "head"):
            widths[joint] = _TRUNK_TO_LIMB_WIDTH
    for node, parent in enumerate(above):
        # Eyes and markers drawn as wide as the head would look like a second head.
        if {node, parent} & set(known.details):
            widths[node] = _DETAIL_WIDTH
    return widths


def _limb_tips(known: Anatomy, parents: list[int]) -> list[int]:
    inner = {parent for parent in parents if parent >= 0}
    leaves = [node for node, p in enumerate(parents) if p >= 0 and node not in inner]
    return [node for node in leaves if known.parts[parents[node]] != "finger"][:_MAX_TIPS]


def _to_y_up(positions: FloatArray, motion: Motion) -> FloatArray:
    """Return the rotation matrix that makes the y axis point up; it does not mirror.

    `positions` are those of the nodes in the world, shape (n_frames, n_nodes, 3).
    """
    axis = up_axis(motion)
    mass = mass_model(motion.skeleton)
    ankles = [foot.ankle for foot in mass.feet]
    high = mass.head if mass.head is not None else mass.hips
    low = ankles if ankles else [mass.hips]
    sign = -1.0 if positions[:, high, axis].mean() < positions[:, low, axis].mean() else 1.0
    rotation: FloatArray = np.array(_UPRIGHT[axis]) * np.array([[sign], [sign], [1.0]])
    return rotation
