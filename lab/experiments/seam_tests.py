"""Can a classifier find seams? Every seam treatment with the same donors.

ROC AUC of two classifiers on windows of 0.57 s at seams; 0.5 is chance. They are trained and tested
on different blocks of five seconds, those of the donors included. Gross: trees on positions,
velocities and accelerations; fine: a logistic regression that also sees jerk
(`mograft.evaluation.detectability`). All treatments have the same donors; self-repair is off. Null:
captured windows at other seams of the same block, and captured windows of the donors.
"""

import warnings
from dataclasses import replace

import numpy as np

from lab.experiments.pooling import pool, subtract
from lab.experiments.sources import DEVELOPMENT, SEVERAL, TEST, UNTOUCHED
from lab.experiments.tables import Table, format_estimate
from mograft import Config, InsufficientDataError
from mograft.evaluation.detectability import MIN_WINDOWS, block_folds, detect, pair_other_moments
from mograft.evaluation.windows import GraftWindows
from mograft.solve.plan import GraftPlan
from mograft.synthesis.graft_building import build_graft

NAME = "seams"
SOURCES = (*SEVERAL, "acting")
MAX_CLIPS = 40
N_RUNS, N_SPLITS = 4, 2
MAX_WINDOWS = 1200
TREATMENTS = ("gradient", "offset", "paper", "displacement", "inertial")
DEFAULT = Config().seam
NULLS = ("captured, other moments", "captured, donors")


def choose_donors(library, n_runs, seed=0):
    """Return the donor sequences of every clip, chosen by the configuration of the library."""
    plans = [GraftPlan.build(library, clip, None, ()) for clip in range(len(library.clips))]
    return [plan.choose_donors(n_runs, seed) for plan in plans]


def treat(library, chosen, treatment):
    """Return the grafts of given donors with one seam treatment, without self-repair."""
    config = replace(library.config, seam=treatment, self_repair=False)
    treated = library.relabelled(config)
    grafts = []
    for clip, sequences in enumerate(chosen):
        plan = GraftPlan.build(treated, clip, None, ())
        grafts += [build_graft(plan, own, 0, run) for run, own in enumerate(sequences)]
    return grafts


def measure(recordings, *, is_quick):
    """Return the AUC of both classifiers by seam treatment, and of the null comparisons."""
    step = max(-(-len(recordings.motions) // MAX_CLIPS), 1)
    library = type(recordings)(recordings.name, recordings.motions[::step]).library
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chosen = choose_donors(library, 2 if is_quick else N_RUNS)
        found = {}
        for name in TREATMENTS:
            grafts = treat(library, chosen, name)
            windows = GraftWindows.of(grafts, "seams", MAX_WINDOWS, np.random.default_rng(0))
            if len(windows) < MIN_WINDOWS:
                raise InsufficientDataError(
                    f"{MIN_WINDOWS} windows at seams are needed, but there are {len(windows)}"
                )
            n_splits = 1 if is_quick else N_SPLITS
            folds = [block_folds(windows.frames, (0, split)) for split in range(n_splits)]
            pairs = windows.pairs()
            found[name] = detect([pairs] * n_splits, folds, 0)
    rng = np.random.default_rng(0)
    others = [pair_other_moments(pairs, rng) for _ in folds]
    found[NULLS[0]] = detect(others, folds, 0)
    found[NULLS[1]] = detect([windows.donor_pairs()] * n_splits, folds, 0)
    substitutions = [own for graft in grafts for own in graft.substitutions]
    exchanged = sum(not own.is_own for own in substitutions)
    return {
        "auc": {name: own.as_dict() for name, own in found.items()},
        "grafts": len(grafts),
        "exchanged": exchanged,
        "segments": len(substitutions),
    }


def tables(results):
    """AUC by treatment, and of every source, and the AUC of others less that of the default."""
    uses = {"test": TEST, "development": DEVELOPMENT, "untouched": UNTOUCHED}
    pooled = {
        f"auc-{use}": _table(own)
        for use, names in uses.items()
        if (own := {name: found for name, found in results.items() if name in names})
    }
    return pooled | {"sources": _source_table(results), "differences": _difference_table(results)}


def _names(results):
    return [*NULLS, *next(iter(results.values()))["auc"]][: len(NULLS) + len(TREATMENTS)]


def _table(results):
    rows = [
        (
            name,
            *(
                format_estimate(pool([own["auc"][name][key] for own in results.values()]), 2)
                for key in ("gross", "fine")
            ),
        )
        for name in _names(results)
    ]
    return Table(("seam", "AUC, gross", "AUC, fine"), rows)


def _source_table(results):
    names = _names(results)
    rows = [
        (
            name,
            str(own["auc"]["offset"]["fine"]["n"]),
            *(format_estimate(own["auc"][seam]["fine"], 2, has_n=False) for seam in names),
        )
        for name, own in results.items()
    ]
    return Table(("source", "n", *names), rows)


def _differences(results, other, key):
    """Return the AUC of a treatment less that of the default, by source."""
    found = {
        name: subtract(own["auc"][other][key], own["auc"][DEFAULT][key])
        for name, own in results.items()
    }
    return {name: own for name, own in found.items() if own["value"] is not None}


def _difference_table(results):
    """The AUC of other treatments, and of captured motion, less that of the default."""
    others = (NULLS[0], "offset", "paper")
    rows = [
        (
            name,
            *(
                format_estimate(_differences({name: own}, other, key)[name], 2, has_n=False)
                if _differences({name: own}, other, key)
                else "-"
                for key in ("gross", "fine")
                for other in others
            ),
        )
        for name, own in results.items()
    ]
    head = ("source", *(f"{other}, {key}" for key in ("gross", "fine") for other in others))
    return Table(head, rows)
