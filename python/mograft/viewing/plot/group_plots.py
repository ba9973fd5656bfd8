"""Discovered joint groups: the linkage tree of chains of joints beside the figure."""

from typing import TYPE_CHECKING

import numpy as np

from mograft._standalone.mograft_linkage.dendrogram import leaves_list
from mograft._util.arrays import IntArray
from mograft.analysis.group_discovery import GroupDiscovery
from mograft.io.palette import PALETTE
from mograft.motion.skeleton import Skeleton
from mograft.viewing.plot.figure_axes import ensure_two_axes
from mograft.viewing.plot.pose_strip import strip

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def groups(
    discovery: GroupDiscovery, *, axes: "tuple[Axes, Axes] | None" = None
) -> "tuple[Axes, Axes]":
    """Draw the linkage tree of chains of joints, and beside it a pose in the colours of the groups.

    Parameters
    ----------
    discovery : GroupDiscovery
        The result of `mograft.discover_groups`.
    axes : tuple of matplotlib Axes, optional
        Axes of the tree and of the pose. Default: new axes, side by side.

    Returns
    -------
    tuple of matplotlib Axes
        The axes of the tree and of the pose. The chains are on the vertical axis of the tree, with
        the base group at the top. The horizontal axis is the distance at which
        chains merge: 1 minus their smallest dependence. A dashed line separates the merges within
        groups from the others.

    Examples
    --------
    >>> from mograft import discover_groups, plot
    >>> from mograft.dancer import dance
    >>> tree, pose = plot.groups(discover_groups(dance(strides=2).motion, 3))
    >>> [label.get_text() for label in tree.get_yticklabels()]
    ['Hips ... RightFoot', 'LeftShoulder ... RightHand', 'Spine', 'Neck ... Head']
    """
    tree_axes, pose_axes = ensure_two_axes(axes, (10, 4))
    _draw_tree(discovery, tree_axes)
    strip(discovery.pose, 1, groups=discovery.groups, ax=pose_axes)
    pose_axes.texts[-1].remove()  # the number of the only frame
    pose_axes.set_title("", loc="left")
    return tree_axes, pose_axes


def _draw_tree(discovery: GroupDiscovery, axes: "Axes") -> None:
    """Draw the linkage tree from left to right."""
    tree, labels, n = discovery.tree, discovery.labels, len(discovery.units)
    order = leaves_list(tree)
    places = np.zeros(2 * n - 1)
    places[order] = np.arange(n)
    heights = np.concatenate([np.zeros(n), tree[:, 2]])
    group = np.concatenate([labels, np.full(n - 1, -1)])
    for node, (left, right) in enumerate(tree[:, :2].astype(int).tolist(), start=n):
        places[node] = 0.5 * (places[left] + places[right])
        if group[left] == group[right]:
            group[node] = group[left]
        colour = "0.45" if group[node] < 0 else PALETTE[int(group[node]) % len(PALETTE)]
        across = [heights[left], heights[node], heights[node], heights[right]]
        along = [places[left], places[left], places[right], places[right]]
        axes.plot(across, along, color=colour, linewidth=1.6, solid_capstyle="round")
    n_groups = int(labels.max()) + 1
    bounds = np.concatenate([[0.0], tree[:, 2]])[n - n_groups : n - n_groups + 2]
    axes.axvline(float(bounds.mean()), color="0.5", linewidth=1, linestyle="--")
    axes.set_yticks(
        range(n), [_unit_label(discovery.pose.skeleton, discovery.units[u]) for u in order]
    )
    for text, unit in zip(axes.get_yticklabels(), order.tolist(), strict=True):
        text.set_color(PALETTE[int(labels[unit]) % len(PALETTE)])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.02)
    axes.set_xlabel("1 - dependence")
    axes.set_title(f"{n_groups} groups of {n} chains", loc="left", fontsize=10)


def _unit_label(skeleton: Skeleton, joints: IntArray) -> str:
    """Return the names of the first and the last joint of a chain."""
    first, last = skeleton.names[joints[0]], skeleton.names[joints[-1]]
    return first if len(joints) == 1 else f"{first} ... {last}"
