"""Motion to the objects of other libraries and back."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

__all__ = ["from_pybvh", "to_pybvh"]


def from_pybvh(clip: Any) -> Motion:  # noqa: ANN401 - pybvh has no types
    """Return the motion that a `pybvh.Bvh` holds.

    Parameters
    ----------
    clip : pybvh.Bvh
        The clip; it is not changed.

    Returns
    -------
    Motion
        With the clip's angles as its channel values.

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
            elder = siblings[: siblings.index(id(node))]
            before = sum(sibling in index for sibling in elder)
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
    turned = np.stack(
        [
            rotations.from_euler(angles[:, joint], skeleton.rotation_order(joint))
            for joint in range(skeleton.n_joints)
        ],
        axis=1,
    )
    placed = np.tile(skeleton.offsets, (len(angles), 1, 1))
    placed[:, 0] = clip.root_pos
    path = clip.source_path
    return Motion(
        skeleton,
        clip.frame_time,
        rotations.continuous_signs(turned),
        placed,
        np.hstack([clip.root_pos, np.degrees(angles).reshape(len(angles), -1)]),
        name="" if path is None else Path(path).stem,
        path=None if path is None else Path(path),
    )


def to_pybvh(motion: Motion) -> Any:  # noqa: ANN401 - pybvh has no types
    """Return the motion as a `pybvh.Bvh`.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    pybvh.Bvh
        With three rotation channels in every joint: those that the motion has, and then
        the axes that it lacks, at 0.

    Raises
    ------
    ImportError
        If pybvh is not installed.
    ValueError
        If a joint below the root is moved along, which pybvh cannot hold. A place that it
        keeps throughout becomes its offset.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> clip = to_pybvh(dance(strides=1).motion[:30])  # doctest: +SKIP
    >>> from_pybvh(clip).n_frames  # doctest: +SKIP
    30
    """
    pybvh = import_module("pybvh")
    nodes_of = import_module("pybvh.bvhnode")
    skeleton = motion.skeleton
    moved = np.ptp(motion.positions[:, 1:], axis=0).any(axis=-1)
    if moved.any():
        joint = int(moved.argmax()) + 1
        raise ValueError(
            f"only the root may be moved in pybvh, got a moving {skeleton.names[joint]}"
        )
    numbers = np.radians(motion.channel_numbers())
    angles = np.zeros((motion.n_frames, motion.n_joints, 3))
    nodes: list[Any] = []
    # Joint or end site, and the node above it: no recursion, however deep the chain.
    todo: list[tuple[int | EndSite, Any]] = [(0, None)]
    joints: list[int] = []
    while todo:
        item, above = todo.pop()
        if isinstance(item, EndSite):
            name = item.name or f"EndSite{above.name}"
            node = nodes_of.BvhEndSite(name, item.offset, above)
        else:
            order = skeleton.rotation_order(item)
            columns = skeleton.channel_columns[item]
            names = zip(skeleton.channels[item], columns, strict=True)
            turns = [column for name, column in names if name.endswith("rotation")]
            angles[:, len(joints), : len(order)] = numbers[:, turns]
            axes = [*order, *(axis for axis in "XYZ" if axis not in order)]
            if above is None:
                node = nodes_of.BvhRoot(
                    skeleton.names[item], skeleton.offsets[item], list("XYZ"), axes, [], None
                )
            else:
                place = motion.positions[0, item]
                node = nodes_of.BvhJoint(skeleton.names[item], place, axes, [], above)
            joints.append(item)
            todo += [(below, node) for below in reversed(skeleton.children_and_sites[item])]
        if above is not None:
            above.children.append(node)
        nodes.append(node)
    return pybvh.Bvh(
        nodes,
        motion.positions[:, 0].copy(),
        angles,
        motion.frame_time,
        source_path=None if motion.path is None else str(motion.path),
        warn_on_disagreement=False,
    )
