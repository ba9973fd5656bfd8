"""From the parameters of the paper to the defaults, one change after the other.

Each row has the changes of all rows above it; the row `paper` is `Config.paper()`, the last row
`Config()`. Share of exchanged segments; mean gap at seams before their treatment; κ of the donors
with captured and random parts of the same segments; AUC of classifiers at seams (0.5 is chance);
median jerk of the head in the world, divided by that of base and donors. Intervals resample blocks,
clips (κ) or grafts (head jerk).
"""

import math
from dataclasses import replace

import numpy as np

import mograft as mg
from lab.donors.compatibility import compatibility
from lab.donors.methods import Analogy
from lab.experiments.bases import choose_bases
from lab.experiments.tables import Table, format_estimate
from mograft.evaluation import RandomLength, estimate
from mograft.evaluation.detectability import block_folds, detect, empty_detection
from mograft.evaluation.windows import GraftWindows
from mograft.evaluation.world_measures import WorldReference

NAME = "ablation"
SOURCES = ("salsa A", "perfume", "slow walks", "stage", "locomotion")
_DEFAULT = mg.Config()


def _defaults(*names):
    return {name: getattr(_DEFAULT, name) for name in names}


STEPS = {
    "paper": {},
    "segments of 0.1 to 2 s": _defaults("min_length", "max_length"),
    "without heading": _defaults("keep_heading"),
    "floors of the scales": _defaults("rotation_floor", "position_floor", "length_floor"),
    "threshold 0.75 rms": _defaults("sigma", "sigma_scale"),
    "length slack of a frame": _defaults("length_slack"),
    "balls for clusters": _defaults("neighbourhood"),
    "choice by cost": _defaults("choice"),
    "seam treatment gradient": _defaults("seam"),
    "lean of the trunk": _defaults("torso"),
    "weight of balance": _defaults("balance_weight"),
    "self-repair: the defaults": _defaults("self_repair", "feet", "reach_ik", "loop"),
}
"""The fields of `Config` that each step sets, in addition to the steps before."""
MAX_WINDOWS = 500
MIN_WINDOWS = 60


def configs():
    """Return the configuration of each step."""
    found, config = {}, mg.Config.paper()
    for title, fields in STEPS.items():
        config = replace(config, **fields)
        found[title] = config
    if config != _DEFAULT:
        raise AssertionError("the steps do not lead to the defaults")
    return found


def measure(recordings, *, is_quick):
    """The measures of each step on a source."""
    found, kappa, previous = {}, None, None
    for title, config in configs().items():
        library = recordings.build(config)
        # κ does not depend on choice, seams and repair.
        pairs = replace(config, **_defaults(*_WITHOUT_EFFECT_ON_PAIRS))
        if pairs != previous:
            kappa, previous = _kappa(library), pairs
        found[title] = {"kappa": kappa, **_measure_grafts(library, is_quick=is_quick)}
    return found


_WITHOUT_EFFECT_ON_PAIRS = (
    *("neighbourhood", "choice", "seam", "torso"),
    *("balance_weight", "self_repair", "feet", "reach_ik", "loop"),
)


def _kappa(library):
    try:
        found = compatibility(library, methods=(RandomLength(), Analogy()), splits=1)
    except mg.InsufficientDataError:
        return estimate.Estimate.without_value(0, "segments with a donor", "").as_dict()
    return found.scores[1].matched.as_dict()


def _measure_grafts(library, *, is_quick):
    names, n_grafts = choose_bases(library, is_quick=is_quick)
    several = [list(mg.graft_many(library, name, n_grafts, seed=0)) for name in names]
    flat = [graft for own in several for graft in own]
    parts = [
        (not own.is_own, (base, own.segment // estimate.BLOCK_SEGMENTS))
        for base, grafts in enumerate(several)
        for graft in grafts
        for own in graft.substitutions
    ]
    seams = [
        (math.degrees(seam.gap), (base, seam.frame // 75))
        for base, grafts in enumerate(several)
        for graft in grafts
        for seam in graft.seams
    ]
    reference = WorldReference(library)
    jerks = [reference.measure(graft).head_jerk for graft in flat]
    found = {
        "exchanged": _block_mean(parts, "parts").as_dict(),
        "gap": _block_mean(seams, "seams").as_dict(),
        "head": estimate.block_mean(jerks, range(len(jerks)), "grafts").as_dict(),
    }
    detection = _detect(flat)
    return {**found, "gross": detection.gross.as_dict(), "fine": detection.fine.as_dict()}


def _block_mean(rows, unit):
    if not rows:
        return estimate.Estimate.without_value(0, unit, "block bootstrap")
    values, keys = zip(*rows, strict=True)
    blocks = np.unique(np.array(keys), axis=0, return_inverse=True)[1].reshape(-1)
    return estimate.block_mean(values, blocks, unit)


def _detect(grafts):
    windows = GraftWindows.of(grafts, "seams", MAX_WINDOWS, np.random.default_rng(0))
    if len(windows) < MIN_WINDOWS:
        return empty_detection()
    return detect([windows.pairs()], [block_folds(windows.frames, (0, 0))], 0)


_COLUMNS = {
    "exchanged": ("exchanged, %", 0, 100),
    "gap": ("seam gap, degrees", 1, 1),
    "kappa": ("matched κ", 2, 1),
    "gross": ("detectability, gross", 2, 1),
    "fine": ("detectability, fine", 2, 1),
    "head": ("head jerk", 2, 1),
}


def tables(results):
    """The measures of each step."""
    rows = [
        (
            name,
            title,
            *(
                format_estimate(found[key], digits, scale)
                for key, (_, digits, scale) in _COLUMNS.items()
            ),
        )
        for name, steps in results.items()
        for title, found in steps.items()
    ]
    return {"steps": Table(("source", "step", *(c[0] for c in _COLUMNS.values())), rows)}
