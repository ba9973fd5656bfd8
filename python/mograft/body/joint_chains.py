"""`JointChains`: the hierarchy as chains of joints between branchings, left and right as one."""

from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.anatomy import anatomy, feature_joints
from mograft.body.joint_names import LEG
from mograft.body.mass import mass_model, mean_world_positions, up_axis, up_sign
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

MIN_SUPPORT_SHARE = 0.25
"""Minimum share of poses in which a joint that carries the body is lowest."""
_SUPPORT_HEIGHT = 0.05
"""Maximum height of a lowest joint above the lowest point of the pose, in skeleton heights."""
_MAX_POSES = 500
"""Poses of a motion that are examined for support."""


@dataclass(frozen=True, eq=False)
class JointChains:
    """The joints of a skeleton as nodes, and the nodes as chains.

    A node is a joint together with its counterpart on the other side of the body, if it has one. A
    chain is a sequence of nodes from one branching of the hierarchy to the next. Joints that are
    not compared (see `feature_joints`) have the node of the nearest compared ancestor.
    """

    skeleton: Skeleton
    nodes: tuple[tuple[int, ...], ...]  # compared joints of each node, ascending
    parents: IntArray  # node above each node, -1 for the first; parents precede their children
    chains: IntArray  # chain of each node, numbered from 0 in the order of their first nodes
    node_of_joint: IntArray  # shape (n_joints,)

    @classmethod
    def from_skeleton(cls, skeleton: Skeleton) -> "JointChains":
        """Return the chains of a skeleton."""
        known = anatomy(skeleton)
        compared = {0, *feature_joints(skeleton, np.arange(skeleton.n_joints)).tolist()}
        above: list[int] = []  # nearest compared ancestor of each joint; -1 for the root
        for parent in skeleton.parents.tolist():
            above.append(parent if parent < 0 or parent in compared else above[parent])
        n_children = Counter(above[joint] for joint in compared)
        nodes: dict[tuple[Hashable, int], list[int]] = {}
        parents: list[int] = []
        # Of each joint: the key of its chain, and its position in the chain.
        place: dict[int, tuple[Hashable, int]] = {}
        node_of_joint = np.zeros(skeleton.n_joints, np.int64)
        ranks: Counter[Hashable] = Counter()
        for joint, parent in enumerate(above):
            node = int(node_of_joint[parent]) if parent >= 0 else -1
            if joint not in compared:
                node_of_joint[joint] = node
                continue
            if parent >= 0 and n_children[parent] == 1:
                chain, position = place[parent]
                place[joint] = chain, position + 1
            else:
                part, side = known.parts[joint], known.sides[joint]
                place[joint] = (node, part, bool(side), ranks[node, part, side]), 0
                ranks[node, part, side] += 1
            if place[joint] not in nodes:
                parents.append(node)
            nodes.setdefault(place[joint], []).append(joint)
            node_of_joint[joint] = list(nodes).index(place[joint])
        chains = list(dict.fromkeys(chain for chain, _ in nodes))
        return cls(
            skeleton=skeleton,
            nodes=tuple(map(tuple, nodes.values())),
            parents=np.array(parents, np.int64),
            chains=np.array([chains.index(chain) for chain, _ in nodes], np.int64),
            node_of_joint=node_of_joint,
        )

    def base_chains(self, supports: BoolArray) -> BoolArray:
        """Return which chains must be in the base group, one value per chain.

        A chain must be in the base group if it has one of these joints: the hips, an ancestor of
        the hips or of a leg, another joint that is not below the hips, or a joint that `supports`,
        shape (n_joints,), marks. A chain must also be in the base group if all of its joints belong
        to the pelvis or to no body part.
        """
        skeleton, known = self.skeleton, anatomy(self.skeleton)
        legs = known.joints(*LEG)
        leg_ancestors = {above for joint in legs for above in skeleton.ancestors(joint)}
        required = {known.hips, *skeleton.ancestors(known.hips), *(leg_ancestors - set(legs))}
        is_required = supports | ~skeleton.subtree_mask([known.hips])
        is_required[list(required)] = True
        found = np.zeros(self.chains.max() + 1, bool)
        found[self.chains[self.node_of_joint[is_required]]] = True
        is_limb = [known.parts[joints[0]] not in ("pelvis", "other") for joints in self.nodes]
        found[np.setdiff1d(self.chains, self.chains[is_limb])] = True
        return found


def support_shares(motion: Motion) -> FloatArray:
    """Return the share of poses in which each joint is among the lowest, shape (n_joints,).

    A joint is lowest if it, or an end site of it, is within 0.05 skeleton heights of the lowest
    point of the pose. Up to 500 poses at equal intervals are examined. Up is the direction of
    `up_axis` in which the rest pose is upright, so that the hands are lowest in a handstand. If the
    rest pose lies along another axis, up is the direction in which the mean pose is upright.
    """
    skeleton, up = motion.skeleton, up_axis(motion)
    identity = np.broadcast_to(rotations.IDENTITY, (1, skeleton.n_joints, 4))
    rest = Motion(skeleton, motion.frame_time, identity, skeleton.offsets[None])
    reference = rest if up_axis(rest) == up else motion
    sign = up_sign(skeleton, mean_world_positions(reference)[:, up])
    poses = motion[:: -(-motion.n_frames // _MAX_POSES)]
    world_rotations, positions = poses.world_transforms()
    heights = sign * positions[..., up]
    for site in skeleton.end_sites:
        offset = rotations.rotate(world_rotations[:, site.parent], site.offset)
        tips = sign * (positions[:, site.parent, up] + offset[:, up])
        heights[:, site.parent] = np.minimum(heights[:, site.parent], tips)
    limit = heights.min(axis=1, keepdims=True) + _SUPPORT_HEIGHT * mass_model(skeleton).height
    return (heights <= limit).mean(axis=0)
