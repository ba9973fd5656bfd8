"""Poses side by side, kinetic energy and segments along time; axes and colours of all pictures."""

import colorsys
from typing import TYPE_CHECKING, Any

import numpy as np

from mograft._util.extras import import_extra
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import kinetic_energy, segment
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.io.export_figure import PALETTE
from mograft.motion.motion import Motion
from mograft.viewing.figure import TimelineRow
from mograft.viewing.geometry import DrawnSkeleton, front_yaw, project
from mograft.viewing.scene import Item, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GOLDEN_ANGLE_DEGREES = 137.508
_VIEW_DEGREES = -35.0
_NUMBER_STYLE: dict[str, Any] = {
    "bbox": {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.6}
} | {"ha": "center", "va": "center", "fontsize": 7, "color": "black", "clip_on": True}
"""Of the numbers of clusters in a timeline."""


def ensure_axes(ax: "Axes | None", size: tuple[float, float]) -> "Axes":
    """Return `ax`, or if it is None the axes of a new figure with a given size in inches.

    Raise an ImportError with the remedy if Matplotlib is not installed.
    """
    if ax is not None:
        return ax
    import_extra("matplotlib", "plots need matplotlib", "plot")
    from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="constrained")[1]


def cluster_colour(cluster: int) -> str:
    """Return the colour of a cluster; the hues of successive clusters are a golden angle apart."""
    hue = ((cluster * _GOLDEN_ANGLE_DEGREES + 200) % 360) / 360
    rgb = colorsys.hls_to_rgb(hue, 0.6, 0.55)
    return "#" + "".join(f"{round(255 * value):02x}" for value in rgb)


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
    yaw = front_yaw(motion.skeleton, nodes[0]) + np.radians(_VIEW_DEGREES)
    sideways, upright, _ = project(nodes - nodes[:, [skeleton.root]], yaw)
    upright = upright + nodes[:, [skeleton.root], 1] - nodes[..., 1].min()
    bones = [[node, parent] for node, parent in enumerate(skeleton.parents) if parent >= 0]
    ends = sorted({end for bone in bones for end in bone}) or [skeleton.root]
    spacing = 1.15 * max(float(np.ptp(sideways[:, ends], axis=1).max(initial=0.0)), 0.5)
    height = max(float(upright.max()), 0.5) + 0.3
    size = (max(1.1 * len(drawn), 3), max(1.1 * height / spacing, 1.0) + 0.2)
    axes = ensure_axes(ax, size)
    group_of_node = figure.group_of_nodes(skeleton.parents)
    labels: dict[int, str | None] = dict(enumerate(figure.members))
    line: dict[str, Any] = {"linewidth": 2.2, "solid_capstyle": "round"}
    for pose, frame in enumerate(drawn.tolist()):
        for bone in bones:
            group = group_of_node[bone[1]]
            x, y = sideways[pose, bone[::-1]] + pose * spacing, upright[pose, bone[::-1]]
            colour, label = PALETTE[group % len(PALETTE)], labels.pop(group, None)
            axes.plot(x, y, color=colour, label=label, **line)
        axes.text(pose * spacing, -0.06, str(frame), ha="center", va="top", fontsize=8)
    axes.axhline(0, color="0.5", linewidth=0.6, zorder=0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(motion.name or "motion", loc="left", fontsize=10)
    if bones:
        axes.legend(loc="upper right", bbox_to_anchor=(1, 1.28), ncols=8, frameon=False, fontsize=8)
    return axes


def energy(
    motion: Motion,
    config: Config | None = None,
    *,
    frames: tuple[int, int] | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the kinetic energy of a motion and the boundaries of its segments.

    Parameters
    ----------
    motion : Motion
        The motion, of at least two frames.
    config : Config, optional
        Parameters of the segmentation.
    frames : tuple of int, optional
        First and last frame that the axes show; the first must be a frame of the motion. Energy
        and segments are those of the whole motion. Default: all.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes, with time in seconds on the horizontal axis. The energy before smoothing is grey,
        after smoothing coloured. A point marks each segment boundary, and every second segment is
        shaded.

    Raises
    ------
    ValueError
        If the motion has a single frame, or the first of `frames` is not before the last or not
        a frame of the motion.
    """
    config = Config() if config is None else config
    axes = ensure_axes(ax, (10, 2.8))
    values = kinetic_energy(motion, omega=config.omega, inertia=config.inertia)
    smooth = gaussian_filter(values, config.smoothing * motion.rate)
    time = np.arange(motion.n_frames) * motion.frame_time
    segments = segment(motion, config)
    first, last = _shown_frames(frames, motion.n_frames)
    bounds = np.append(segments.start, segments.stop[-1])
    for start, stop in zip(segments.start[::2], segments.stop[::2], strict=True):
        axes.axvspan(time[start], time[stop], color="0.5", alpha=0.13, linewidth=0)
    axes.plot(time, values, color="0.5", linewidth=0.8, label="measured")
    axes.plot(time, smooth, color=PALETTE[0], linewidth=1.4, label="smoothed")
    x, y = time[bounds], smooth[bounds]
    axes.plot(x, y, ".", color=PALETTE[1], markersize=4, label="segment boundaries")
    limits = (first * motion.frame_time, last * motion.frame_time)
    top = 1.05 * max(float(values[first : last + 1].max()), 1e-9)
    axes.set(xlim=limits, ylim=(0, top), xlabel="time (s)", ylabel="kinetic energy")
    axes.set_title(f"{motion.name or 'motion'}: {len(segments)} segments", loc="left", fontsize=10)
    axes.legend(loc="upper right", fontsize=8)
    return axes


def timeline(
    *items: Item, frames: tuple[int, int] | None = None, ax: "Axes | None" = None
) -> "Axes":
    """Draw the segments of each joint group along time, coloured by cluster.

    Parameters
    ----------
    *items : Motion, Graft, Library, Scene, or address of motions
        What to draw. The base of a graft is drawn above the graft. A file beside which ``mograft
        graft`` wrote a .json file is drawn as a graft without clusters: the clip of the donor
        colours each exchanged segment, and other segments are grey.
    frames : tuple of int, optional
        First and last frame that the axes show; the first must be a frame of the longest motion.
        Default: all.
    ax : matplotlib Axes, optional
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        The axes, with one row of bars per motion and joint group. Exchanged segments are hatched.
        Bars that are long enough show the number of their cluster.

    Raises
    ------
    TypeError, ValueError
        As for `mograft.view`, and if the first of `frames` is not before the last or not a frame
        of the longest motion.
    """
    figures = Scene.of(items).figures
    lines = [(figure, row) for figure in figures for row in figure.rows]
    first, last = _shown_frames(frames, max(figure.motion.n_frames for figure in figures))
    axes = ensure_axes(ax, (10, 0.5 + 0.32 * max(len(lines), 1)))
    canvas = axes.get_figure(root=True)
    if canvas is None:
        raise ValueError("`ax` must belong to a figure")
    inches_per_frame = axes.get_position().width * canvas.get_figwidth() / (last - first)
    for height, (_, row) in enumerate(lines):
        _draw_row(axes, row, height, (first, last), inches_per_frame)
    labels = [f"{figure.name} · {row.group}" for figure, row in lines]
    axes.set_yticks(range(len(lines)), labels, fontsize=8)
    axes.set(xlim=(first, last), ylim=(len(lines) - 0.4, -0.6), xlabel="frame")
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "left", "right"]].set_visible(False)
    return axes


def _shown_frames(frames: tuple[int, int] | None, n_frames: int) -> tuple[int, int]:
    """Return the first and last frame that axes show, by default all of `n_frames` frames."""
    first, last = (0, n_frames - 1) if frames is None else frames
    if not (first < last and 0 <= first < n_frames):
        raise ValueError(
            f"`frames` must be two ascending numbers, the first within 0-{n_frames - 1}, "
            f"got {(first, last)}"
        )
    return first, last


def _draw_row(
    axes: "Axes", row: TimelineRow, height: int, frames: tuple[int, int], inches_per_frame: float
) -> None:
    first, last = frames
    clips = sorted({clip for clip in row.parts["clip"] if clip is not None})
    columns = (row.parts[name] for name in ("start", "stop", "cluster", "clip", "is_exchanged"))
    for start, stop, cluster, clip, is_exchanged in zip(*columns, strict=True):
        if stop <= first or start >= last:
            continue
        # Without clusters, the colour of an exchanged segment is that of the clip of its donor.
        colour = clips.index(clip) if cluster < 0 and is_exchanged else cluster
        style: dict[str, Any] = {"hatch": "//////"} if is_exchanged else {}
        style |= {"facecolor": "0.75" if colour < 0 else cluster_colour(colour)}
        style |= {"edgecolor": "white", "linewidth": 0.8}
        axes.broken_barh([(start, stop - start)], (height - 0.4, 0.8), **style)
        if cluster >= 0 and (stop - start) * inches_per_frame > 0.07 * len(str(cluster)) + 0.05:
            axes.text(start + 0.5 * (stop - start), height, str(cluster), **_NUMBER_STYLE)
