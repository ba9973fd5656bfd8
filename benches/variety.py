"""Measure how settings trade variety against the traces that grafts leave.

``python benches/variety.py FOLDER... [--count 3]`` takes every folder as one source: the largest
set of BVH files with one skeleton below it, at 30 frames per second. It prints

- ``radius``: for each source the radius, in cluster diameter thresholds, at which balls have as
  many members on average as clusters, from which `BALL_RADIUS` is chosen;
- ``neighbourhood``: means over the sources with clusters and with balls, by `sigma_scale`.

``--only NAME`` prints one of these. The columns are those of `mograft.evaluation.quality`.
"""

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from mograft import evaluation
from mograft.search.neighbourhoods import NEIGHBOURHOODS

RATE = 30.0
SIGMA_SCALES = (0.3, 0.5, 0.75, 1.0, 1.5, 2.5)
COLUMNS = {
    "new_segments": "exchanged",
    "local_diversity": "local diversity",
    "diversity": "diversity",
    "seam_gap": "seam gap",
    "acceleration": "acceleration",
    "jerk": "jerk",
    "foot_skate": "foot skate",
}
PARTS = ("radius", "neighbourhood")


def read_source(folder):
    """The library of the largest set of files with one skeleton, by duration."""
    sets = defaultdict(list)
    for path in sorted(Path(folder).rglob("*.bvh")):
        motion = mg.read_bvh(path)
        sets[motion.skeleton.names, tuple(motion.skeleton.parents)].append(motion)
    largest = max(sets.values(), key=lambda motions: sum(own.duration for own in motions))
    return mg.Library.build(largest, rate=RATE)


def equal_radius(library, scale):
    """The radius of balls with as many members as clusters, in thresholds; mean members."""
    labelled = library.relabelled(mg.Config(sigma_scale=scale))
    base = labelled.groups.base
    points, labels = labelled.embedding[base].points, labelled.labels[base]
    chosen = np.arange(0, len(points), max(1, len(points) // 1000))
    n_members = np.bincount(labels)[labels[chosen]].sum()
    distances = np.concatenate([np.linalg.norm(points - points[k], axis=1) for k in chosen])
    radius = np.partition(distances, n_members - 1)[n_members - 1]
    return radius / labelled.sigma[base], n_members / len(chosen)


def print_radius(sources):
    print("| source | segments |" + "".join(f" {scale:g} |" for scale in SIGMA_SCALES[:-1]))
    print("|---|---|" + "---|" * len(SIGMA_SCALES[:-1]))
    rows = []
    for name, library in sources.items():
        found = [equal_radius(library, scale) for scale in SIGMA_SCALES[:-1]]
        rows.append([radius for radius, _ in found])
        cells = "".join(f" {radius:.2f}, {members:.1f} |" for radius, members in found)
        print(f"| {name} | {len(library.segments)} |{cells}")
    print("| mean | |" + "".join(f" {radius:.2f} |" for radius in np.mean(rows, axis=0)))


def mean_quality(sources, config, count):
    """Means over the sources of `COLUMNS`, of some grafts on up to three clips each."""
    rows = []
    for library in sources.values():
        library = library.relabelled(config)
        names = [own.name for own in library.entries if own.n_frames >= 2 * RATE][:3]
        grafts = [list(mg.graft_many(library, name, count)) for name in names]
        found = evaluation.quality("", grafts)
        rows.append([getattr(found, column).value for column in COLUMNS])
    return np.mean(rows, axis=0)


def print_settings(sources, configs, count):
    """Print one row of `mean_quality` for each configuration, given with its label."""
    print("| |" + "".join(f" {title} |" for title in COLUMNS.values()))
    print("|---|" + "---|" * len(COLUMNS))
    for label, config in configs:
        exchanged, local, diversity, gap, *ratios, skate = mean_quality(sources, config, count)
        print(
            f"| {label} | {exchanged:.2f} | {local:.3f} | {diversity:.1f}° | {gap:.1f}° |"
            + "".join(f" {ratio:.2f} |" for ratio in ratios)
            + f" {100 * skate:+.1f} % |"
        )


def report(options):
    """Print the tables."""
    if options.tiny:
        sources = {"tiny": mg.Library.build([tiny_motion(), tiny_motion(2)])}
    else:
        sources = {Path(folder).name: read_source(folder) for folder in options.folders}
    if options.only in (None, "radius"):
        print_radius(sources)
    if options.only in (None, "neighbourhood"):
        configs = [
            (f"{name}, {scale:g}", mg.Config(neighbourhood=name, sigma_scale=scale))
            for name in NEIGHBOURHOODS.names
            for scale in SIGMA_SCALES
        ]
        print_settings(sources, configs[:2] if options.tiny else configs, options.count)


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", help="folders of BVH files, each one source")
    parser.add_argument("--count", type=int, default=3, help="grafts per clip")
    parser.add_argument("--only", choices=PARTS)
    return run(parser, report, argv)


if __name__ == "__main__":
    sys.exit(main())
