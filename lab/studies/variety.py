"""Measure how settings trade variety against the traces that grafts leave.

``python -m lab variety FOLDER... [--count 3]`` takes every folder as one source: the largest
set of BVH files with one skeleton below it, at 30 frames per second. It prints

- ``radius``: for each source the radius, in cluster diameter thresholds, at which balls have as
  many members on average as clusters, see `BALL_RADIUS` of `lab.donors.retrieval_trials`;
- ``share``: the share of exchanged segments and the mean seam gap by variety, which need no
  motions and take seconds;
- ``neighbourhood``: measures of grafts with clusters and with balls, by `sigma_scale`;
- ``temperature``, ``diversity``: the same by `temperature` and by `diversity`;
- ``seeds``: by `temperature`, the share of positions at which donors of two seeds differ, and the
  mean seam gap, which need no motions;
- ``dial``: the same by the variety of `Config.with_variety`;
- ``defaults``: the same for the defaults and for settings near them;
- ``front``: the same for twenty pairs of `sigma_scale` and `diversity`.

``--only NAME`` prints one of these. "new" is the share of frames in which a grafted joint differs
from the base by more than 5°, "apart" the mean angle of the grafted joints between two grafts of
one base, "none" the share of segments without a candidate. The areas of classifiers at seams and
between them are those of `mograft.evaluation`: 0.5 means that a classifier cannot distinguish
grafts from recordings. The last rows are means over the sources. Needs scikit-learn.
"""

import argparse
from collections import defaultdict
from itertools import combinations
from pathlib import Path

import numpy as np

import mograft as mg
from lab.common import run, tiny_motion
from mograft.evaluation.detectability import MIN_WINDOWS, block_folds, detect
from mograft.evaluation.windows import GraftWindows
from mograft.solve.plan import GraftPlan

RATE = 30.0
SIGMA_SCALES = (0.3, 0.5, 0.75, 1.0, 1.5, 2.5)
COLUMNS = (
    *("exchanged", "none", "new", "apart", "seam gap"),
    *("seams, gross", "seams, fine", "between, gross", "between, fine"),
)
NEW_ANGLE = np.radians(5.0)
TEMPERATURES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
N_SEEDS = 4
DIVERSITIES = (0.0, 1.0, 2.0, 4.0)
FRONT_SCALES, FRONT_DIVERSITIES = (0.5, 0.6, 0.75, 0.8, 1.0), (1.0, 3.0, 4.0, 6.0)
VARIETIES = (0.0, 0.25, 0.5, 0.75, 1.0)
PARTS = (
    "radius",
    "share",
    "seeds",
    "neighbourhood",
    "temperature",
    "diversity",
    "dial",
    "defaults",
    "front",
)
EARLIER = {"neighbourhood": "cluster", "diversity": 1.0, "distance_weight": 0.25}
MAX_BASES = 3  # clips of a source that are bases
MAX_WINDOWS = 600


def read_source(folder):
    """The library of the largest set of files with one skeleton, by duration."""
    sets = defaultdict(list)
    for path in sorted(Path(folder).rglob("*.bvh")):
        motion = mg.read_bvh(path)
        sets[motion.skeleton.names, tuple(motion.skeleton.parents)].append(motion)
    largest = max(sets.values(), key=lambda motions: sum(own.duration for own in motions))
    return mg.Library.build(largest, rate=RATE)


def read_sources(options):
    """The library of each folder in `options`, by name; with ``--tiny`` a generated one."""
    if options.tiny:
        return {"tiny": mg.Library.build([tiny_motion(), tiny_motion(2)])}
    return {Path(folder).name: read_source(folder) for folder in options.folders}


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


def donor_shares(library, config, count):
    """The share of exchanged segments in donor sequences on all clips, and the mean seam gap."""
    library = library.relabelled(config)
    is_new, gaps = [], []
    for entry in library.entries:
        plan = GraftPlan.build(library, entry.name, None, ())
        for donors in plan.choose_donors(count, 0):
            for group, sequence in donors.items():
                is_new.append(sequence != plan.problem.scenario)
                gaps.append(plan.pools[group].seam_angles_along(sequence))
    gaps = np.concatenate(gaps)
    return np.concatenate(is_new).mean(), np.degrees(gaps[gaps > 1e-9].mean())


def print_shares(sources, count):
    print("| source |" + "".join(f" {variety:g} |" for variety in VARIETIES))
    print("|---|" + "---|" * len(VARIETIES))
    rows = []
    for name, library in sources.items():
        configs = map(mg.Config.with_variety, VARIETIES)
        rows.append([donor_shares(library, config, count) for config in configs])
        cells = "".join(f" {100 * share:.0f} %, {gap:.1f}° |" for share, gap in rows[-1])
        print(f"| {name} |{cells}", flush=True)
    means = np.mean(rows, axis=0)
    print("| mean |" + "".join(f" {100 * share:.0f} %, {gap:.1f}° |" for share, gap in means))


def seed_difference(library, config):
    """The share of positions at which donors of two seeds differ, and the mean seam gap."""
    library = library.relabelled(config)
    differs, gaps = [], []
    for entry in library.entries:
        plan = GraftPlan.build(library, entry.name, None, ())
        for group, pool in plan.pools.items():
            drawn = [plan.choose_donors(1, seed)[0][group] for seed in range(N_SEEDS)]
            differs += [own != other for own, other in combinations(drawn, 2)]
            gaps += [pool.seam_angles_along(own) for own in drawn]
    gaps = np.concatenate(gaps)
    return np.concatenate(differs).mean(), np.degrees(gaps[gaps > 1e-9].mean())


def print_seeds(sources):
    print("| source |" + "".join(f" {temperature:g} |" for temperature in TEMPERATURES))
    print("|---|" + "---|" * len(TEMPERATURES))
    for name, library in sources.items():
        configs = [mg.Config(temperature=temperature) for temperature in TEMPERATURES]
        found = [seed_difference(library, config) for config in configs]
        cells = "".join(f" {100 * share:.0f} %, {gap:.1f}° |" for share, gap in found)
        print(f"| {name} |{cells}", flush=True)


def joint_angles(first, second, joints):
    """The angles between joints of two motions, in radians, shape (n_frames, n_joints)."""
    turns = mg.rotations.multiply(mg.rotations.inverse(first[:, joints]), second[:, joints])
    return np.linalg.norm(mg.rotations.log(turns), axis=-1)


def measure(library, config, count):
    """The values of `COLUMNS`, of some grafts on up to `MAX_BASES` clips of a library."""
    library = library.relabelled(config)
    names = [own.name for own in library.entries if own.n_frames >= 2 * RATE][:MAX_BASES]
    grafts = [list(mg.graft_many(library, name, count)) for name in names]
    flat = [graft for several in grafts for graft in several]
    joints = np.concatenate([library.joints(group) for group in flat[0].alternatives])
    from_base = [joint_angles(own.base.rotations, own.motion.rotations, joints) for own in flat]
    apart = [
        joint_angles(one.motion.rotations, two.motion.rotations, joints).mean()
        for several in grafts
        for one, two in combinations(several, 2)
    ]
    gaps = [seam.gap for graft in flat for seam in graft.seams]
    values = [
        np.mean([not own.is_own for graft in flat for own in graft.substitutions]),
        np.mean(np.concatenate([own == 0 for g in flat for own in g.alternatives.values()])),
        np.mean(np.concatenate([(own > NEW_ANGLE).any(axis=1) for own in from_base])),
        np.degrees(np.mean(apart)),
        np.degrees(np.mean(gaps)) if gaps else np.nan,
    ]
    for place in ("seams", "between seams"):
        windows = GraftWindows.of(flat, place, MAX_WINDOWS, np.random.default_rng(0))
        if len(windows) < MIN_WINDOWS:
            values += [np.nan, np.nan]
            continue
        found = detect([windows.pairs()], [block_folds(windows.frames, (0, 0))], 0)
        values += [found.gross.value, found.fine.value]
    return values


def print_settings(sources, configs, count):
    """Print `COLUMNS` for each source and configuration, given with its label, and the means."""
    print("| source | |" + "".join(f" {title} |" for title in COLUMNS))
    print("|---|---|" + "---|" * len(COLUMNS))
    found = {}
    for name, library in sources.items():
        for label, config in configs:
            values = measure(library, config, count)
            found.setdefault(label, []).append(values)
            print_row(name, label, values)
    for label, rows in found.items():
        print_row("mean", label, np.nanmean(rows, axis=0))


def print_row(name, label, values):
    """Print a row of `print_settings`."""
    exchanged, none, new, apart, gap, *areas = values
    cells = "".join(f" {value:.2f} |" for value in (exchanged, none, new))
    cells += f" {apart:.1f}° | {gap:.1f}° |" + "".join(f" {area:.2f} |" for area in areas)
    print(f"| {name} | {label} |{cells}", flush=True)


def report(options):
    """Print the tables."""
    sources = read_sources(options)
    if options.only in (None, "radius"):
        print_radius(sources)
    if options.only in (None, "share"):
        print_shares(sources, options.count)
    if options.only in (None, "seeds"):
        print_seeds(sources)
    settings = {
        "neighbourhood": [
            (f"{name}, {scale:g}", mg.Config(neighbourhood=name, sigma_scale=scale))
            for name in ("cluster", "ball")
            for scale in (0.5, 0.75, 1.0)
        ],
        "temperature": [(f"{own:g}", mg.Config(temperature=own)) for own in (0.1, 0.25, 1.0)],
        "diversity": [(f"{own:g}", mg.Config(diversity=own)) for own in DIVERSITIES],
        "defaults": [
            ("clusters, earlier weights", mg.Config(**EARLIER)),
            ("clusters", mg.Config(neighbourhood="cluster")),
            ("balls, diversity 1", mg.Config(diversity=1.0)),
            ("balls, distance weight 1", mg.Config(distance_weight=1.0)),
            ("defaults", mg.Config()),
            ("balls, diversity 6", mg.Config(diversity=6.0)),
        ],
        "front": [
            (f"{scale:g}, {own:g}", mg.Config(sigma_scale=scale, diversity=own))
            for scale in FRONT_SCALES
            for own in FRONT_DIVERSITIES
        ],
        "dial": [(f"{own:g}", mg.Config.with_variety(own)) for own in VARIETIES],
    }
    for part, configs in settings.items():
        if options.only in (None, part):
            print_settings(sources, configs[:1] if options.tiny else configs, options.count)


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", help="folders of BVH files, each one source")
    parser.add_argument("--count", type=int, default=3, help="grafts per clip")
    parser.add_argument("--only", choices=PARTS)
    return run(parser, report, argv)
