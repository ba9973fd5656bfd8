"""Figures of measures, as small SVG for pages."""

import io
import math
import re

import matplotlib
from matplotlib.figure import Figure

INK, FAINT, MARK = "#7d838b", "#b9bec5", "#4a86cf"  # legible on light and dark backgrounds
LINES = ("#4a86cf", "#d9596b", "#2f9e68", "#b08a00")


def draw_kappa(by_name):
    """Draw κ of each method with its 95 % interval; the keys are the titles of the panels.

    Lines mark 0 (random parts) and 1 (captured parts).
    """
    panels = {
        name: [(score.method, score.kappa) for score in found.scores]
        for name, found in by_name.items()
    }
    lines = dict.fromkeys(panels, (0.0, 1.0))
    return _draw_dots(panels, "normalised compatibility κ", lines)


def draw_balance(by_name):
    """Draw the unbalanced segments of each method in percent, with 95 % intervals.

    The keys are the titles of the panels; all rows of a panel have the same `rule`. A vertical line
    marks the value of the recording.
    """
    panels = {name: [(row.method, row.rate) for row in rows] for name, rows in by_name.items()}
    lines = {
        name: [100 * row.rate.value for row in rows if row.method == "recording"]
        for name, rows in by_name.items()
    }
    return _draw_dots(panels, "unbalanced segments, %", lines, scale=100.0)


def draw_quality(rows):
    """Draw one panel for each measure of quality, with the methods and their 95 % intervals."""
    measures = {
        "seam gap, °": ("seam_gap", ()),
        "acceleration ratio": ("acceleration", (1.0,)),
        "jerk ratio": ("jerk", (1.0,)),
        "new segments": ("new_segments", ()),
    }
    return _draw_measures(rows, measures)


def draw_world(rows):
    """Draw one panel for each world-space measure, with the methods and their 95 % intervals."""
    measures = {
        "jerk ratio of the head": ("head_jerk", (1.0,)),
        "jerk ratio of the chest": ("chest_jerk", (1.0,)),
        "jerk ratio of the hands": ("hands_jerk", (1.0,)),
        "floor depth, heights": ("floor_depth", (0.0,)),
        "foot skate": ("skate", (0.0,)),
        "out of balance": ("balance", (0.0,)),
    }
    return _draw_measures(rows, measures)


def draw_detectability(rows):
    """Draw the AUC of each method at seams and between seams, and that of a null comparison.

    The null comparison is `Detectability.other_moments`. Each AUC has a 95 % interval. A line
    marks chance, 0.5.
    """
    panels = {
        f"{title}, {kind}": [(row.method, getattr(getattr(row, place), kind)) for row in rows]
        for place, title in (
            ("seams", "at seams"),
            ("between_seams", "between seams"),
            ("other_moments", "captured, other moments"),
        )
        for kind in ("gross", "fine")
    }
    return _draw_dots(panels, "AUC", dict.fromkeys(panels, (0.5,)))


def _draw_measures(rows, measures):
    """Draw one panel for each item of `measures`: title, (field of `rows`, vertical lines)."""
    panels = {
        title: [(row.method, getattr(row, name)) for row in rows]
        for title, (name, _) in measures.items()
    }
    lines = {title: positions for title, (_, positions) in measures.items()}
    return _draw_dots(panels, "", lines, columns=3)


def draw_counts(by_name, paper=None):
    """Draw the number of combinations of captured parts per segment against `sigma_scale`.

    `by_name` has results of `sweep` by title. There is one panel for each pair of a title and a
    value of `sigma`, and one colour for each number of groups. Solid lines are counts without the
    length limit, dotted lines with it. `paper` maps a number of groups to the combinations
    per segment in the paper, which triangles at the right edge mark.
    """
    readings = sorted({str(row.sigma) for rows in by_name.values() for row in rows})
    panels = [(name, reading) for name in by_name for reading in readings]
    columns = max(len(readings), 1)
    figure, axes = create_panels(len(panels), columns, 2.1, has_labels=False)
    for position, (name, reading) in enumerate(panels):
        ax = axes[position]
        rows = [row for row in by_name[name] if row.sigma == reading]
        scales = [row.sigma_scale for row in rows]
        for index, count in enumerate(rows[0].counts if rows else ()):
            colour = LINES[index % len(LINES)]
            for field, dash in (("unfiltered", "-"), ("filtered", ":")):
                factors = [getattr(row.counts[index], field) / row.segments for row in rows]
                ax.plot(scales, factors, dash, color=colour, linewidth=1.3)
            ax.plot([], [], color=colour, label=f"K = {count.groups}")
            for factor in (paper or {}).get(count.groups, ()):
                ax.plot([scales[-1] * 1.04], [factor], "<", color=colour, markersize=5)
        ax.set_yscale("log")
        ax.set_title(f"{name}, {reading}", fontsize=8, color=INK, loc="left")
        ax.set_xlabel("scale", fontsize=7.5, color=INK)
        if position % columns == 0:
            ax.set_ylabel("combinations per segment", fontsize=7.5, color=INK)
    axes[0].legend(fontsize=7, frameon=False, labelcolor=INK)
    return figure


def _draw_dots(panels, label, lines, *, scale=1.0, columns=2):
    """Draw one panel for each title, with its named estimates and its vertical `lines`.

    Each estimate is a dot with a bar for the interval. `label` is the text at the horizontal axis.
    """
    longest = max((len(rows) for rows in panels.values()), default=1)
    columns = min(columns, max(len(panels), 1))
    figure, axes = create_panels(len(panels), columns, 0.42 + 0.2 * longest, has_labels=True)
    for position, (title, rows) in enumerate(panels.items()):
        ax = axes[position]
        for value in lines[title]:
            ax.axvline(value, color=FAINT, linewidth=1, zorder=0)
        for height, (_, found) in enumerate(rows):
            if not math.isfinite(found.value):
                continue
            if math.isfinite(found.low):
                interval = [found.low * scale, found.high * scale]
                ax.plot(interval, [height, height], color=MARK, linewidth=1.6)
            ax.plot([found.value * scale], [height], "o", color=MARK, markersize=4.5)
        ax.set_yticks(range(len(rows)), [name for name, _ in rows])
        if position % columns:
            ax.tick_params(labelleft=False)
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_title(title, fontsize=8, color=INK, loc="left")
        ax.set_xlabel(label, fontsize=7.5, color=INK)
    return figure


def create_panels(count, columns, height, *, has_labels, width=3.0):
    """Return a figure and its axes, with space for the names of methods on the left."""
    rows = max(math.ceil(count / columns), 1)
    figure = Figure(
        figsize=(1.2 * has_labels + width * columns, height * rows + 0.25), layout="constrained"
    )
    grid = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for ax in grid:
        ax.set_facecolor("none")
        ax.tick_params(labelsize=7.5, colors=INK, length=2)
        for name, side in ax.spines.items():
            side.set_visible(name in ("left", "bottom"))
            side.set_color(FAINT)
    for ax in grid[count:]:
        ax.set_axis_off()
    return figure, grid


def as_svg(figure):
    """Return a figure as SVG text, which is identical for equal figures.

    Labels are text elements, not outlines, so that the SVG is small.
    """
    target = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "mograft", "svg.fonttype": "none"}):
        figure.savefig(
            target, format="svg", transparent=True, metadata={"Date": None, "Creator": None}
        )
    # Numbers rounded to hundredths of a pixel halve the size.
    text = re.sub(r"(\d+\.\d\d)\d+", r"\1", target.getvalue())
    return re.sub(r"[ \t]+$", "", text, flags=re.MULTILINE)
