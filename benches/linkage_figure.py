"""Draw the figures of docs/linkage.md.

    python benches/linkage_figure.py [FIGURES.json]

draws two stages of complete linkage into docs/linkage-stages.svg. With the output of
``benches/linkage.py peers large --json FIGURES.json`` it also draws the run time over the number of
points into docs/linkage-speed.svg, and prints the first table of docs/linkage.md.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benches._common import run
from mograft import clustering

STYLE = {"svg.hashsalt": "mograft", "svg.fonttype": "none", "font.size": 9}

DOCS = Path(__file__).parents[1] / "docs"


def draw_stages(folder):
    rng = np.random.default_rng(4)
    centres = np.array([[0.0, 0.0], [2.6, 0.4], [1.2, 2.2]])
    points = np.concatenate([c + 0.55 * rng.standard_normal((8, 2)) for c in centres])
    limits = (0.7, 1.6)
    before = np.arange(len(points))
    figure = Figure(figsize=(10, 2.9))
    panels = figure.subplots(1, 4)
    for i, limit in enumerate(limits):
        after = clustering.cut(points, limit)
        graph, merged = panels[2 * i], panels[2 * i + 1]
        graph.set_title(f"stage {i + 1}: pairs within T = {limit}")
        merged.set_title("merged until no edge is left")
        for a in range(before.max() + 1):
            for b in range(a):
                one, other = points[before == a], points[before == b]
                distances = np.linalg.norm(one[:, None] - other, axis=-1)
                if distances.max() <= limit:
                    p, q = np.unravel_index(distances.argmax(), distances.shape)
                    graph.plot(*np.stack([one[p], other[q]]).T, c="tab:orange", lw=0.9)
        for panel, labels in ((graph, before), (merged, after)):
            for label in range(labels.max() + 1):
                draw_circle(panel, points[labels == label])
            panel.plot(*points.T, "k.", ms=4)
            panel.set(aspect="equal", xticks=[], yticks=[], xlim=(-1.6, 4.3), ylim=(-1.6, 3.7))
        before = after
    figure.tight_layout()
    figure.savefig(folder / "linkage-stages.svg", metadata={"Date": None})


def draw_circle(panel, members):
    """Draw a circle around a cluster of two or more points."""
    if len(members) > 1:
        centre = (members.min(axis=0) + members.max(axis=0)) / 2
        radius = np.linalg.norm(members - centre, axis=1).max() + 0.09
        panel.add_patch(Circle(centre, radius, fill=False, color="tab:blue", lw=0.9))


def draw_speed(rows, folder):
    """Draw seconds over the number of points, both on logarithmic scales."""
    figure = Figure(figsize=(6.4, 4.0))
    axes = figure.subplots()
    colours = {"SciPy": "tab:red", "fastcluster": "tab:orange", "mograft": "tab:blue"}
    dashes = {"white": "-", "mixture": "--", "walk": ":"}
    for library, colour in colours.items():
        for kind, dash in dashes.items():
            line = {r["n"]: r["wall"] for r in rows if (r["who"], r["kind"]) == (library, kind)}
            if line:
                label = f"{library}, {kind}"
                axes.loglog(*zip(*sorted(line.items()), strict=True), dash, c=colour, label=label)
    axes.set(xlabel="points of ten axes", ylabel="seconds for the tree, two processors")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(folder / "linkage-speed.svg", metadata={"Date": None})


def print_table(rows):
    """Print the rows of the first table of docs/linkage.md."""
    found = {(row["who"], row["kind"], row["n"]): row for row in rows}
    for (who, kind, n), ours in sorted(found.items(), key=lambda item: item[0][1:]):
        if who != "mograft":
            continue
        peers = [found.get((peer, kind, n)) for peer in ("SciPy", "fastcluster")]
        ratios = [f"{peer['wall'] / ours['wall']:.0f} times" if peer else "" for peer in peers]
        memory = [f"{row['MB']:.0f}" if row else "" for row in (ours, peers[0])]
        cells = (f"{kind}, {n:,}", f"{ours['wall']:.3g} s", *ratios, *memory)
        print("| " + " | ".join(cells) + " |")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("figures", nargs="?", type=Path, metavar="FIGURES.json")
    run(parser, report, argv)


@mpl.rc_context(STYLE)
def report(options):
    if options.tiny:
        row = {"who": "mograft", "kind": "white", "MB": 1}
        rows = [{**row, "n": n, "wall": n / 1e5} for n in (10, 100)]
        print_table(rows)
        with tempfile.TemporaryDirectory() as folder:
            draw_stages(Path(folder))
            draw_speed(rows, Path(folder))
        return
    draw_stages(DOCS)
    if options.figures is not None:
        rows = json.loads(options.figures.read_text())["rows"]
        draw_speed(rows, DOCS)
        print_table(rows)


if __name__ == "__main__":
    main()
