"""Compare the rules that select the candidates of a segment: clusters, balls, k nearest, learned.

``python -m lab neighbourhoods FOLDER...`` takes every folder as one source, like ``variety``. It
prints, for each source,

- ``stability``: for each rule, the Jaccard index of the pairs of base segment and candidate before
  and after a tenth of the segments is dropped, mean of `N_DROPS` draws, and the share of segments
  without a candidate;
- ``metric``: by how many degrees the poses of the grafted group in the nearest segments of other
  clips are nearer to those in the base segment than the poses of random segments. The distance is
  that of the embedding of the base group, with 10 or `COMPONENTS` components, or of what ridge
  regression predicts for the grafted group from the base parts of a segment and its neighbours.
  A regression is fitted on other clips than those of its base segments, with the penalty that
  cross-validation on these clips selects;
- ``grafts``: the columns of ``variety`` for grafts with each rule.

``--only NAME`` prints one of these. Sources of fewer than five clips are divided into ten parts.
"""

import argparse
from dataclasses import replace
from unittest.mock import patch

import numpy as np

import mograft as mg
from lab.common import run
from lab.studies.variety import COLUMNS, measure, print_row, read_sources
from mograft.search.neighbourhoods import NEIGHBOURHOODS

PARTS = ("stability", "metric", "grafts")
GROUP = "upper"
N_DROPS = 5
N_FOLDS = 5
N_COMPARED = 5  # nearest segments whose poses are compared
N_RANDOM = 50
COMPONENTS = 40
PENALTIES = (0.01, 0.1, 1.0, 10.0)  # times the number of segments
N_NEAREST = 32
RULES = {
    "clusters": {"neighbourhood": "cluster"},
    "balls of 0.8": {"sigma_scale": 0.8},
    "balls of 1": {"sigma_scale": 1.0},
    "balls (default)": {},
    f"{N_NEAREST} nearest": {"nearest": N_NEAREST},
}


class NearestSegments(type(NEIGHBOURHOODS["ball"])):
    """Neighbourhood of the k nearest segments, whatever their distances."""

    reach = 1.0

    def __init__(self, count):
        self.count = count

    def find_members(self, labels, points, sigma, base):  # noqa: ARG002 - the interface
        """As `Neighbourhood.find_members`."""
        distances = (np.linalg.norm(points - points[own], axis=1) for own in base)
        return [np.sort(np.argsort(own, kind="stable")[: self.count + 1]) for own in distances]


def rule(name):
    """Return the configuration of a rule, and the context in which the search uses it."""
    values = dict(RULES[name])
    count = values.pop("nearest", None)
    return mg.Config(**values), patch.dict(
        NEIGHBOURHOODS, {} if count is None else {"ball": NearestSegments(count)}
    )


def pairs_of(pool, segments, config):
    """Return a set of pairs of base segment and other candidate, named by `segments`."""
    lists = pool.candidate_lists(np.arange(len(segments)), config)
    return {
        (int(segments[own]), int(segments[donor]))
        for own, donors in enumerate(lists)
        for donor in donors.tolist()
        if donor != own
    }


def stability(library, name):
    """Return the mean Jaccard index of a rule, and the share of segments without a candidate."""
    config, context = rule(name)
    labelled = library.relabelled(config)
    pool, every = labelled.pool(GROUP), np.arange(len(library.segments))
    indices = []
    with context:
        pairs = pairs_of(pool, every, config)
        for seed in range(N_DROPS):
            rng = np.random.default_rng(seed)
            kept = np.sort(rng.permutation(every)[: len(every) * 9 // 10])
            fewer = replace(
                pool,
                segments=pool.segments[kept],
                labels=mg.clustering.cut(pool.points[kept], pool.sigma),
                is_donor=pool.is_donor[kept],
                boundary=pool.boundary[kept],
                points=pool.points[kept],
                balance=None,
                parts=None,
            )
            names = set(kept.tolist())
            before = {pair for pair in pairs if names.issuperset(pair)}
            after = pairs_of(fewer, kept, config)
            indices.append(len(before & after) / max(len(before | after), 1))
    with_donors = {own for own, _ in pairs}
    return np.mean(indices), 1.0 - len(with_donors) / len(every)


def folds_of(library):
    """Return the unit of each segment, a clip or a part of one, and its fold."""
    clip, n = library.segments.clip, len(library.segments)
    unit = clip if len(library.clips) >= N_FOLDS else np.arange(n) * 10 // n
    return unit, unit % N_FOLDS


def ridge(inputs, outputs, penalty):
    """Return the weights of ridge regression."""
    square = inputs.T @ inputs + penalty * len(inputs) * np.eye(inputs.shape[1])
    return np.linalg.solve(square, inputs.T @ outputs)


def predict(inputs, outputs, folds, held):
    """Return what a regression that is fitted without a fold predicts for all segments."""
    fitted = np.flatnonzero(folds != held)
    errors = []
    for penalty in PENALTIES:
        error = 0.0
        for inner in np.unique(folds[fitted]):
            is_inner = folds[fitted] == inner
            own, others = fitted[is_inner], fitted[~is_inner]
            weights = ridge(inputs[others], outputs[others], penalty)
            error += ((outputs[own] - inputs[own] @ weights) ** 2).sum()
        errors.append(error)
    return inputs @ ridge(inputs[fitted], outputs[fitted], PENALTIES[int(np.argmin(errors))])


def with_neighbours(points, clip):
    """Return the points of each segment and of the segments before and after it, centred."""
    n = len(points)
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
    before = np.where(clip[before] == clip, before, np.arange(n))
    after = np.where(clip[after] == clip, after, np.arange(n))
    joined = np.hstack([points[before], points, points[after]])
    return (joined - joined.mean(axis=0)) / np.sqrt(joined.var(axis=0).mean())


def gains(library):
    """Return the gain of each distance over random segments, in degrees."""
    wide = mg.Library.build(
        list(library.clips), library.groups, mg.Config(components=COMPONENTS), rate=library.rate
    )
    pool, base = wide.pool(GROUP), wide.groups.base
    unit, folds = folds_of(wide)
    outputs = wide.embedding[GROUP].points
    outputs = outputs - outputs.mean(axis=0)
    inputs = with_neighbours(wide.embedding[base].points, wide.segments.clip)
    rng, found = np.random.default_rng(0), []
    for held in np.unique(folds):
        predicted = predict(inputs, outputs, folds, held)
        spaces = (library.embedding[base].points, wide.embedding[base].points, predicted)
        for own in np.flatnonzero(folds == held).tolist():
            others = np.flatnonzero((unit != unit[own]) & pool.is_donor)
            chosen = [rng.choice(others, N_RANDOM)]
            for points in spaces:
                distances = np.linalg.norm(points[others] - points[own], axis=1)
                chosen.append(others[np.argsort(distances, kind="stable")[:N_COMPARED]])
            angles = [
                pool.pose_differences(np.full(len(donors), own), donors).mean() for donors in chosen
            ]
            found.append([angles[0] - angle for angle in angles[1:]])
    return np.degrees(np.mean(found, axis=0))


def report(options):
    """Print the tables."""
    sources = read_sources(options)
    if options.only in (None, "stability"):
        print("| source | rule | pairs in common | without a candidate |\n|---|---|---|---|")
        for source, library in sources.items():
            for name in RULES:
                common, none = stability(library, name)
                print(f"| {source} | {name} | {common:.2f} | {none:.2f} |", flush=True)
    if options.only in (None, "metric"):
        print(f"| source | segments | 10 components | {COMPONENTS} | regression |")
        print("|---|---|---|---|---|")
        for source, library in sources.items():
            cells = "".join(f" {gain:.2f}° |" for gain in gains(library))
            print(f"| {source} | {len(library.segments)} |{cells}", flush=True)
    if options.only in (None, "grafts"):
        print("| source | |" + "".join(f" {title} |" for title in COLUMNS))
        print("|---|---|" + "---|" * len(COLUMNS))
        for source, library in sources.items():
            for name in list(RULES)[-1:] if options.tiny else RULES:
                config, context = rule(name)
                with context:
                    print_row(source, name, measure(library, config, options.count))


def main(argv=None):
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", help="folders of BVH files, each one source")
    parser.add_argument("--count", type=int, default=3, help="grafts per clip")
    parser.add_argument("--only", choices=PARTS)
    return run(parser, report, argv)
