"""Segments of a library as points and as a linkage tree."""

from typing import TYPE_CHECKING

import numpy as np

from mograft._standalone.mograft_linkage import linkage
from mograft._standalone.mograft_linkage.dendrogram import leaves_list
from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Embedding
from mograft.body.groups import suggest_groups
from mograft.io.export_figure import PALETTE
from mograft.library.library import Library
from mograft.viewing.plot.motion_plots import cluster_colour, ensure_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_NUMBERED_CLUSTERS = 12


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
    box = {"boxstyle": "round,pad=0.2", "fc": axes.get_facecolor(), "ec": "none", "alpha": 0.75}
    for label in np.argsort(-sizes, kind="stable")[:_MAX_NUMBERED_CLUSTERS].tolist():
        if sizes[label] > 1:
            middle = (np.median(x[labels == label]), np.median(y[labels == label]))
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
    n = len(labels)
    place = np.zeros(2 * n - 1)
    place[leaves_list(tree)] = np.arange(n)
    height = np.concatenate([np.zeros(n), tree[:, 2]])
    cluster = np.concatenate([labels, np.full(n - 1, -1)])
    branches: dict[str, list[FloatArray]] = {}
    for node, (left, right) in enumerate(tree[:, :2].astype(int).tolist(), start=n):
        place[node] = 0.5 * (place[left] + place[right])
        if cluster[left] == cluster[right]:
            cluster[node] = cluster[left]
        ends = [left, left, right, right], [left, node, node, right]
        colour = "0.45" if cluster[node] < 0 else cluster_colour(int(cluster[node]))
        corners = np.stack([place[ends[0]], height[ends[1]]], axis=1)
        branches.setdefault(colour, []).append(corners)
    for colour, lines in branches.items():
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.9))
    axes.axhline(threshold, color=PALETTE[1], linewidth=1, linestyle="--")
    axes.set(xlim=(-1, len(points)), ylim=(0, 1.05 * float(tree[-1, 2])), xticks=[])
    axes.set(xlabel=f"{len(points)} segments", ylabel="diameter")
    n_clusters = int(labels.max()) + 1
    title = f"{name}: {n_clusters} clusters of diameter {threshold:.3g} at most"
    axes.set_title(title, loc="left", fontsize=10)
    return axes


def _embedding(library: Library, group: str | None) -> tuple[str, Embedding, IntArray]:
    """Return the name of a group, its embedding, and the cluster of each point in the embedding.

    The default group is the base group. Raise ValueError if the library has no such group, or the
    group has no embedding.
    """
    name = library.groups.base if group is None else group
    if name not in library.labels:
        hint = suggest_groups(name, library.labels)
        raise ValueError(f"`group` must be one of {', '.join(library.labels)}, got {name!r}{hint}")
    embedding = library.embedding[name]
    if embedding is None or len(embedding.points) < 2:
        raise ValueError(
            f"group {name!r} has no embedding, which requires at least three different segments"
        )
    # The segments of a base that was added for a graft have labels, but no points.
    return name, embedding, library.labels[name][: len(embedding.points)]
