"""Can a classifier find seams? Every seam treatment with the same donors."""

import warnings
from dataclasses import replace

import numpy as np

from benches.evidence.pooling import pool, subtract
from benches.evidence.section import Section, Table, format_estimate, plain_reading
from benches.evidence.sources import DEVELOPMENT, TEST
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.config import Config
from mograft.errors import InsufficientDataError
from mograft.evaluation.detectability import MIN_WINDOWS, pair_other_moments
from mograft.evaluation.two_sample import block_folds, detect
from mograft.evaluation.windows import GraftWindows
from mograft.synthesis.graft_plan import GraftPlan

NAME = "seams"
SOURCES = (
    "salsa A",
    "perfume",
    "indian",
    "locomotion",
    "gestures",
    "everyday",
    "slow walks",
    "acting",
)
LEFT_OUT = (
    "boxing was measured, but has too few blocks of five seconds for an interval; "
    "`actions and styles` has the actions of locomotion and gestures. The "
    "experiment was not computed for the others."
)
MAX_CLIPS = 40
N_RUNS, N_SPLITS = 4, 2
MAX_WINDOWS = 1200
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
        grafts += [plan.build_graft(own, 0, run) for run, own in enumerate(sequences)]
    return grafts


def measure(recordings, *, is_quick):
    """Return the AUC of both classifiers by seam treatment, and of the null comparisons."""
    step = max(-(-len(recordings.motions) // MAX_CLIPS), 1)
    library = type(recordings)(recordings.name, recordings.motions[::step]).library
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        chosen = choose_donors(library, 2 if is_quick else N_RUNS)
        found = {}
        for name in SEAM_TREATMENTS.names:
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


def render(results):
    """The section."""
    test = {name: found for name, found in results.items() if name in TEST}
    development = {name: found for name, found in results.items() if name in DEVELOPMENT}
    tables = [
        _table(sources, title)
        for sources, title in ((test, "test sources"), (development, "development sources"))
        if sources
    ]
    return Section(
        anchor=NAME,
        title="Can a classifier find the seams?",
        question="Do windows around seams differ from the captured windows at the same frames, and "
        "by how much for each seam treatment?",
        data=f"Every source by itself, at most {MAX_CLIPS} clips. {N_RUNS} grafts of every clip. "
        "All treatments have the same donors, chosen with the default configuration, so that the "
        "exchanged segments are the same; self-repair is off. The treatments are defined in "
        "[seams](seams.md): `gradient` (default), `offset`, `paper`, `displacement`, `inertial`, "
        "`dead`.",
        measure="ROC AUC of two classifiers on windows of 0.57 s at seams; 0.5 is chance. They are "
        f"trained and tested on different blocks of five seconds ({N_SPLITS} random assignments to "
        "three folds), those of the donors included. Gross: trees on positions, velocities and "
        "accelerations; fine: a logistic regression that also sees jerk "
        "(`mograft.evaluation.detectability`). Means over sources; the intervals resample blocks; "
        "n is the number of windows. Differences are those of two estimates whose errors are taken "
        "as independent; the windows are the same, so that their intervals are usually too wide.",
        null="`captured, other moments`: windows of the recording at other seams in the same "
        "block. `captured, donors`: the captured windows that the donors come from, whole bodies. "
        "Its AUC is above 0.5 if the donors differ from the segments that they replace: that part "
        "is no fault of a seam.",
        tables=(*tables, _source_table(results), _difference_table(results)),
        conclusions=(
            *_conclusions(test, "Test sources"),
            *_conclusions(development, "Development sources"),
        ),
        limits=(
            "That a person sees the seams: the classifiers compare half a second of all bone ends.",
            "That an AUC of 0.5 means no difference: other classifiers may find one.",
            "That motion between seams is captured motion: a treatment that changes whole segments "
            "changes it, too, and the tables have windows at seams only.",
            f"That `{DEFAULT}` is harder to detect in every configuration. In the "
            "[ablation](#ablation) its step, made before the lean of the trunk, raises the head "
            "jerk, and the fine AUC in some sources; here all treatments have the lean.",
        ),
    )


def _names(results):
    return [*NULLS, *next(iter(results.values()))["auc"]][: len(NULLS) + len(SEAM_TREATMENTS.names)]


def _table(results, title):
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
    exchanged = sum(own["exchanged"] for own in results.values())
    segments = sum(own["segments"] for own in results.values())
    return Table(
        ("seam", "AUC, gross", "AUC, fine"),
        tuple(rows),
        f"Means over {len(results)} {title} ({', '.join(results)}); {exchanged} of {segments} "
        "segments are exchanged with every treatment.",
    )


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
    return Table(("source", "n", *names), tuple(rows), "AUC, fine, of every source.")


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
    return Table(
        head,
        tuple(rows),
        f"AUC less that of `{DEFAULT}`; above 0, `{DEFAULT}` is harder to detect.",
    )


def _conclusions(test, use):
    if not test:
        return (f"{use}: none was measured.",)
    lines = []
    for key in ("gross", "fine"):
        means = {
            name: pool([own["auc"][name][key] for own in test.values()]) for name in _names(test)
        }
        order = sorted(
            (name for name in SEAM_TREATMENTS.names if means[name]["value"] is not None),
            key=lambda name: means[name]["value"],
        )
        ranks = ", ".join(f"{name} {format_estimate(means[name], has_n=False)}" for name in order)
        nulls = ", ".join(f"{name} {format_estimate(means[name], has_n=False)}" for name in NULLS)
        lines.append(
            f"{use}, AUC, {key}, mean, from the hardest to the easiest to detect: {ranks}. For "
            "comparison: "
            f"{nulls}."
        )
        for other in (NULLS[0], "offset", "paper"):
            differences = _differences(test, other, key)
            title = f"`{other}`"
            reading = plain_reading(f"`{DEFAULT}`, the default,", title, differences)
            lines.append(f"{use}, AUC, {key}, lower is better: {reading}")
    return tuple(lines)
