"""From the parameters of the paper to the defaults, one change after the other."""

import math
from dataclasses import replace

import numpy as np

import mograft as mg
from benches.evidence import bases
from benches.evidence.bases import MAX_BASES, MIN_GRAFTS, N_GRAFTS, choose_bases
from benches.evidence.section import Section, Table, count_names, format_estimate
from mograft.evaluation import Analogy, RandomLength, compatibility, estimate
from mograft.evaluation.two_sample import block_folds, detect, empty_detection
from mograft.evaluation.windows import GraftWindows
from mograft.evaluation.world_measures import WorldReference

NAME = "ablation"
HELPERS = (bases,)
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
    "choice by cost": _defaults("choice"),
    "seam treatment gradient": _defaults("seam"),
    "lean of the trunk": {"torso": "world"},
    "sway of the pelvis": _defaults("torso"),
    "weight of balance": _defaults("balance_weight"),
    "self-repair: the defaults": _defaults("self_repair", "feet", "reach_ik"),
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
    *("choice", "seam", "torso", "balance_weight", "self_repair", "feet", "reach_ik"),
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


def render(results):
    """The section."""
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
    return Section(
        anchor=NAME,
        title="What does each deviation from the paper change?",
        question="The defaults differ from the parameters of the paper. What does each difference "
        "change, if they are made one after the other?",
        data=f"Up to {MAX_BASES} clips of each source as bases, {N_GRAFTS} grafts of each, "
        f"and at least {MIN_GRAFTS} in all. Each "
        "row has the changes of all rows above it. The row `paper` is `Config.paper()`, the last "
        "row `Config()`.",
        measure="Share of exchanged segments; mean gap at "
        "seams before their treatment; κ of the "
        "donors with captured and random parts of the same segments "
        "([matched comparison](#matched)); area under the ROC curve of classifiers at seams (0.5 "
        "is chance); median jerk of the head in the world, divided by that of base and donors. n "
        "is the number "
        "of parts, seams, segments, windows and grafts. Intervals resample blocks of ten segments "
        "(exchanged), of 2.5 s (gap) or of five seconds (detectability), clips or blocks (κ), and "
        "grafts (head jerk).",
        null="Detectability of captured motion is 0.5. The number of windows falls for two "
        "reasons: a graft that equals its base has no seam, and a window counts only if the blocks "
        "of its base and of its donors are in the same fold, which is rarer where most parts are "
        "exchanged (locomotion, slow walks). With too few windows there is no value (-), or no "
        "interval. The head jerk of a recording is 1.",
        tables=(Table(("source", "step", *(c[0] for c in _COLUMNS.values())), tuple(rows)),),
        conclusions=_conclusions(results),
        limits=(
            "That a step has the effect of its row in general: the order of the steps is one of "
            "many, and another order distributes the changes differently.",
            "That two rows differ, or do not differ, where their intervals overlap: intervals of "
            "differences between rows were not computed.",
            "That κ of rows with few segments, or with a classifier near chance, shows anything: "
            "its intervals are wide or missing.",
            "That `gradient` is worse or better than other treatments in the default "
            "configuration: its row is before that of the lean of the trunk. "
            "[Seams](#seams) compares the treatments with the donors and the lean of the defaults, "
            "without self-repair.",
        ),
        notes=("The sources are both development and test sources; see the first table.",),
    )


def _conclusions(results):
    lines = []
    for key, (title, digits, scale) in _COLUMNS.items():
        cells, n_larger = [], 0
        for name, steps in results.items():
            first, last = (steps[step][key] for step in (*STEPS,)[:: len(STEPS) - 1])
            if first["value"] is not None and last["value"] is not None:
                ends = [format_estimate(own, digits, scale) for own in (first, last)]
                cells.append(f"{name} {ends[0]} → {ends[1]}")
                n_larger += last["value"] > first["value"]
        if cells:
            lines.append(
                f"From the paper's parameters to the defaults, {title}: {'; '.join(cells)}. The "
                f"value is larger with the defaults in {n_larger} of {len(cells)} sources."
            )
    for key, sign, title in (
        ("exchanged", 1, "raises the exchanged share"),
        ("fine", -1, "lowers the fine detectability"),
        ("head", -1, "lowers the head jerk"),
    ):
        steps = [f"{name}: {_largest_step(own, key, sign)}" for name, own in results.items()]
        lines.append(f"The step that {title} most: {'; '.join(steps)}.")
    lines += _gradient_conclusion(results)
    return tuple(lines)


def _gradient_conclusion(results):
    """Return what the step to the seam treatment `gradient` changes, by its values."""
    titles = list(STEPS)
    step = titles.index("seam treatment gradient")
    cells = []
    for key in ("head", "gross", "fine"):
        changes = {
            name: last - first
            for name, steps in results.items()
            for first, last in [[steps[titles[i]][key]["value"] for i in (step - 1, step)]]
            if None not in (first, last)
        }
        higher = [name for name, own in changes.items() if own > 0]
        lower = [name for name, own in changes.items() if own < 0]
        cells.append(
            f"{_COLUMNS[key][0]} rises in {count_names(higher)} and falls in {count_names(lower)} "
            f"of {len(changes)} sources"
        )
    if results:
        yield f"At the step to the treatment `gradient` (before rounding), {'; '.join(cells)}."


def _largest_step(steps, key, sign):
    """Return the step after which a value rises (sign 1) or falls (sign -1) most."""
    titles = [title for title, own in steps.items() if own[key]["value"] is not None]
    values = [sign * steps[title][key]["value"] for title in titles]
    return titles[int(np.argmax(np.diff(values))) + 1] if len(values) > 1 else "not measured"
