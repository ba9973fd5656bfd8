"""Poses of a motion beside each other."""

from typing import TYPE_CHECKING

import numpy as np

from mograft.body.groups import JointGroups
from mograft.io.export_figure import PALETTE
from mograft.motion.motion import Motion
from mograft.viewing.geometry import Camera, DrawnSkeleton, front_yaw
from mograft.viewing.plot.figure_axes import ensure_axes
from mograft.viewing.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VIEW_DEGREES = -35.0


def strip(
    motion: Motion,
    poses: int = 12,
    *,
    groups: JointGroups | str | None = None,
    frames: tuple[int, int] | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw poses of a motion at equal time intervals, side by side.

    Parameters
    ----------
    motion : Motion
        The motion.
    poses : int
        Number of poses.
    groups : JointGroups or str, optional
        Joint groups that set the colours, or the name of a preset. Default: trunk, arms and
        legs.
    frames : tuple of int, optional
        First and last frame to draw. Default: all.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes, whose unit is the body height. The number of the frame is below each pose. All
        poses are seen from the same direction, from the front of the first pose and 35 degrees
        to its side.

    Raises
    ------
    ValueError
        If `poses` is below 1, the groups do not fit, or `frames` are not frames of the motion.

    Examples
    --------
    >>> from mograft import plot
    >>> from mograft.dancer import dance
    >>> axes = plot.strip(dance(strides=1).motion, 8)
    >>> len(axes.texts)
    8
    """
    if poses < 1:
        raise ValueError(f"`poses` must be at least 1, got {poses}")
    first, last = (0, motion.n_frames - 1) if frames is None else frames
    if not 0 <= first <= last < motion.n_frames:
        raise ValueError(
            f"`frames` must be ascending within 0 to {motion.n_frames - 1}, got {first} to {last}"
        )
    drawn = np.unique(np.linspace(first, last, poses).round().astype(int))
    figure = Scene.of([motion], groups).figures[0]
    skeleton = DrawnSkeleton.of(motion[first : last + 1])
    nodes = skeleton.positions[drawn - first] / skeleton.height
    camera = Camera(front_yaw(motion.skeleton, nodes[0]) + np.radians(_VIEW_DEGREES))
    sideways, upright, _ = camera.project(nodes - nodes[:, [skeleton.root]])
    upright = upright + nodes[:, [skeleton.root], 1] - nodes[..., 1].min()
    bones = [(node, parent) for node, parent in enumerate(skeleton.parents) if parent >= 0]
    ends = sorted({end for bone in bones for end in bone})
    spacing = 1.15 * max(float(np.ptp(sideways[:, ends], axis=1).max(initial=0.0)), 0.5)
    height = max(float(upright.max()), 0.5) + 0.3
    size = (max(1.1 * len(drawn), 3), max(1.1 * height / spacing, 1.0) + 0.2)
    axes = ensure_axes(ax, size)
    group_of_node, names = figure.group_of_nodes(skeleton.parents), list(figure.members)
    labelled: set[int] = set()
    for pose, frame in enumerate(drawn.tolist()):
        for node, parent in bones:
            group = group_of_node[parent]
            axes.plot(
                sideways[pose, [parent, node]] + pose * spacing,
                upright[pose, [parent, node]],
                color=PALETTE[group % len(PALETTE)],
                linewidth=2.2,
                solid_capstyle="round",
                label=None if group in labelled else names[group],
            )
            labelled.add(group)
        axes.text(pose * spacing, -0.06, str(frame), ha="center", va="top", fontsize=8)
    axes.axhline(0, color="0.5", linewidth=0.6, zorder=0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(motion.name or "motion", loc="left", fontsize=10)
    axes.legend(loc="upper right", bbox_to_anchor=(1, 1.28), ncols=8, frameon=False, fontsize=8)
    return axes
