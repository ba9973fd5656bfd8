"""Segments of a library as points, linkage tree and cluster sizes; trees of joint groups."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mograft._standalone.mograft_linkage import linkage
from mograft._standalone.mograft_linkage.dendrogram import leaves_list
from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Embedding
from mograft.analysis.group_discovery import GroupDiscovery
from mograft.body.groups import suggest_groups
from mograft.io.export_figure import PALETTE
from mograft.library.library import Library
from mograft.motion.skeleton import Skeleton
from mograft.viewing.plot.motion_plots import cluster_colour, ensure_axes, new_axes, strip

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_NUMBERED_CLUSTERS = 12
_MAX_TICKS = 40


def pca(library: Library, group: str | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the segments as points in the first two principal components, coloured by cluster.

    Parameters
    ----------
    library : Library
        The library whose segments are drawn.
    group : str, optional
        The joint group. Default: the base group.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes, with equal scales. Segments that are alone in their cluster are grey. The numbers
        of the twelve largest clusters are shown.

    Raises
    ------
    ValueError
        If the group does not exist or has no embedding of two components.
    """
    name, embedding, labels = _embedding(library, group)
    points = embedding.points
    if points.shape[1] < 2:
        raise ValueError(f"group {name!r} must have two principal components, got 1")
    axes = ensure_axes(ax, (6, 5))
    x, y = points[:, :2].T
    sizes = np.bincount(labels)
    is_single = sizes[labels] == 1
    axes.scatter(x[is_single], y[is_single], s=8, color="0.6", linewidths=0)
    colours = [cluster_colour(label) for label in labels[~is_single].tolist()]
    axes.scatter(x[~is_single], y[~is_single], s=14, c=colours, linewidths=0)
    background = {"boxstyle": "round,pad=0.2", "fc": axes.get_facecolor(), "ec": "none"}
    for label in np.argsort(-sizes, kind="stable")[:_MAX_NUMBERED_CLUSTERS].tolist():
        if sizes[label] > 1:
            middle = (np.median(x[labels == label]), np.median(y[labels == label]))
            box = background | {"alpha": 0.75}
            axes.annotate(str(label), middle, fontsize=8, ha="center", va="center", bbox=box)
    share = embedding.variances / embedding.variances.sum()
    axes.set_xlabel(f"component 1 ({100 * share[0]:.0f} %)")
    axes.set_ylabel(f"component 2 ({100 * share[1]:.0f} %)")
    axes.set_aspect("equal", adjustable="datalim")
    counts = f"{len(labels)} segments, {len(sizes)} clusters, {int(is_single.sum())} of one segment"
    axes.set_title(f"{name}: {counts}", loc="left", fontsize=10)
    return axes


def dendrogram(library: Library, group: str | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the complete-linkage tree of the segments and the cluster diameter threshold.

    Parameters
    ----------
    library : Library
        The library whose segments are drawn.
    group : str, optional
        The joint group. Default: the base group.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes. The segments are on the horizontal axis, and the diameter at which clusters merge
        is on the vertical axis. The threshold is a dashed line. Branches below it have the colours
        of their clusters.

    Raises
    ------
    ValueError
        If the group does not exist or has no embedding.
    """
    name, embedding, labels = _embedding(library, group)
    points = embedding.points
    axes = ensure_axes(ax, (10, 4))
    from matplotlib.collections import LineCollection

    tree = linkage(points)
    threshold = library.sigma[name]
    branches: dict[str, list[FloatArray]] = {}
    for cluster, corners in _branches(tree, labels):
        colour = "0.45" if cluster < 0 else cluster_colour(cluster)
        branches.setdefault(colour, []).append(corners)
    for colour, lines in branches.items():
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.9))
    axes.axhline(threshold, color=PALETTE[1], linewidth=1, linestyle="--")
    axes.set_xlim(-1, len(points))
    axes.set_ylim(0, 1.05 * float(tree[-1, 2]))
    axes.set_xticks([])
    axes.set_xlabel(f"{len(points)} segments")
    axes.set_ylabel("diameter")
    n_clusters = int(labels.max()) + 1
    title = f"{name}: {n_clusters} clusters of diameter {threshold:.3g} at most"
    axes.set_title(title, loc="left", fontsize=10)
    return axes


def _branches(tree: FloatArray, labels: IntArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield the cluster of each branch of a linkage tree, and its corners; -1 between clusters.

    `labels` has the cluster of each leaf. The corners, shape (4, 2), are positions along the leaves
    and heights.
    """
    n = len(labels)
    place = np.zeros(2 * n - 1)
    place[leaves_list(tree)] = np.arange(n)
    height = np.concatenate([np.zeros(n), tree[:, 2]])
    cluster = np.concatenate([labels, np.full(n - 1, -1)])
    for node, (left, right) in enumerate(tree[:, :2].astype(int).tolist(), start=n):
        place[node] = 0.5 * (place[left] + place[right])
        if cluster[left] == cluster[right]:
            cluster[node] = cluster[left]
        ends = [left, left, right, right], [left, node, node, right]
        yield int(cluster[node]), np.stack([place[ends[0]], height[ends[1]]], axis=1)


def clusters(library: Library, group: str | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the sizes of the clusters as bars.

    Parameters
    ----------
    library : Library
        The library whose clusters are drawn.
    group : str, optional
        The joint group. Default: the base group.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes. The height of a bar is the number of segments in a cluster; the largest cluster
        is first. If `Config.neighbourhood` is "cluster", no other segment can replace a segment
        that is alone in its cluster of the base group.

    Raises
    ------
    ValueError
        If the group does not exist.
    """
    name, labels = group_labels(library, group)
    axes = ensure_axes(ax, (8, 3))
    sizes = np.bincount(labels)
    order = np.argsort(-sizes, kind="stable")
    colours = [cluster_colour(label) for label in order.tolist()]
    axes.bar(np.arange(len(order)), sizes[order], width=0.9, color=colours)
    axes.set_xlim(-0.6, len(order) - 0.4)
    axes.set_xlabel("cluster, largest first")
    axes.set_ylabel("segments")
    counts = f"{len(sizes)} clusters, {int((sizes == 1).sum())} of one segment"
    axes.set_title(f"{name}: {counts}", loc="left", fontsize=10)
    ticks = order.tolist() if len(order) <= _MAX_TICKS else []
    axes.set_xticks(range(len(ticks)), [str(label) for label in ticks], fontsize=7)
    return axes


def group_labels(library: Library, group: str | None) -> tuple[str, IntArray]:
    """Return the name of a group and the cluster of each segment; the default is the base group.

    Raise ValueError if the library has no such group.
    """
    name = library.groups.base if group is None else group
    if name not in library.labels:
        hint = suggest_groups(name, library.labels)
        raise ValueError(f"`group` must be one of {', '.join(library.labels)}, got {name!r}{hint}")
    return name, library.labels[name]


def _embedding(library: Library, group: str | None) -> tuple[str, Embedding, IntArray]:
    """Return the name of a group, its embedding, and the cluster of each point in the embedding.

    The default group is the base group.
    """
    name, labels = group_labels(library, group)
    embedding = library.embedding[name]
    if embedding is None or len(embedding.points) < 2:
        raise ValueError(
            f"group {name!r} has no embedding, which requires at least three different segments"
        )
    # The segments of a base that was added for a graft have labels, but no points.
    return name, embedding, labels[: len(embedding.points)]


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
    tree_axes, pose_axes = axes or new_axes((10, 4), 1, 2, gridspec_kw={"width_ratios": [2, 1]})
    _draw_tree(discovery, tree_axes)
    strip(discovery.pose, 1, groups=discovery.groups, ax=pose_axes)
    pose_axes.texts[-1].remove()  # the number of the only frame
    pose_axes.set_title("", loc="left")
    return tree_axes, pose_axes


def _draw_tree(discovery: GroupDiscovery, axes: "Axes") -> None:
    """Draw the linkage tree from left to right."""
    tree, labels, n = discovery.tree, discovery.labels, len(discovery.units)
    order = leaves_list(tree)
    for group, corners in _branches(tree, labels):
        colour = "0.45" if group < 0 else PALETTE[group % len(PALETTE)]
        along, across = corners.T
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
