"""`GltfFile`: the skeleton of a glTF file, and the animations that move it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.names import unique_names
from mograft.errors import FormatError, join_names
from mograft.io.gltf.animation import PATH_WIDTHS, animated_properties
from mograft.io.gltf.container import Container, read_container
from mograft.io.gltf.nodes import NodeTree, Transforms, read_nodes, to_world
from mograft.io.named_errors import errors_of_file
from mograft.io.rest_pose import RestPose
from mograft.motion import limits


class NoFigureError(FormatError):
    """A glTF file has neither a skin nor an animation of nodes."""


@dataclass(frozen=True, eq=False)
class GltfFile:
    """A glTF file with its node tree, the nodes that are joints, and the animations that are clips.

    Joints are in depth-first order. The transforms of the nodes above the root joint are part of
    its world transform: a clip moves these nodes and the joints, the "moved nodes".
    """

    container: Container
    tree: NodeTree
    joints: IntArray  # index of the node of each joint, shape (n_joints,)
    above: IntArray  # nodes above the root joint, the root of the tree first
    rest: RestPose  # of the joints, from the default transforms of the nodes
    clip_names: tuple[str, ...]  # all different
    animations: tuple[int, ...]  # index of the animation of each clip
    notes: tuple[str, ...]  # content that is not part of the motions

    @cached_property
    def moved_nodes(self) -> IntArray:
        """The indices of the nodes above the root joint, then of the joints: parents first."""
        return np.concatenate([self.above, self.joints])

    @cached_property
    def moved_parents(self) -> IntArray:
        """The parent of each of `moved_nodes` as an index into them; -1 for the first."""
        return local_parents(self.tree, self.moved_nodes)

    @cached_property
    def moved_rows(self) -> IntArray:
        """For each node of the file its index in `moved_nodes`; 0 if it is not one of them."""
        rows: IntArray = np.zeros(len(self.tree.names), np.int64)
        rows[self.moved_nodes] = np.arange(len(self.moved_nodes))
        return rows

    @cached_property
    def moved_rest(self) -> Transforms:
        """The default transforms of `moved_nodes`, one frame."""
        return self.tree.rest.of(self.moved_nodes, 1)


def read_gltf_file(path: Path) -> GltfFile:
    """Read the node tree of a glTF file, and find its joints and clips.

    If the file has skins, the joints are those of the skins, otherwise the animated nodes. Their
    lowest common ancestor and the nodes between are joints, too. If they have several roots, they
    are several figures, of which the one with the most joints is taken. Raises `FormatError` if the
    file is invalid, and `NoFigureError` if it has no joints.
    """
    container = read_container(path)
    tree = read_nodes(container)
    changed = [animated_properties(container, i) for i in range(len(container.items("animations")))]
    animated = [
        {node for node, path in properties if path in PATH_WIDTHS and node is not None}
        for properties in changed
    ]
    joints, left_out = _find_joints(container, tree, set().union(*animated))
    above = np.array(tree.ancestors(int(joints[0]))[:0:-1], np.int64)
    moved = {*above.tolist(), *joints.tolist()}
    clips = [index for index, nodes in enumerate(animated) if nodes & moved]
    names = unique_names(_animation_names(container, clips))
    rest = rest_pose(tree, above, joints)
    with errors_of_file(path, "nodes"):
        limits.check_hierarchy(rest.names, rest.parents.tolist())
    notes = [*left_out, *_find_notes(container, tree, moved, changed, clips)]
    return GltfFile(container, tree, joints, above, rest, tuple(names), tuple(clips), tuple(notes))


def rest_pose(tree: NodeTree, above: IntArray, joints: IntArray) -> RestPose:
    """Return the rest pose of joints: the default world transforms of their nodes."""
    nodes = np.concatenate([above, joints])
    turned, positions = to_world(local_parents(tree, nodes), tree.rest.of(nodes, 1))
    first = len(above)
    parents = local_parents(tree, joints)
    names = tuple(tree.names[node] for node in joints)
    return RestPose(names, parents, turned[0, first:], positions[0, first:])


def local_parents(tree: NodeTree, nodes: IntArray) -> IntArray:
    """Return the parent of each of `nodes` as an index into `nodes`; -1 for the first."""
    rows = np.full(len(tree.names), -1)
    rows[nodes] = np.arange(len(nodes))
    parents = rows[tree.parents[nodes]]
    parents[0] = -1
    return parents


def _find_joints(
    container: Container, tree: NodeTree, animated: set[int]
) -> tuple[IntArray, list[str]]:
    """Return the joints of the largest figure, depth first, and a note of the others, if any."""
    members: set[int] = set()
    for number, skin in enumerate(container.items("skins")):
        place = f"skins[{number}].joints"
        listed = skin.get("joints")
        if not isinstance(listed, list) or not listed:
            container.fail(place, "expected a list of nodes")
        for node in listed:
            container.item("nodes", node, place)
            members.add(node)
    members = members or animated
    if not members:
        raise NoFigureError("expected a skin or an animation of nodes, got none", container.path)
    with errors_of_file(container.path, "nodes"):
        limits.check_joints(len(members))
    figures: dict[int, list[int]] = {}
    nodes = sorted(members)
    for node, top in zip(nodes, tree.roots(nodes), strict=True):
        figures.setdefault(top, []).append(node)
    largest = max(figures.values(), key=len)
    root = tree.common_ancestor(largest)
    needed = {root}
    for node in largest:
        while node not in needed:
            needed.add(node)
            node = int(tree.parents[node])
    others = [tree.names[top] for top, nodes in figures.items() if nodes is not largest]
    note = [f"left out the figures below the nodes {join_names(others)}"] if others else []
    return np.array([node for node in tree.below(root) if node in needed]), note


def _animation_names(container: Container, animations: Sequence[int]) -> list[str]:
    items = container.items("animations")
    names = [items[index].get("name") for index in animations]
    return [name if isinstance(name, str) else "" for name in names]


def _find_notes(
    container: Container,
    tree: NodeTree,
    moved: set[int],
    changed: Sequence[set[tuple[int | None, str]]],
    clips: Sequence[int],
) -> list[str]:
    """Return notes on content that the motions do not contain."""
    notes = []
    others = [name for node, name in enumerate(tree.names) if node not in moved]
    if others:
        notes.append(f"nodes that are not joints: {join_names(others)}")
    still = [index for index in range(len(changed)) if index not in clips]
    if still:
        names = [
            name or f"animation {i}"
            for name, i in zip(_animation_names(container, still), still, strict=True)
        ]
        notes.append(f"animations that move no joint: {join_names(names)}")
    properties = set().union(*changed)
    lost = {node for node, path in properties if node is not None and path in PATH_WIDTHS} - moved
    if lost:
        names = [tree.names[node] for node in sorted(lost)]
        notes.append(f"animated nodes that are not joints: {join_names(names)}")
    paths = {path for index in clips for _, path in changed[index]}
    unread = sorted(paths - PATH_WIDTHS.keys())
    if unread:
        notes.append(f"animated properties that are not read: {', '.join(unread)}")
    if "scale" in paths:
        notes.append("animated scale is part of the positions of the joints below")
    return notes
