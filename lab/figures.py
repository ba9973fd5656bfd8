"""Draw the figures of ``docs/evidence.md`` from the tables in ``lab/results``."""

import argparse
import sys
from pathlib import Path

from lab.experiments.run import RESULTS, ROOT, stale_experiments
from lab.experiments.sources import DEVELOPMENT, SOURCES, TEST, UNTOUCHED
from lab.experiments.tables import read_csv
from lab.experiments.verdicts import ANGLE_MARGIN, KAPPA_MARGIN
from lab.plots import FAINT, INK, LINES, MARK, as_svg, create_panels

FIGURES = ROOT / "docs" / "figures"
COLOURS = {"test": MARK, "development": "#b08a00", "untouched": "#2f9e68"}  # by use of the source


def draw_rows(panels, label, line, *, columns=3, limits=None, margin=None):
    """Draw one panel for each title: the value and the interval of each source.

    `panels` maps a title to rows of CSV with the name of the column of values. All panels have the
    same horizontal axis; intervals end at its `limits`. Intervals within the band of `margin`
    around `line` are equal to it.
    """
    found = {row["source"] for rows, _ in panels.values() for row in rows}
    names = [name for name in (*UNTOUCHED, *TEST, *DEVELOPMENT) if name in found]
    height = 0.5 + 0.16 * len(names)
    figure, axes = create_panels(len(panels), columns, height, has_labels=True, width=2.2)
    for ax in axes[1:]:
        ax.sharex(axes[0])
    for position, (title, (rows, column)) in enumerate(panels.items()):
        ax = axes[position]
        ax.axvline(line, color=FAINT, linewidth=1, zorder=0)
        if margin is not None:
            ax.axvspan(line - margin, line + margin, color=FAINT, alpha=0.25, zorder=0)
        for row in rows:
            height = names.index(row["source"])
            colour = COLOURS[SOURCES[row["source"]].use]
            if row.get(f"{column} low"):
                ends = [float(row[f"{column} {end}"]) for end in ("low", "high")]
                ax.plot(ends, [height, height], color=colour, linewidth=1.6)
            if row[column]:
                ax.plot([float(row[column])], [height], "o", color=colour, markersize=4)
        ax.set_yticks(range(len(names)), names)
        if position % columns:
            ax.tick_params(labelleft=False)
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.set_title(title, fontsize=8, color=INK, loc="left")
        ax.set_xlabel(label, fontsize=7.5, color=INK)
    if limits is not None:
        axes[0].set_xlim(limits)
    return figure


def _panels(table, by, values, column):
    """Return a panel for each value of the column `by` of a table."""
    rows = read_csv(table)
    return {title: ([r for r in rows if r[by] == name], column) for name, title in values.items()}


def retrieval(folder):
    """Gain of analogy less that of other rules."""
    rules = {
        "random": "less random donors",
        "contact pattern": "less similar contacts",
        "nearest neighbours": "less nearest neighbours",
    }
    table = folder / "retrieval-advantages.csv"
    panels = _panels(table, "analogy less", rules, "angle, degrees")
    return draw_rows(panels, "degrees", 0, margin=ANGLE_MARGIN)


def matched(folder):
    """κ of analogy less that of other rules on the same segments."""
    rules = {
        "random, length limit": "less random donors",
        "contact pattern": "less similar contacts",
        "nearest neighbours": "less nearest neighbours",
    }
    table = folder / "matched-differences.csv"
    panels = _panels(table, "analogy less", rules, "κ, same segments")
    return draw_rows(panels, "κ", 0, limits=(-1, 1.5), margin=KAPPA_MARGIN)


def gaps(folder):
    """Seam gaps of analogy divided by those of as many other donors."""
    rows = read_csv(folder / "new-motions-gaps.csv")
    titles = {
        "random, both drawn at random": "by random, both drawn",
        "random, both by cost": "by random, both by cost",
        "nearest, both by cost": "by nearest, both by cost",
    }
    return draw_rows({title: (rows, name) for name, title in titles.items()}, "ratio", 1)


def seams(folder):
    """Fine AUC at seams of the default treatment, of others, and of captured motion."""
    rows = read_csv(folder / "seams-sources.csv")
    titles = {
        "captured, other moments": "captured motion",
        "gradient": "gradient, the default",
        "paper": "the paper's treatment",
    }
    return draw_rows({title: (rows, name) for name, title in titles.items()}, "AUC", 0.5)


def generators(folder):
    """Gross AUC of windows of several generators."""
    rows = read_csv(folder / "generators-auc.csv")
    names = ("captured", "graft", "random donors", "CutMix", "GenMM, upper body")
    return draw_rows({name: (rows, name) for name in names}, "AUC", 0.5)


def balance(folder):
    """Change of the share of unbalanced segments by exchanges of analogy."""
    kinds = {"static": "static", "dynamic": "dynamic"}
    column = "analogy, change in points"
    panels = _panels(folder / "balance-changes.csv", "balance", kinds, column)
    return draw_rows(panels, "percentage points", 0, columns=2)


def collisions(folder):
    """Share of the colliding frames that repairs remove."""
    kinds = {
        "balls, the default": "balls, the default",
        "clusters": "clusters",
        "random donors": "random donors",
        "clusters widened up to 4": "widened clusters",
    }
    return draw_rows(
        _panels(folder / "collisions-repairs.csv", "donors", kinds, "removed, %"), "%", 0
    )


STYLES = {
    "balls": ("o-", LINES[0]),
    "clusters": ("s-", LINES[1]),
    "nearest": ("^-", LINES[2]),
    "random, by cost": ("v-", LINES[3]),
    "random donors": ("D", INK),
    "CutMix": ("P", INK),
    "motion matching": ("X", INK),
    "GenMM, upper body": ("*", INK),
    "mirror": ("<", INK),
}
"""Marker and colour of the methods in `tradeoff`: lines of several settings, or one point."""


def tradeoff(folder):
    """Gross AUC of changed windows against the mean angle to the base, by method and source."""
    rows = read_csv(folder / "tradeoff-settings.csv")
    names = dict.fromkeys(own["source"] for own in rows if own["source"] not in DEVELOPMENT)
    figure, axes = create_panels(len(names), 3, 1.5, has_labels=False, width=2.4)
    for ax, name in zip(axes, names, strict=False):
        for method, (style, colour) in STYLES.items():
            own = [row for row in rows if (row["source"], row["method"]) == (name, method)]
            points = sorted(
                (float(row["newness, degrees"]), float(row["AUC, gross"]))
                for row in own
                if row["AUC, gross"]
            )
            if points:
                x, y = zip(*points, strict=True)
                ax.plot(x, y, style, color=colour, markersize=3.5, linewidth=1.2, label=method)
        ax.axhline(0.5, color=FAINT, linewidth=1, zorder=0)
        ax.set_ylim(0.35, 1.0)
        ax.set_title(f"{name} ({SOURCES[name].use})", fontsize=8, color=INK, loc="left")
        ax.set_xlabel("newness, degrees", fontsize=7.5, color=INK)
    labels = axes[0].get_legend_handles_labels()
    figure.legend(
        *labels, ncols=4, loc="outside upper left", fontsize=7, frameon=False, labelcolor=INK
    )
    return figure


DRAWN = (retrieval, matched, gaps, seams, generators, tradeoff, balance, collisions)

EXPERIMENTS = {"gaps": "new-motions"}  # of figures that have another name than their experiment
STALE = "Stale: measured with an earlier version of the code."


def draw_all(folder):
    """Yield the name and the SVG of every figure; those of earlier code say so."""
    stale = stale_experiments(folder)
    for draw in DRAWN:
        figure, name = draw(folder), draw.__name__
        if EXPERIMENTS.get(name, name) in stale:
            figure.supxlabel(STALE, fontsize=7, color=INK)
        yield name, as_svg(figure)


def main(argv=None):
    """Draw all figures."""
    parser = argparse.ArgumentParser(prog="lab figures", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the tables")
    parser.add_argument("-o", "--output", type=Path, default=FIGURES)
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    for name, text in draw_all(options.results):
        (options.output / f"{name}.svg").write_text(text, encoding="utf-8")
        if STALE in text:
            print(f"{name}: {STALE}", file=sys.stderr)
