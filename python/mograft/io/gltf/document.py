"""`GltfFile`: the skeleton of a glTF file, the animations that move it, and their motions."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.names import unique_names
from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips, errors_of_file
from mograft.io.gltf.animation import (
    DEFAULT_RATE,
    PATH_WIDTHS,
    Animation,
    animated_properties,
    animation_names,
    choose_times,
    read_animation,
    sample,
)
from mograft.io.gltf.container import Container, read_container
from mograft.io.gltf.grafts import provenance
from mograft.io.gltf.nodes import NodeTree, Transforms, read_nodes, to_rest_pose, to_world
from mograft.io.rest_pose import RestPose, find_joints, rebase
from mograft.motion import limits
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


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
    moved_nodes: IntArray  # indices of the nodes above the root joint, then of the joints
    moved_parents: IntArray  # parents of `moved_nodes` as indices into them; -1 for the first
    moved_rows: IntArray  # for each node of the file its index in `moved_nodes`, or -1
    n_above: int  # number of nodes above the root joint
    rest: RestPose  # of the joints, from the default transforms of the nodes
    moved_rest: Transforms  # the default transforms of `moved_nodes`, one frame
    clip_names: tuple[str, ...]  # all different
    animations: tuple[int, ...]  # index of the animation of each clip
    notes: tuple[str, ...]  # content that is not part of the motions

    @property
    def joints(self) -> IntArray:
        """Index of the node of each joint, shape (n_joints,)."""
        return self.moved_nodes[self.n_above :]

    def read(self, clip: int) -> Animation:
        """Read the channels of a clip."""
        moved = frozenset(self.moved_nodes.tolist())
        return read_animation(self.container, self.animations[clip], moved)

    def sample(self, animation: Animation, times: FloatArray) -> Transforms:
        """Return the local transforms of `moved_nodes` at the times of the frames."""
        return sample(self.container, animation, times, self.moved_rest, self.moved_rows)


def read_gltf_file(path: Path, content: bytes | None = None) -> GltfFile:
    """Read the node tree of a glTF file, and find its joints and clips.

    If the file has skins, the joints are those of the skins, otherwise the animated nodes. Their
    lowest common ancestor and the nodes between are joints, too. If they have several roots, they
    are several figures, of which the one with the most joints is taken. Raises `FormatError` if the
    file is invalid, and `NoFigureError` if it has no joints. `content` is as for `read_container`.
    """
    container = read_container(path, content)
    tree = read_nodes(container)
    changed = [animated_properties(container, i) for i in range(len(container.items("animations")))]
    animated = [
        {node for node, path in properties if path in PATH_WIDTHS and node is not None}
        for properties in changed
    ]
    joints, left_out = _find_joints(container, tree, set().union(*animated))
    line = [int(joints[0])]
    while (node := int(tree.parents[line[-1]])) >= 0:
        line.append(node)
    nodes, n_above = np.concatenate([line[:0:-1], joints]).astype(np.int64), len(line) - 1
    rows: IntArray = np.full(len(tree.names), -1)
    rows[nodes] = np.arange(len(nodes))
    parents = rows[tree.parents[nodes]]
    parents[0] = -1
    moved_rest = tree.rest.of(nodes, 1)
    moved_names = tuple(tree.names[node] for node in nodes)
    rest = to_rest_pose(moved_names, parents, moved_rest, n_above)
    with errors_of_file(path, "nodes"):
        limits.check_hierarchy(rest.names, rest.parents.tolist())
    moved, names = set(nodes.tolist()), animation_names(container.items("animations"))
    clips = [index for index, own in enumerate(animated) if own & moved]
    others = [name or f"animation {i}" for i, name in enumerate(names) if i not in clips]
    fixed = sorted(set().union(*animated) - moved)
    paths = {path for index in clips for _, path in changed[index]}
    listed = {
        "nodes that are not joints": [n for i, n in enumerate(tree.names) if i not in moved],
        "animations that move no joint": others,
        "animated nodes that are not joints": [tree.names[node] for node in fixed],
        "animated properties that are not read": sorted(paths - PATH_WIDTHS.keys()),
    }
    notes = [*left_out, *(f"{text}: {join_names(own)}" for text, own in listed.items() if own)]
    if "scale" in paths:
        notes.append("animated scale is part of the positions of the joints below")
    return GltfFile(
        container=container,
        tree=tree,
        moved_nodes=nodes,
        moved_parents=parents,
        moved_rows=rows,
        n_above=n_above,
        rest=rest,
        moved_rest=moved_rest,
        clip_names=tuple(unique_names([names[index] for index in clips])),
        animations=tuple(clips),
        notes=tuple(notes),
    )


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
    orders = map(tree.below, np.flatnonzero(tree.parents < 0).tolist())
    pairs = [(members.intersection(order), order) for order in orders]
    figures = sorted((pair for pair in pairs if pair[0]), key=lambda pair: min(pair[0]))
    largest, order = max(figures, key=lambda pair: len(pair[0]))
    rows = {node: row for row, node in enumerate(order)}
    parents = [rows.get(parent, -1) for parent in tree.parents[order].tolist()]
    joints = np.array(order)[find_joints(parents, [node in largest for node in order])]
    others = [tree.names[pair[1][0]] for pair in figures if pair[1] is not order]
    return joints, [f"left out the figures below the nodes {join_names(others)}"] if others else []


def open_gltf(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clips of a glTF file; see `mograft.io.formats.Opener`."""
    try:
        file = read_gltf_file(path)
    except NoFigureError as error:
        return Clips(path, (), tuple[Motion, ...]().__getitem__, "glTF", (error.message,))
    animations = [file.container.items("animations")[index] for index in file.animations]
    texts = zip(file.clip_names, map(provenance, animations), strict=True)
    return Clips(
        path,
        file.clip_names,
        lambda clip: _read_motion(file, clip, rate),
        "glTF",
        file.notes,
        lambda clip: len(_read_times(file, clip, rate)[1]),
        {name: text for name, text in texts if text is not None},
    )


def _read_motion(file: GltfFile, clip: int, rate: float | None) -> Motion:
    """Return the motion of a clip, sampled from its first to its last key.

    If `rate` is None, the rate is that of the keys if these lie on a uniform grid of 12 to 500
    frames per second, else 30. Raises `FormatError` if the animation is invalid.
    """
    animation, times, frame_time = _read_times(file, clip, rate)
    world = to_world(file.moved_parents, file.sample(animation, times))
    with errors_of_file(file.container.path, animation.place):
        return rebase(file.rest, world, frame_time, name=file.clip_names[clip])


def _read_times(
    file: GltfFile, clip: int, rate: float | None
) -> tuple[Animation, FloatArray, float]:
    """Return the channels of a clip, the times of its frames, and the frame time."""
    animation, n_nodes = file.read(clip), len(file.moved_nodes)
    with errors_of_file(file.container.path, animation.place):
        times = choose_times(animation.key_times, rate, n_nodes, file.container.n_bytes)
        frame_time = 1.0 / (rate or DEFAULT_RATE)
        if len(times) > 1:
            frame_time = float(times[-1] - times[0]) / (len(times) - 1)
        limits.check_frame_time(frame_time)
    return animation, times, frame_time
