"""The node tree of a glTF file: default transforms, and the world transforms of all frames.

A node has a translation, a rotation and a scale along its axes. The rotation of mograft has no
scale: the scale of a node moves the nodes below it, and is therefore part of world positions only.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.io.gltf.container import Container
from mograft.io.rest_pose import RestPose
from mograft.motion import rotations
from mograft.motion.motion import forward_kinematics

SCALE_TOLERANCE = 1e-5
"""Relative difference of scales that counts as none. It covers the rounding of exporters: Blender
writes constant scales of 1 with differences up to 1e-5."""


class Transforms(NamedTuple):
    """Local transforms of nodes: in every frame, or one pose with n_frames = 1."""

    translations: FloatArray  # shape (n_frames, n_nodes, 3)
    rotations: FloatArray  # shape (n_frames, n_nodes, 4), xyzw
    scales: FloatArray  # shape (n_frames, n_nodes, 3)

    def of(self, nodes: IntArray, n_frames: int) -> "Transforms":
        """Return one pose of some nodes, repeated in `n_frames` frames."""
        return Transforms(*(np.repeat(array[:, nodes], n_frames, axis=0) for array in self))


@dataclass(frozen=True, eq=False)
class NodeTree:
    """The nodes of a glTF file, in the order of the file."""

    names: tuple[str, ...]
    parents: IntArray  # shape (n_nodes,); -1 at roots
    children: tuple[tuple[int, ...], ...]
    rest: Transforms  # the default transforms: one frame

    def below(self, root: int) -> list[int]:
        """Return a node and all nodes below it, parents first, in the order of the file."""
        found, pending = [], [root]
        while pending:
            node = pending.pop()
            found.append(node)
            pending += self.children[node][::-1]
        return found


def read_nodes(container: Container) -> NodeTree:
    """Return the nodes of a file; raise `FormatError` if they are not trees."""
    items = container.items("nodes")
    parents = np.full(len(items), -1)
    children: list[tuple[int, ...]] = []
    for index, item in enumerate(items):
        below = item.get("children", [])
        place = f"nodes[{index}].children"
        if not isinstance(below, list):
            container.fail(place, f"expected a list, got {below!r:.60}")
        for child in below:
            container.item("nodes", child, place)
            if parents[child] >= 0:
                message = f"expected one parent, got {parents[child]} and {index}"
                container.fail(f"nodes[{child}]", message)
            parents[child] = index
        children.append(tuple(below))
    # With one parent per node, the nodes that no root reaches are those of cycles.
    n_reached, level = 0, np.flatnonzero(parents < 0).tolist()
    while level:
        n_reached += len(level)
        level = [child for node in level for child in children[node]]
    if n_reached < len(items):
        container.fail("nodes", "expected trees, got nodes that are their own ancestors")
    rows = np.array([_read_transform(container, item, i) for i, item in enumerate(items)])
    given = [item.get("name") for item in items]
    names = tuple(n if isinstance(n, str) and n else f"node{i}" for i, n in enumerate(given))
    return NodeTree(names, parents, tuple(children), to_transforms(rows))


def to_transforms(rows: FloatArray) -> Transforms:
    """Return the transforms of one frame, given results of `decompose`, shape (n_nodes, 10)."""
    rows = rows.reshape(1, -1, 10)
    return Transforms(rows[..., :3].copy(), rows[..., 3:7].copy(), rows[..., 7:].copy())


def _read_transform(container: Container, item: dict[str, object], index: int) -> list[float]:
    """Return translation (3), rotation (4, xyzw) and scale (3) of a node as ten numbers."""
    place = f"nodes[{index}]"
    if "matrix" in item:
        numbers = container.floats(item["matrix"], f"{place}.matrix", 16)
        return decompose(np.array(numbers).reshape(4, 4).T)
    rotation = container.floats(item.get("rotation", [0, 0, 0, 1]), f"{place}.rotation", 4)
    norm = sum(value * value for value in rotation) ** 0.5
    if norm < 1e-6:
        container.fail(f"{place}.rotation", "expected a unit quaternion, got zero")
    translation = container.floats(item.get("translation", [0, 0, 0]), f"{place}.translation", 3)
    scale = container.floats(item.get("scale", [1, 1, 1]), f"{place}.scale", 3)
    return [*translation, *(value / norm for value in rotation), *scale]


def decompose(matrix: FloatArray) -> list[float]:
    """Return translation (3), rotation (4, xyzw) and scale (3) of a 4 x 4 matrix.

    glTF requires that a matrix is a product of these three.
    """
    linear = matrix[:3, :3]
    scale = np.linalg.norm(linear, axis=0)
    if np.linalg.det(linear) < 0:
        scale[0] = -scale[0]
    left, _, right = np.linalg.svd(linear / np.where(scale == 0, 1.0, scale))
    axes = left @ right  # the nearest rotation, if a scale is zero or rounding disturbs the axes
    if np.linalg.det(axes) < 0:
        axes = left @ np.diag([1.0, 1.0, -1.0]) @ right
    return [*matrix[:3, 3].tolist(), *rotations.from_matrices(axes).tolist(), *scale.tolist()]


def to_world(parents: IntArray, local: Transforms) -> tuple[FloatArray, FloatArray]:
    """Return world rotations and positions of nodes, shapes (n_frames, n_nodes, 4) and (..., 3).

    `parents` are indices into the nodes; node 0 is the only root, and parents precede their
    children. World rotations are products of the local ones. Negative scales are first converted by
    `remove_mirroring`, which may add half turns to the rotations.
    """
    turns, scales = remove_mirroring(local.rotations, local.scales)
    first = scales[..., 0]
    spread = np.maximum(np.abs(scales[..., 1] - first), np.abs(scales[..., 2] - first))
    if (spread <= SCALE_TOLERANCE * np.abs(first)).all():
        places = local.translations
        if not (np.abs(first - 1.0) <= SCALE_TOLERANCE).all():
            places = places.copy()
            places[:, 1:] *= _products(parents, first)[:, parents[1:], None]
        return forward_kinematics(parents, turns, places)
    world_turns, _ = forward_kinematics(parents, turns, local.translations)
    return world_turns, _matrix_positions(parents, turns, scales, local.translations)


def to_rest_pose(
    names: tuple[str, ...], parents: IntArray, rest: Transforms, n_above: int
) -> RestPose:
    """Return the rest pose of joints, given their nodes after `n_above` nodes above them.

    `rest` has the default transforms of these nodes; names and parents are those of the nodes.
    """
    turned, places = to_world(parents, rest)
    own_parents = np.maximum(parents[n_above:] - n_above, -1)
    return RestPose(names[n_above:], own_parents, turned[0, n_above:], places[0, n_above:])


def remove_mirroring(turns: FloatArray, scales: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Convert rotations and scales so that the three scales of a node have the same sign.

    Two negative scales are the same as a half turn about the third axis. This half turn is appended
    to the rotation, and the scales become positive. One or three negative scales become three: one
    negative scale is a half turn about its axis with all three scales negative.
    """
    if (scales >= 0).all():
        return turns, scales
    signs = np.where(scales < 0, -1.0, 1.0)
    overall = signs.prod(axis=-1, keepdims=True)
    flips = signs * overall  # an even number of -1
    half_turns = np.concatenate([(flips > 0).astype(float), np.zeros((*flips.shape[:-1], 1))], -1)
    half_turns[(flips > 0).all(axis=-1)] = rotations.IDENTITY
    return rotations.multiply(turns, half_turns), scales * flips


def _products(parents: IntArray, factors: FloatArray) -> FloatArray:
    """Return for each node the product of its factor and those of its ancestors, (n_frames, n)."""
    products = factors.copy()
    for node, parent in enumerate(parents.tolist()):
        if parent >= 0:
            products[:, node] *= products[:, parent]
    return products


def _matrix_positions(
    parents: IntArray, turns: FloatArray, scales: FloatArray, places: FloatArray
) -> FloatArray:
    """Return world positions, computed with matrices, because scales differ between axes.

    The arguments are local rotations, scales and translations.
    """
    linear = to_matrices(turns) * scales[:, :, None, :]
    positions = places.copy()
    for node, parent in enumerate(parents.tolist()):
        if parent >= 0:
            arms = linear[:, parent] @ places[:, node, :, None]
            positions[:, node] = positions[:, parent] + arms[..., 0]
            linear[:, node] = linear[:, parent] @ linear[:, node]
    return positions


def to_matrices(quats: FloatArray) -> FloatArray:
    """Return the matrices, shape (..., 3, 3), of unit quaternions."""
    return np.stack([rotations.rotate(quats, axis) for axis in np.eye(3)], axis=-1)
