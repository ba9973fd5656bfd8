"""Conversion between the rest poses of mograft and of formats with rest rotations.

In mograft, as in BVH, a figure stands in its rest pose if all local rotations are the identity. The
axes of every joint are then those of the world. glTF, FBX and USD give every joint axes of its own:
the rest rotation. If G is the world rotation of a joint in the file and W its world rotation in the
rest pose of the file, then G W⁻¹ is its world rotation in mograft. World positions are the same.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.containers import remember
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton, usual_channels

POSITION_TOLERANCE = 1e-5
"""Distance from its rest offset, as a fraction of the extent of the rest pose, up to which a joint
counts as not translated. It covers the rounding of exporters that compute in single precision."""


@dataclass(frozen=True, eq=False)
class RestPose:
    """The rest pose of a file: its joints in the order of the file's hierarchy, parents first."""

    names: tuple[str, ...]
    parents: IntArray  # shape (n_joints,); -1 at the root
    rotations: FloatArray  # world rotations, shape (n_joints, 4), xyzw
    positions: FloatArray  # world positions, shape (n_joints, 3)

    @cached_property
    def offsets(self) -> FloatArray:
        """The positions of the joints relative to their parents, in world axes, (n_joints, 3)."""
        has_parent = (self.parents >= 0)[:, None]
        return self.positions - np.where(has_parent, self.positions[self.parents], 0.0)

    @cached_property
    def extent(self) -> float:
        """The largest extent of the rest pose along an axis of the world."""
        return float(np.ptp(self.positions, axis=0).max(initial=0.0))


def rebase(
    rest: RestPose, world: tuple[FloatArray, FloatArray], frame_time: float, *, name: str = ""
) -> Motion:
    """Return a motion, given the rest pose of a file and the world transforms of its nodes.

    `world` has rotations, shape (n_frames, n_nodes, 4), xyzw, and positions, shape (n_frames,
    n_nodes, 3); the last nodes are the joints. Rotations become relative to the rest pose, and
    positions do not change. The root has position channels, and so has each joint whose translation
    differs from its offset by more than `POSITION_TOLERANCE`.
    """
    turned, places = (own[:, -len(rest.names) :] for own in world)
    turned = rotations.multiply(turned, rotations.inverse(rest.rotations))
    local, positions = to_local(rest.parents, turned, np.asarray(places, np.float64))
    offsets = rest.offsets
    distances = np.abs(positions - offsets).max(axis=0).max(axis=1)  # faster than both at once
    is_translated = distances > POSITION_TOLERANCE * rest.extent
    is_translated[0] = True
    positions[:, ~is_translated] = offsets[~is_translated]
    key = ("skeleton", is_translated.tobytes())
    channels = usual_channels(is_translated)
    skeleton = remember(rest, key, lambda: Skeleton(rest.names, rest.parents, offsets, channels))
    quats = local / np.sqrt(np.einsum("...i,...i->...", local, local))[..., None]
    quats = rotations.continuous_signs(quats)
    return Motion(skeleton, frame_time, quats, positions, name=name)


def restore(rest: RestPose, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return the world rotations and positions of a motion in a file, as the inverse of `rebase`.

    Rotations have shape (n_frames, n_joints, 4), xyzw, and positions (n_frames, n_joints, 3).
    """
    turned, positions = motion.world_transforms()
    return rotations.multiply(turned, rest.rotations), positions


def to_local(
    parents: IntArray, world_rotations: FloatArray, world_positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return local rotations and positions from world ones: the inverse of forward kinematics.

    Joints have no scale. Shapes are those of `restore`. The local transform of the root is its
    world transform.
    """
    return _core.local(parents, *map(np.ascontiguousarray, (world_rotations, world_positions)))


def find_joints(parents: Sequence[int], is_member: Iterable[bool]) -> IntArray:
    """Return the indices of the joints among the nodes of a tree, which are in preorder.

    These are the members, their lowest common ancestor, and the nodes between them. The result is
    empty if there are no members.
    """
    n_below = [int(own) for own in is_member]
    for node in range(len(n_below) - 1, 0, -1):
        n_below[parents[node]] += n_below[node]
    counts = np.array(n_below)
    found = np.flatnonzero(counts)
    # The common ancestor is the last node in preorder that has all members at or below it.
    return found[found >= np.flatnonzero(counts == counts[0])[-1]]
