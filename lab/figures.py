"""Draw the figures of ``docs/evidence.md`` from the tables in ``lab/results``."""

import argparse
from pathlib import Path

from lab.experiments.run import RESULTS, ROOT
from lab.experiments.sources import DEVELOPMENT, TEST
from lab.experiments.tables import read_csv
from lab.plots import FAINT, INK, MARK, as_svg, create_panels

FIGURES = ROOT / "docs" / "figures"
DEVELOPED = "#b08a00"  # sources on which constants were chosen


def draw_rows(panels, label, line, *, columns=3, limits=None):
    """Draw one panel for each title: the value and the interval of each source.

    `panels` maps a title to rows of CSV with the name of the column of values. All panels have the
    same horizontal axis; intervals end at its `limits`.
    """
    found = {row["source"] for rows, _ in panels.values() for row in rows}
    names = [name for name in (*TEST, *DEVELOPMENT) if name in found]
    height = 0.5 + 0.16 * len(names)
    figure, axes = create_panels(len(panels), columns, height, has_labels=True, width=2.2)
    for ax in axes[1:]:
        ax.sharex(axes[0])
    for position, (title, (rows, column)) in enumerate(panels.items()):
        ax = axes[position]
        ax.axvline(line, color=FAINT, linewidth=1, zorder=0)
        for row in rows:
            height = names.index(row["source"])
            colour = MARK if row["source"] in TEST else DEVELOPED
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
    return draw_rows(_panels(table, "analogy less", rules, "angle, degrees"), "degrees", 0)


def matched(folder):
    """κ of analogy less that of other rules on the same segments."""
    rules = {
        "random, length limit": "less random donors",
        "contact pattern": "less similar contacts",
        "nearest neighbours": "less nearest neighbours",
    }
    table = folder / "matched-differences.csv"
    return draw_rows(
        _panels(table, "analogy less", rules, "κ, same segments"), "κ", 0, limits=(-1, 1.5)
    )


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
    names = ("captured", "graft", "random donors", "CutMix", "GenMM, upper body", "motion matching")
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


DRAWN = (retrieval, matched, gaps, seams, generators, balance, collisions)


def main(argv=None):
    """Draw all figures."""
    parser = argparse.ArgumentParser(prog="lab figures", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the tables")
    parser.add_argument("-o", "--output", type=Path, default=FIGURES)
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    for draw in DRAWN:
        target = options.output / f"{draw.__name__}.svg"
        target.write_text(as_svg(draw(options.results)), encoding="utf-8")
