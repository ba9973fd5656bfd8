"""Segments along time, coloured by cluster."""

from typing import TYPE_CHECKING, Any

import numpy as np

from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.plot.figure_axes import axes_width, cluster_colour, ensure_axes
from mograft.synthesis.graft_result import Graft
from mograft.viewing.scene import Scene, TimelineRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["timeline"]


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
        Axes to draw into. Default: new axes.

    Returns
    -------
    matplotlib Axes
        One row of bars per motion and joint group. Exchanged segments are hatched. Segments
        show their cluster number if there is room for it.

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
        raise ValueError(f"`frames` must be ascending, got {frames}")
    axes = ensure_axes(ax, (10, 0.5 + 0.32 * max(len(lines), 1)))
    inches_per_frame = axes_width(axes) / (last - first)
    for height, (_, row) in enumerate(lines):
        _draw_row(axes, row, height, (first, last), inches_per_frame)
    labels = [f"{figure.name} · {row.group}" for figure, row in lines]
    axes.set_yticks(range(len(lines)), labels, fontsize=8)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.set_xlim(first, last)
    axes.set_xlabel("frame")
    axes.tick_params(axis="y", length=0)
    for side in ("top", "left", "right"):
        axes.spines[side].set_visible(False)
    return axes


def _draw_row(
    axes: "Axes",
    row: TimelineRow,
    height: int,
    frames: tuple[int, int],
    inches_per_frame: float,
) -> None:
    first, last = frames
    is_exchanged = row.is_exchanged if len(row.is_exchanged) else np.zeros(len(row.start), bool)
    for index in np.flatnonzero((row.stop > first) & (row.start < last)).tolist():
        start, length = int(row.start[index]), int(row.stop[index] - row.start[index])
        cluster = int(row.cluster[index])
        style: dict[str, Any] = {"hatch": "//////"} if is_exchanged[index] else {}
        axes.broken_barh(
            [(start, length)],
            (height - 0.4, 0.8),
            facecolor="0.75" if cluster < 0 else cluster_colour(cluster),
            edgecolor="white",
            linewidth=0.8,
            **style,
        )
        if cluster >= 0 and length * inches_per_frame > 0.07 * len(str(cluster)) + 0.05:
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
