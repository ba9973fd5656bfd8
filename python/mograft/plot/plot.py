"""Pictures for papers and notebooks, with matplotlib: ``pip install 'mograft[plot]'``.

Each function draws into the axes that it is given, else into new ones, and returns them.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.clustering import linkage
from mograft.analysis.segmentation import gaussian, kinetic_energy, segment
from mograft.body.anatomy import anatomy
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model, up_axis
from mograft.config import Config
from mograft.io.figure import PALETTE
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.synthesis.graft import Graft
from mograft.viewing.scene import Row, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["PALETTE", "clusters", "dendrogram", "energy", "pca", "strip", "timeline"]


def strip(
    motion: Motion,
    poses: int = 12,
    *,
    groups: JointGroups | str | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw poses of a motion beside each other, equally far apart in time.

    Parameters
    ----------
    motion : Motion
        The motion.
    poses : int
        How many poses.
    groups : JointGroups or str, optional
        The joint groups to colour by, or the name of a preset. Default: trunk, arms, legs.
    ax : matplotlib Axes, optional
        Where to draw. Default: new axes.

    Returns
    -------
    matplotlib Axes
        With one unit per height of the figure; below each pose its frame. All poses are seen
        from where the figure looks in the first one.

    Raises
    ------
    ValueError
        If `poses` is below 1, or the groups do not fit.
    ImportError
        If matplotlib is not installed.

    Examples
    --------
    >>> from mograft import plot
    >>> from mograft.dancer import dance
    >>> axes = plot.strip(dance(strides=1).motion, 8)
    >>> len(axes.texts)
    8
    """
    if poses < 1:
        raise ValueError(f"poses must be 1 or more, got {poses}")
    frames = np.unique(np.linspace(0, motion.n_frames - 1, poses).round().astype(int))
    figure = Scene.of([motion], groups).figures[0]
    sideways, upright = _seen(motion, frames)
    parents = [*motion.skeleton.parents, *(site.parent for site in motion.skeleton.end_sites)]
    # What is above the joint that carries the body stands still in the world: no bone goes there.
    beyond, joint = set(), motion.locomotion_root()
    while joint >= 0:
        beyond.add(joint)
        joint = int(parents[joint])
    bones = [(node, int(p)) for node, p in enumerate(parents) if p >= 0 and node not in beyond]
    ends = sorted({end for bone in bones for end in bone})
    apart = 1.15 * max(float(np.ptp(sideways[:, ends], axis=1).max(initial=0.0)), 0.5)
    tall = max(float(upright.max()), 0.5) + 0.3
    axes = _axes(ax, (max(1.1 * len(frames), 3), max(1.1 * tall / apart, 1.0) + 0.2))
    owner = np.zeros(motion.n_joints, int)
    for index, joints in enumerate(figure.members.values()):
        owner[joints] = index
    labelled: set[int] = set()
    names = list(figure.members)
    for place, frame in enumerate(frames.tolist()):
        for node, parent in bones:
            group = int(owner[parent])
            axes.plot(
                sideways[place, [parent, node]] + place * apart,
                upright[place, [parent, node]],
                color=PALETTE[group % len(PALETTE)],
                linewidth=2.2,
                solid_capstyle="round",
                label=None if group in labelled else names[group],
            )
            labelled.add(group)
        axes.text(place * apart, -0.06, str(frame), ha="center", va="top", fontsize=8)
    axes.axhline(0, color="0.5", linewidth=0.6, zorder=0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(motion.name or "motion", loc="left", fontsize=10)
    axes.legend(loc="upper right", bbox_to_anchor=(1, 1.28), ncols=8, frameon=False, fontsize=8)
    return axes


def energy(motion: Motion, config: Config | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the kinetic energy of a motion and where it is cut.

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    config : Config, optional
        How it is cut.
    ax : matplotlib Axes, optional
        Where to draw. Default: new axes.

    Returns
    -------
    matplotlib Axes
        Time in seconds; the energy as measured, pale, and as smoothed, with a line at every
        cut and every second segment shaded.

    Raises
    ------
    ValueError
        If the motion has a single frame.
    ImportError
        If matplotlib is not installed.
    """
    config = Config() if config is None else config
    axes = _axes(ax, (10, 2.8))
    values = kinetic_energy(motion, omega=config.omega, inertia=config.inertia)
    smooth = gaussian(values, config.smoothing * motion.rate)
    time = np.arange(motion.n_frames) * motion.frame_time
    cut = segment(motion, config)
    bounds = np.append(cut.start, cut.stop[-1])
    for start, stop in zip(cut.start[::2], cut.stop[::2], strict=True):
        axes.axvspan(time[start], time[stop], color="0.5", alpha=0.13, linewidth=0)
    axes.plot(time, values, color="0.5", linewidth=0.8, label="measured")
    axes.plot(time, smooth, color=PALETTE[0], linewidth=1.4, label="smoothed")
    axes.plot(time[bounds], smooth[bounds], ".", color=PALETTE[1], markersize=4, label="cuts")
    axes.set_xlim(time[0], time[-1])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("kinetic energy")
    axes.set_title(f"{motion.name or 'motion'}: {len(cut)} segments", loc="left", fontsize=10)
    axes.legend(loc="upper right", fontsize=8)
    return axes


def pca(
    library: Library,
    group: str | None = None,
    components: tuple[int, int] = (1, 2),
    *,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the segments as points, coloured by cluster.

    Parameters
    ----------
    library : Library
        The segments.
    group : str, optional
        The joint group. Default: the base group.
    components : tuple of int
        The principal components across and up, from 1.
    ax : matplotlib Axes, optional
        Where to draw. Default: new axes.

    Returns
    -------
    matplotlib Axes
        Both axes to the same scale; clusters of one segment in grey.

    Raises
    ------
    ValueError
        If there is no such group or component, or nothing was compared in it.
    ImportError
        If matplotlib is not installed.
    """
    name, points, labels = _points(library, group)
    for component in components:
        if not 1 <= component <= points.shape[1]:
            raise ValueError(f"components must be 1 to {points.shape[1]}, got {component}")
    axes = _axes(ax, (6, 5))
    across, up = (points[:, component - 1] for component in components)
    sizes = np.bincount(labels)
    alone = sizes[labels] == 1
    axes.scatter(across[alone], up[alone], s=8, color="0.6", linewidths=0)
    colours = [_cluster_colour(label) for label in labels[~alone].tolist()]
    axes.scatter(across[~alone], up[~alone], s=14, c=colours, linewidths=0)
    # Colours cannot tell fifty clusters apart: the largest are numbered.
    for label in np.argsort(-sizes, kind="stable")[:12].tolist():
        if sizes[label] > 1:
            middle = np.median(points[labels == label], axis=0)
            axes.annotate(
                str(label),
                (middle[components[0] - 1], middle[components[1] - 1]),
                fontsize=8,
                ha="center",
                va="center",
                bbox={
                    "boxstyle": "round,pad=0.2",
                    "fc": axes.get_facecolor(),
                    "ec": "none",
                    "alpha": 0.75,
                },
            )
    own = library.embedding[name]
    share = np.zeros(len(points[0])) if own is None else own.variances / own.variances.sum()
    axes.set_xlabel(f"component {components[0]} ({100 * share[components[0] - 1]:.0f} %)")
    axes.set_ylabel(f"component {components[1]} ({100 * share[components[1] - 1]:.0f} %)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(
        f"{name}: {len(labels)} segments, {len(sizes)} clusters, {int(alone.sum())} of one",
        loc="left",
        fontsize=10,
    )
    return axes


def timeline(
    *items: Motion | Graft | Library | Scene,
    frames: tuple[int, int] | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the segments of each joint group along time, coloured by cluster.

    Parameters
    ----------
    *items : Motion, Graft, Library or Scene
        What to draw; each graft after its base.
    frames : tuple of int, optional
        First and last frame. Default: all.
    ax : matplotlib Axes, optional
        Where to draw. Default: new axes.

    Returns
    -------
    matplotlib Axes
        One line for each figure and group. Parts that were exchanged are hatched; numbers
        name the clusters where there is room.

    Raises
    ------
    TypeError, ValueError
        As for `mograft.view`, and if `frames` is empty.
    ImportError
        If matplotlib is not installed.
    """
    figures = Scene.of(items).figures
    lines = [(figure, row) for figure in figures for row in figure.rows]
    longest = max(figure.motion.n_frames for figure in figures) - 1
    first, last = (0, longest) if frames is None else frames
    if not first < last:
        raise ValueError(f"frames must be a first and a later last one, got {frames}")
    axes = _axes(ax, (10, 0.5 + 0.32 * max(len(lines), 1)))
    width = axes.get_position().width * _figure(axes).get_figwidth()
    for height, (_, row) in enumerate(lines):
        _draw_row(axes, row, height, (first, last), width)
    axes.set_yticks(
        range(len(lines)), [f"{figure.name} · {row.group}" for figure, row in lines], fontsize=8
    )
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.set_xlim(first, last)
    axes.set_xlabel("frame")
    axes.tick_params(axis="y", length=0)
    for side in ("top", "left", "right"):
        axes.spines[side].set_visible(False)
    return axes


def dendrogram(library: Library, group: str | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the tree of complete linkage and where it is cut.

    Parameters
    ----------
    library : Library
        The segments.
    group : str, optional
        The joint group. Default: the base group.
    ax : matplotlib Axes, optional
        Where to draw. Default: new axes.

    Returns
    -------
    matplotlib Axes
        Segments across, the diameter at which clusters merge upwards. Below the line of the
        cut the branches have the colours of their clusters.

    Raises
    ------
    ValueError
        If there is no such group, or nothing was compared in it.
    ImportError
        If matplotlib is not installed.
    """
    name, points, labels = _points(library, group)
    axes = _axes(ax, (10, 4))
    tree = linkage(points)
    n = len(points)
    sigma = library.sigma[name]
    at = np.zeros(2 * n - 1)
    at[_leaves(tree, n)] = np.arange(n)
    height = np.concatenate([np.zeros(n), tree[:, 2]])
    owner = np.concatenate([labels, np.full(n - 1, -1)])
    by_colour: dict[str, list[FloatArray]] = {}
    for merge, (left, right) in enumerate(tree[:, :2].astype(int).tolist()):
        node = n + merge
        at[node] = 0.5 * (at[left] + at[right])
        if height[node] <= sigma:
            owner[node] = owner[left]
        colour = "0.45" if owner[node] < 0 else _cluster_colour(int(owner[node]))
        ends = np.array([at[left], at[left], at[right], at[right]])
        heights = np.array([height[left], height[node], height[node], height[right]])
        by_colour.setdefault(colour, []).append(np.stack([ends, heights], axis=1))
    from matplotlib.collections import LineCollection

    for colour, branches in by_colour.items():
        axes.add_collection(LineCollection(branches, colors=colour, linewidths=0.9))
    axes.axhline(sigma, color=PALETTE[1], linewidth=1, linestyle="--")
    axes.set_xlim(-1, n)
    axes.set_ylim(0, 1.05 * float(tree[-1, 2]))
    axes.set_xticks([])
    axes.set_xlabel(f"{n} segments")
    axes.set_ylabel("diameter")
    cut_into = f"{name}: cut at {sigma:.3g} into {int(labels.max()) + 1} clusters"
    axes.set_title(cut_into, loc="left", fontsize=10)
    return axes


def clusters(library: Library, group: str | None = None, *, ax: "Axes | None" = None) -> "Axes":
    """Draw how large the clusters are.

    Parameters
    ----------
    library : Library
        The segments.
    group : str, optional
        The joint group. Default: the base group.
    ax : matplotlib Axes, optional
        Where to draw. Default: new axes.

    Returns
    -------
    matplotlib Axes
        Clusters from the largest to the smallest, by number of segments; what is alone can
        lend its place to no other.

    Raises
    ------
    ValueError
        If there is no such group.
    ImportError
        If matplotlib is not installed.
    """
    name, labels = _labels(library, group)
    axes = _axes(ax, (8, 3))
    sizes = np.bincount(labels)
    order = np.argsort(-sizes, kind="stable")
    colours = [_cluster_colour(label) for label in order.tolist()]
    axes.bar(np.arange(len(order)), sizes[order], width=0.9, color=colours)
    axes.set_xlim(-0.6, len(order) - 0.4)
    axes.set_xlabel("cluster, largest first")
    axes.set_ylabel("segments")
    alone = int((sizes == 1).sum())
    axes.set_title(
        f"{name}: {len(sizes)} clusters, {alone} of one segment", loc="left", fontsize=10
    )
    if len(order) <= 40:
        axes.set_xticks(range(len(order)), [str(label) for label in order.tolist()], fontsize=7)
    else:
        axes.set_xticks([])
    return axes


def _axes(given: "Axes | None", size: tuple[float, float]) -> "Axes":
    if given is not None:
        return given
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError(
            "plots need matplotlib: pip install 'mograft[plot]'", name="matplotlib"
        ) from error
    axes: Axes = pyplot.subplots(figsize=size, layout="constrained")[1]
    return axes


def _figure(axes: "Axes") -> "Figure":
    figure = axes.get_figure(root=True)
    if figure is None:
        raise ValueError("ax must belong to a figure")
    return figure


def _seen(motion: Motion, frames: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return nodes as seen a little from the side of where the figure looks, in heights."""
    skeleton = motion.skeleton
    part = motion[int(frames[0]) : int(frames[-1]) + 1]
    turns, joints = part.world_transforms()
    picked = frames - frames[0]
    turns, joints = turns[picked], joints[picked]
    sites = [
        joints[:, s.parent] + rotations.rotate(turns[:, s.parent], s.offset)
        for s in skeleton.end_sites
    ]
    nodes = np.concatenate([joints, *(s[:, None] for s in sites)], axis=1)
    known = mass_model(skeleton)
    up = up_axis(motion)
    level = [axis for axis in range(3) if axis != up]
    feet = [foot.ankle for foot in known.feet]
    thighs = [anatomy(skeleton).joints("thigh", side=side) for side in ("left", "right")]
    across = np.eye(3)[level[0]]
    if all(thighs):
        across = nodes[0, thighs[0][0]] - nodes[0, thighs[1][0]]
    across = across[level]
    across = across / (np.linalg.norm(across) or 1.0)
    turn = np.radians(35)
    ahead = np.array([-across[1], across[0]])
    view = np.cos(turn) * across + np.sin(turn) * ahead
    middle = nodes[:, [known.hips]]
    sideways = (nodes - middle)[..., level] @ view
    upright = nodes[..., up]
    if known.head is not None and feet and upright[0, known.head] < upright[0, feet].mean():
        upright = -upright
    upright = upright - upright.min()
    return sideways / known.height, upright / known.height


def _labels(library: Library, group: str | None) -> tuple[str, IntArray]:
    name = library.groups.base if group is None else group
    if name not in library.labels:
        raise ValueError(f"group must be one of {', '.join(library.labels)}, got {name!r}")
    return name, library.labels[name]


def _points(library: Library, group: str | None) -> tuple[str, FloatArray, IntArray]:
    name, labels = _labels(library, group)
    own = library.embedding[name]
    if own is None or len(own.points) < 2:
        raise ValueError(f"group {name!r} must have segments that were compared, has none")
    # A base that was added for a graft has labels but no points.
    return name, own.points, labels[: len(own.points)]


def _cluster_colour(cluster: int) -> str:
    """Return a colour by the golden angle, as the pages do."""
    import colorsys

    red, green, blue = colorsys.hls_to_rgb(((cluster * 137.508 + 200) % 360) / 360, 0.6, 0.55)
    return "#" + "".join(f"{round(255 * value):02x}" for value in (red, green, blue))


def _draw_row(axes: "Axes", row: Row, height: int, frames: tuple[int, int], width: float) -> None:
    first, last = frames
    exchanged = row.exchanged if len(row.exchanged) else np.zeros(len(row.start), bool)
    for part in np.flatnonzero((row.stop > first) & (row.start < last)).tolist():
        start, length = int(row.start[part]), int(row.stop[part] - row.start[part])
        cluster = int(row.cluster[part])
        bar: dict[str, Any] = {"hatch": "//////"} if exchanged[part] else {}
        axes.broken_barh(
            [(start, length)],
            (height - 0.4, 0.8),
            facecolor="0.75" if cluster < 0 else _cluster_colour(cluster),
            edgecolor="white",
            linewidth=0.8,
            **bar,
        )
        inches = length / (last - first) * width
        if cluster >= 0 and inches > 0.07 * len(str(cluster)) + 0.05:
            axes.text(
                start + 0.5 * length,
                height,
                str(cluster),
                ha="center",
                va="center",
                fontsize=7,
                color="black",
                clip_on=True,
                bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.6},
            )


def _leaves(tree: FloatArray, n: int) -> list[int]:
    """Return the points from left to right, so that no branches cross."""
    order: list[int] = []
    todo = [2 * n - 2]
    while todo:
        node = todo.pop()
        if node < n:
            order.append(node)
        else:
            left, right = tree[node - n, :2].astype(int).tolist()
            todo += [right, left]
    return order
