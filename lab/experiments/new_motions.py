"""Experiment 5.1 of the paper: smoothness of new motions, at equal numbers of candidates.

Mean gap of poses at seams before their treatment; acceleration and jerk of the grafted joints,
divided by those of the recording; and the mean joint angle between
grafts. Null: random donors, all of them or as many of similar length as analogy has for the same
segment, drawn at random or selected by the same costs. `analogy, by cost` is the default
configuration before self-repair.
"""

from dataclasses import dataclass

import numpy as np

from lab.donors.methods import Analogy, ByCost, Nearest, Random
from lab.experiments.bases import choose_bases
from lab.experiments.sources import UNTOUCHED
from lab.experiments.tables import Table, format_estimate
from mograft.evaluation import Method, RandomLength, estimate, grafts_by
from mograft.evaluation.quality import quality

NAME = "new-motions"
SOURCES = (
    "salsa A",
    "salsa B",
    "perfume",
    "indian",
    "basketball",
    "slow walks",
    "locomotion",
    *UNTOUCHED,
)
_BLOCK_FRAMES = 75


@dataclass(frozen=True)
class EqualCount(Method):
    """As many random donors of similar length as analogy has for the same segment."""

    name: str = "random, as many"

    def candidates(self, library, scenario):
        """As `Method.candidates`."""
        rng = np.random.default_rng(0)
        found = []
        counts = [len(own) - 1 for own in Analogy().candidates(library, scenario)]
        several = RandomLength().candidates(library, scenario)
        for segment, own, count in zip(scenario.tolist(), several, counts, strict=True):
            others = own[own != segment]
            chosen = rng.choice(others, min(count, len(others)), replace=False)
            found.append(np.sort(np.append(chosen, segment)))
        return found


RANDOM_BY_COST = "random, as many, by cost"
NEAREST_BY_COST = "nearest, as many, by cost"
METHODS = (
    Random(),
    EqualCount(),
    EqualCount(RANDOM_BY_COST, uses_cost=True),
    Nearest(NEAREST_BY_COST, uses_cost=True),
    Analogy(),
    ByCost(),
)
RATIOS = {
    "random, both drawn at random": ("analogy", "random, as many"),
    "random, both by cost": (ByCost.name, RANDOM_BY_COST),
    "nearest, both by cost": (ByCost.name, NEAREST_BY_COST),
}


def measure(recordings, *, is_quick):
    """Quality of the grafts of each method on a source, and ratios of seam gaps."""
    library = recordings.library
    names, n_grafts = choose_bases(library, is_quick=is_quick)
    qualities, gaps = {}, {}
    for method in METHODS:
        grafts = [list(grafts_by(method, library, name, n_grafts, seed=0)) for name in names]
        qualities[method.name] = quality(method.name, grafts).as_dict()
        gaps[method.name] = _gaps(grafts)
    ratios = {
        title: _ratio(gaps[first], gaps[second]).as_dict()
        for title, (first, second) in RATIOS.items()
    }
    return {"quality": qualities, "ratios": ratios}


def _gaps(grafts):
    """Return the gap and the block of each seam."""
    rows = [
        (seam.gap, base * 100_000 + seam.frame // _BLOCK_FRAMES)
        for base, several in enumerate(grafts)
        for graft in several
        for seam in graft.seams
    ]
    return np.array(rows).reshape(-1, 2)


def _ratio(first, second):
    """Return the mean of the first gaps divided by that of the second; blocks are resampled."""
    blocks = np.intersect1d(first[:, 1], second[:, 1])
    sums = [[rows[rows[:, 1] == block, 0] for block in blocks] for rows in (first, second)]
    totals = np.array([[own.sum() for own in several] for several in sums]).reshape(2, -1)
    counts = np.array([[len(own) for own in several] for several in sums]).reshape(2, -1)

    def statistic(multiplicities):
        means = [multiplicities @ totals[i] / (multiplicities @ counts[i]) for i in (0, 1)]
        return means[0] / means[1]

    if not len(blocks):
        return estimate.Estimate.without_value(0, "seams", "block bootstrap")
    value = float(statistic(np.ones((1, len(blocks))))[0])
    n = int(counts[0].sum())
    return estimate.bootstrap_estimate(value, statistic, len(blocks), n=n, unit="seams", seed=0)


_COLUMNS = {
    "new_segments": ("exchanged, %", 0, 100),
    "seam_gap": ("seam gap, degrees", 1, 1),
    "acceleration": ("acceleration", 2, 1),
    "jerk": ("jerk", 2, 1),
    "diversity": ("between grafts, degrees", 1, 1),
}


def tables(results):
    """Quality by donors, and the seam gaps of analogy divided by those of as many others."""
    rows = [
        (
            name,
            method,
            *(
                format_estimate(found[key], digits, scale)
                for key, (_, digits, scale) in _COLUMNS.items()
            ),
        )
        for name, result in results.items()
        for method, found in result["quality"].items()
    ]
    ratios = [
        (name, *(format_estimate(result["ratios"][title]) for title in RATIOS))
        for name, result in results.items()
    ]
    return {
        "quality": Table(("source", "donors", *(c[0] for c in _COLUMNS.values())), rows),
        "gaps": Table(("source", *RATIOS), ratios),
    }
