"""Pictures of what was measured, small enough to stand in a page."""

import io
import math
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mograft.evaluation.balance import BalanceRow
from mograft.evaluation.enrichment import Enrichment
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.naturalness import Compatibility
from mograft.evaluation.quality import Quality

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["as_image", "as_svg", "draw_balance", "draw_counts", "draw_kappa", "draw_quality"]

_INK, _FAINT, _MARK = "#7d838b", "#b9bec5", "#4a86cf"
"""Legible on light pages and on dark ones."""
_LINES = ("#4a86cf", "#d9596b", "#2f9e68", "#b08a00")


def draw_kappa(several: Mapping[str, Compatibility]) -> "Figure":
    """Draw the normalised compatibility of each way, for one or several sets of data.

    Parameters
    ----------
    several : mapping of str to Compatibility
        By the name to show.

    Returns
    -------
    matplotlib Figure
        Dots with 95 % intervals; 0 is random parts, 1 captured ones.
    """
    panels = {
        name: [(own.method, own.kappa) for own in found.scores] for name, found in several.items()
    }
    return _dots(panels, "normalised compatibility κ", lines=(0.0, 1.0))


def draw_balance(several: Mapping[str, Sequence[BalanceRow]]) -> "Figure":
    """Draw how many segments are out of static balance.

    Parameters
    ----------
    several : mapping of str to sequence of BalanceRow
        Rows of one rule, by the name to show.

    Returns
    -------
    matplotlib Figure
        Dots with 95 % intervals, in percent; the recording's own as a line.
    """
    panels = {name: [(row.method, row.rate) for row in rows] for name, rows in several.items()}
    own = {
        name: [100 * row.rate.value for row in rows if row.method == "recording"]
        for name, rows in several.items()
    }
    return _dots(panels, "unbalanced segments, %", scale=100.0, own_lines=own)


def draw_quality(rows: Sequence[Quality]) -> "Figure":
    """Draw measures of quality beside each other.

    Parameters
    ----------
    rows : sequence of Quality
        One for each way.

    Returns
    -------
    matplotlib Figure
        A panel for each measure; dots with 95 % intervals.
    """
    measures: dict[str, tuple[str, tuple[float, ...]]] = {
        "seam gap, °": ("seam_gap", ()),
        "acceleration ratio": ("acceleration", (1.0,)),
        "jerk ratio": ("jerk", (1.0,)),
        "new segments": ("new_segments", ()),
        "coverage": ("coverage", ()),
        "local diversity": ("local_diversity", (0.0,)),
    }
    panels = {
        title: [(row.method, getattr(row, name)) for row in rows]
        for title, (name, _) in measures.items()
    }
    lines = {title: list(at) for title, (_, at) in measures.items()}
    return _dots(panels, "", own_lines=lines, columns=3)


def draw_counts(
    several: Mapping[str, Sequence[Enrichment]],
    paper: Mapping[int, Sequence[float]] | None = None,
) -> "Figure":
    """Draw how often each segment's parts can be combined, by scale of the threshold.

    Parameters
    ----------
    several : mapping of str to sequence of Enrichment
        As `sweep` returns them, by the name to show.
    paper : mapping of int to sequence of float, optional
        Factors to mark for each number of groups.

    Returns
    -------
    matplotlib Figure
        For each reading of the threshold a panel; a line for each number of groups, drawn
        through where nothing but clusters limits and dashed where lengths do too.
    """
    readings = sorted({str(row.sigma) for rows in several.values() for row in rows})
    panels = [(name, reading) for name in several for reading in readings]
    columns = max(len(readings), 1)
    figure, axes = _panels(len(panels), columns, 2.1, share=False)
    for place, (name, reading) in enumerate(panels):
        ax = axes[place]
        own = [row for row in several[name] if row.sigma == reading]
        scales = [row.sigma_scale for row in own]
        for index, count in enumerate(own[0].counts if own else ()):
            colour = _LINES[index % len(_LINES)]
            for field, dash in (("unfiltered", "-"), ("filtered", ":")):
                factors = [getattr(row.counts[index], field) / row.segments for row in own]
                ax.plot(scales, factors, dash, color=colour, linewidth=1.3)
            ax.plot([], [], color=colour, label=f"K = {count.groups}")
            for factor in (paper or {}).get(count.groups, ()):
                ax.plot([scales[-1] * 1.04], [factor], "<", color=colour, markersize=5)
        ax.set_yscale("log")
        ax.set_title(f"{name}, {reading}", fontsize=8, color=_INK, loc="left")
        ax.set_xlabel("scale", fontsize=7.5, color=_INK)
        if place % columns == 0:
            ax.set_ylabel("combinations per segment", fontsize=7.5, color=_INK)
    axes[0].legend(fontsize=7, frameon=False, labelcolor=_INK)
    return figure


def _dots(
    panels: Mapping[str, Sequence[tuple[str, Estimate]]],
    label: str,
    *,
    scale: float = 1.0,
    lines: Sequence[float] = (),
    own_lines: Mapping[str, Sequence[float]] | None = None,
    columns: int = 2,
) -> "Figure":
    longest = max((len(rows) for rows in panels.values()), default=1)
    columns = min(columns, max(len(panels), 1))
    figure, axes = _panels(len(panels), columns, 0.42 + 0.2 * longest, share=True)
    for place, (title, rows) in enumerate(panels.items()):
        ax = axes[place]
        for at in [*lines, *(own_lines or {}).get(title, ())]:
            ax.axvline(at, color=_FAINT, linewidth=1, zorder=0)
        for height, (_, own) in enumerate(rows):
            if not math.isfinite(own.value):
                continue
            if math.isfinite(own.low):
                ends = [own.low * scale, own.high * scale]
                ax.plot(ends, [height, height], color=_MARK, linewidth=1.6)
            ax.plot([own.value * scale], [height], "o", color=_MARK, markersize=4.5)
        ax.set_yticks(range(len(rows)), [name for name, _ in rows])
        if place % columns:
            ax.tick_params(labelleft=False)
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_title(title, fontsize=8, color=_INK, loc="left")
        ax.set_xlabel(label, fontsize=7.5, color=_INK)
    return figure


def _panels(count: int, columns: int, tall: float, *, share: bool) -> tuple["Figure", list[Any]]:
    from mograft.evaluation._extra import needed

    rows = max(math.ceil(count / columns), 1)
    figure = needed("matplotlib.figure").Figure(
        figsize=(1.2 * share + 3.0 * columns, tall * rows + 0.25), layout="constrained"
    )
    grid = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for ax in grid:
        ax.set_facecolor("none")
        ax.tick_params(labelsize=7.5, colors=_INK, length=2)
        for name, side in ax.spines.items():
            side.set_visible(name in ("left", "bottom"))
            side.set_color(_FAINT)
    for ax in grid[count:]:
        ax.set_axis_off()
    return figure, grid


def as_svg(figure: "Figure") -> str:
    """Return a figure as SVG that is the same every time.

    Parameters
    ----------
    figure : matplotlib Figure
        What to write.

    Returns
    -------
    str
        Text is text in it, so that it stays small.
    """
    from mograft.evaluation._extra import needed

    target = io.StringIO()
    with needed("matplotlib").rc_context({"svg.hashsalt": "mograft", "svg.fonttype": "none"}):
        figure.savefig(
            target, format="svg", transparent=True, metadata={"Date": None, "Creator": None}
        )
    # Where no number is finer than a hundredth of a pixel the file is half as long.
    text = re.sub(r"(\d+\.\d\d)\d+", r"\1", target.getvalue())
    return re.sub(r"[ \t]+$", "", text, flags=re.MULTILINE)


def as_image(figure: "Figure", words: str) -> str:
    """Return a figure as an element of a page.

    Parameters
    ----------
    figure : matplotlib Figure
        What to show.
    words : str
        What it shows, for those who do not see it; plain text without quotes.

    Returns
    -------
    str
        HTML.
    """
    text = b64encode(as_svg(figure).encode()).decode("ascii")
    return f'<img alt="{words}" src="data:image/svg+xml;base64,{text}">'
