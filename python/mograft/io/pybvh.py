"""Conversion of motions to and from `pybvh.Bvh`."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton


def from_pybvh(clip: Any) -> Motion:  # noqa: ANN401 - pybvh has no types
    """Convert a `pybvh.Bvh` to a motion.

    Parameters
    ----------
    clip : pybvh.Bvh
        The clip; it is not changed.

    Returns
    -------
    Motion
        The motion; its channel values are the angles of the clip.

    Raises
    ------
    ValueError
        If the clip has no frame or no frame time.
    """
    joints = [node for node in clip.nodes if not node.is_end_site()]
    index = {id(node): joint for joint, node in enumerate(joints)}
    end_sites: list[EndSite] = []
    for node in clip.nodes:
        if node.is_end_site():
            siblings = [id(child) for child in node.parent.children]
            previous = siblings[: siblings.index(id(node))]
            before = sum(sibling in index for sibling in previous)
            end_sites.append(EndSite(index[id(node.parent)], np.array(node.offset), before))
    channels = [[f"{axis}rotation" for axis in node.rot_channels] for node in joints]
    channels[0] = [f"{axis}position" for axis in clip.root.pos_channels] + channels[0]
    skeleton = Skeleton(
        tuple(node.name for node in joints),
        np.array([index.get(id(node.parent), -1) for node in joints]),
        np.array([node.offset for node in joints]),
        tuple(map(tuple, channels)),
        tuple(end_sites),
    )
    angles = np.asarray(clip.joint_angles, dtype=np.float64)
    orders = map(skeleton.rotation_order, range(skeleton.n_joints))
    quats = [rotations.from_euler(angles[:, joint], order) for joint, order in enumerate(orders)]
    positions = np.tile(skeleton.offsets, (len(angles), 1, 1))
    positions[:, 0] = clip.root_pos
    path = clip.source_path
    return Motion(
        skeleton,
        clip.frame_time,
        rotations.continuous_signs(np.stack(quats, axis=1)),
        positions,
        np.hstack([clip.root_pos, np.degrees(angles).reshape(len(angles), -1)]),
        name="" if path is None else Path(path).stem,
        path=None if path is None else Path(path),
    )


def to_pybvh(motion: Motion) -> Any:  # noqa: ANN401 - pybvh has no types
    """Convert a motion to a `pybvh.Bvh`.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    pybvh.Bvh
        The clip, with three rotation channels in every joint. If a joint of the motion has fewer,
        the missing channels are added after the others, with angle 0.

    Raises
    ------
    ImportError
        If pybvh is not installed.
    ValueError
        If the local position of a joint other than the root varies over time, which pybvh cannot
        represent. A constant local position becomes the offset of the joint.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> clip = to_pybvh(dance(strides=1).motion[:30])  # doctest: +SKIP
    >>> from_pybvh(clip).n_frames  # doctest: +SKIP
    30
    """
    pybvh = import_module("pybvh")
    skeleton = motion.skeleton
    is_translated = np.ptp(motion.positions[:, 1:], axis=0).any(axis=-1)
    if is_translated.any():
        joint = int(is_translated.argmax()) + 1
        raise ValueError(
            "pybvh can translate the root only, got a joint with varying local position, "
            f"{skeleton.names[joint]}"
        )
    nodes, joints = _build_nodes(skeleton, motion.positions[0])
    numbers = np.radians(motion.channel_numbers())
    angles = np.zeros((motion.n_frames, motion.n_joints, 3))
    for node, joint in enumerate(joints):
        channels = zip(skeleton.channels[joint], skeleton.channel_columns[joint], strict=True)
        columns = [column for name, column in channels if name.endswith("rotation")]
        angles[:, node, : len(columns)] = numbers[:, columns]
    return pybvh.Bvh(
        nodes,
        motion.positions[:, 0].copy(),
        angles,
        motion.frame_time,
        source_path=None if motion.path is None else str(motion.path),
        warn_on_disagreement=False,
    )


def _build_nodes(skeleton: Skeleton, positions: FloatArray) -> tuple[list[Any], list[int]]:
    """Return the nodes of pybvh in depth-first order, and the index of the joint of each.

    End sites are nodes, too, but have no joint index. `positions`, local positions of shape
    (n_joints, 3), become the offsets of all joints but the root.
    """
    bvhnode = import_module("pybvh.bvhnode")
    nodes: list[Any] = []
    joints: list[int] = []
    # An explicit stack of joints and end sites with their parent nodes: chains may be deeper than
    # Python's recursion limit.
    stack: list[tuple[int | EndSite, Any]] = [(0, None)]
    while stack:
        item, parent = stack.pop()
        if isinstance(item, EndSite):
            name = item.name or f"EndSite{parent.name}"
            node = bvhnode.BvhEndSite(name, item.offset, parent)
        else:
            order, name = skeleton.rotation_order(item), skeleton.names[item]
            axes = [*order, *(axis for axis in "XYZ" if axis not in order)]
            if parent is None:
                offset = skeleton.offsets[item]
                node = bvhnode.BvhRoot(name, offset, list("XYZ"), axes, [], None)
            else:
                node = bvhnode.BvhJoint(name, positions[item], axes, [], parent)
            joints.append(item)
            stack += [(child, node) for child in reversed(skeleton.children_and_sites[item])]
        if parent is not None:
            parent.children.append(node)
        nodes.append(node)
    return nodes, joints
