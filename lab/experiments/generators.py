"""Grafts beside the generators that a reader may use instead, on the same clips.

Every source by itself, at most 24 clips of each; every generator makes three motions of the length
of every clip, and all clips of the source are its examples. Grafts, donors, CutMix, motion matching
and GenMM of the upper body keep the legs and the root of the clip. GenMM is reimplemented from its
paper, without skeleton-aware patches and without its repair of feet.

Coverage (GANimator, Li et al. 2022): share of the captured windows of 1 s whose 6D rotations are
within a mean L2 distance of 2 of a window of the run. Local distance: mean distance of windows of
0.5 s from the nearest captured one, root mean square of the 6D rotations per joint; a copied window
has a distance of at most 0.01. Global distance: that from the nearest sequence of captured pieces
of at least 1 s. Distance between runs: global distance of a motion from the next run's. AUC: as in
`seam_tests`, windows of the whole motion. Density and coverage of balls: Naeem et al. 2020, five
neighbours. Fréchet distance: of windows of 0.5 s in our embedding. Skating: share of the toe
contacts (below 5 cm) with a speed above 0.2 m/s, for a stature of 1.7 m. Means over sources; the
intervals resample blocks of five seconds. The row `captured` is captured motion itself.
"""

import mograft as mg
from lab.baselines import catalogue
from lab.experiments.pooling import pool, subtract
from lab.experiments.sources import DEVELOPMENT, SEVERAL, TEST, UNTOUCHED
from lab.experiments.tables import Table, format_estimate
from lab.measures import generated_sets

NAME = "generators"
SOURCES = SEVERAL
MAX_CLIPS = 24
N_RUNS = 3
MIN_BLOCKS = 10
CAPTURED, GRAFT = "captured", "graft"
QUICK = (GRAFT, "CutMix", "GenMM, upper body", "motion graph")
_VARIETY = (
    ("coverage", "coverage", 0, 100, " %"),
    ("local", "local distance", 3, 1, ""),
    ("copied", "copied windows", 0, 100, " %"),
    ("global", "global distance", 3, 1, ""),
    ("inter", "distance between runs", 3, 1, ""),
)
_REALISM = (
    ("gross", "AUC, gross", 2, 1, ""),
    ("fine", "AUC, fine", 2, 1, ""),
    ("frechet", "Fréchet distance", 1, 1, ""),
    ("density", "density", 2, 1, ""),
    ("embedding coverage", "coverage of balls", 2, 1, ""),
    ("skate", "skating contacts", 1, 100, " %"),
)


def measure(recordings, *, is_quick):
    """Return all measures of a source by generator; a generator that fails has its reason."""
    step = max(-(-len(recordings.motions) // MAX_CLIPS), 1)
    recordings = type(recordings)(recordings.name, recordings.motions[::step])
    library = recordings.library
    reference = generated_sets.Reference(library)
    if reference.n_blocks < MIN_BLOCKS:
        raise mg.InsufficientDataError(
            f"{MIN_BLOCKS} blocks of five seconds are needed, but there are {reference.n_blocks}"
        )
    studio = catalogue.Studio(library, recordings)
    found = {CAPTURED: _as_dicts(generated_sets.measure_captured(reference))}
    n_runs = 2 if is_quick else N_RUNS
    for generator in catalogue.GENERATORS:
        if is_quick and generator.name not in QUICK:
            continue
        try:
            made = [studio.make(generator, clip, n_runs) for clip in range(len(library.clips))]
        except ValueError as error:
            found[generator.name] = {"refused": str(error)}
            continue
        runs = [[motions[run] for motions, _ in made] for run in range(n_runs)]
        duration = sum(motion.n_frames for run in runs for motion in run) / library.rate
        found[generator.name] = _as_dicts(generated_sets.measure(reference, runs)) | {
            "seconds": 10 * sum(seconds for _, seconds in made) / duration
        }
    return found


def _as_dicts(estimates):
    return {name: own.as_dict() for name, own in estimates.items()}


def tables(results):
    """Variety, similarity to captured motion and seconds by generator."""
    found = {}
    for use, names in (("test", TEST), ("development", DEVELOPMENT), ("untouched", UNTOUCHED)):
        chosen = {name: own for name, own in results.items() if name in names}
        if chosen:
            found[f"variety-{use}"] = _table(chosen, _VARIETY)
            found[f"realism-{use}"] = _table(chosen, _REALISM)
    return found | {
        "differences": _difference_table(results),
        "auc": _source_table(results),
        "seconds": _seconds_table(results),
    }


def _rows(results):
    return [
        name
        for name in (CAPTURED, *(own.name for own in catalogue.GENERATORS))
        if any(_has_values(found.get(name)) for found in results.values())
    ]


def _has_values(found):
    return found is not None and "refused" not in found


def _estimates(results, generator, key):
    return [
        found[generator][key] for found in results.values() if _has_values(found.get(generator))
    ]


def _pool(results, generator, key):
    """Return the mean over sources; the interval of a share ends at 0 and 1."""
    found = pool(_estimates(results, generator, key))
    if key in _SHARES and found["interval"] is not None:
        found["interval"] = [min(max(end, 0.0), 1.0) for end in found["interval"]]
    return found


def _table(results, columns):
    rows = []
    for name in _rows(results):
        cells = [
            format_estimate(_pool(results, name, key), digits, scale, suffix)
            for key, _, digits, scale, suffix in columns
        ]
        n_sources = sum(_has_values(found.get(name)) for found in results.values())
        rows.append((name, str(n_sources), *cells))
    head = ("generator", "sources", *(title for _, title, *_ in columns))
    return Table(head, rows)


def _source_table(results):
    names = _rows(results)
    rows = []
    for source, found in results.items():
        cells = [
            format_estimate(found[name]["gross"], 2, has_n=False)
            if _has_values(found.get(name))
            else "-"
            for name in names
        ]
        n = next(
            (found[name]["gross"]["n"] for name in names[1:] if _has_values(found.get(name))), 0
        )
        rows.append((source, str(n), *cells))
    return Table(("source", "n", *names), rows)


def _seconds_table(results):
    rows = []
    for generator in catalogue.GENERATORS:
        own = [
            found[generator.name]["seconds"]
            for found in results.values()
            if _has_values(found.get(generator.name))
        ]
        if own:
            rows.append((generator.name, f"{min(own):.2f} to {max(own):.2f}", str(len(own))))
    return Table(("generator", "CPU seconds", "n, sources"), rows)


_SHARES = ("coverage", "copied", "gross", "fine", "embedding coverage", "skate")


def _difference_table(results):
    """Grafts less every other generator, source by source."""
    titles = {key: title for key, title, *_ in (*_VARIETY, *_REALISM)}
    rows = []
    for source, found in results.items():
        for generator in catalogue.GENERATORS[1:]:
            if _has_values(found.get(generator.name)) and _has_values(found.get(GRAFT)):
                cells = [
                    format_estimate(
                        subtract(found[GRAFT][key], found[generator.name][key]), 3, has_n=False
                    )
                    for key in _COMPARED
                ]
                rows.append((source, generator.name, *cells))
    return Table(("source", "grafts less", *(titles[key] for key in _COMPARED)), rows)


_COMPARED = ("gross", "fine", "local", "inter", "density", "embedding coverage")
