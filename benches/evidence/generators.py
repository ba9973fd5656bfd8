"""Grafts beside the generators that a reader may use instead, on the same clips."""

import math

import mograft as mg
from benches.baselines import body_mixing, catalogue, genmm, motion_arrays, motion_matching
from benches.evidence.pooling import pool, subtract
from benches.evidence.section import Section, Table, format_estimate, verdict
from benches.evidence.sources import DEVELOPMENT, TEST
from benches.measures import (
    contacts,
    distributions,
    generated_sets,
    nearest_patches,
    nearest_windows,
    tracks,
    two_sets,
)

NAME = "generators"
SOURCES = ("salsa A", "perfume", "indian", "locomotion", "gestures", "everyday", "slow walks")
HELPERS = (
    body_mixing,
    catalogue,
    genmm,
    motion_arrays,
    motion_matching,
    contacts,
    distributions,
    generated_sets,
    nearest_patches,
    nearest_windows,
    tracks,
    two_sets,
)
MAX_CLIPS = 24
N_RUNS = 3
MIN_BLOCKS = 10
CAPTURED, GRAFT = "captured", "graft"
LEFT_OUT = (
    f"The measures need {MIN_BLOCKS} blocks of five seconds, which acting, stage, boxing, "
    "estimated "
    "and video dance do not have. The experiment was not "
    "computed for the others."
)
MAX_RATIO = 1.1  # of local distances that count as about equal
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


def render(results):
    """The section."""
    test = {name: found for name, found in results.items() if name in TEST}
    development = {name: found for name, found in results.items() if name in DEVELOPMENT}
    tables = []
    for sources, title in ((test, "Test sources"), (development, "Development sources")):
        if sources:
            names = ", ".join(sources)
            tables += [
                _comparison_table(sources, title),
                _table(sources, _VARIETY, f"{title}, how new and how varied ({names})."),
                _table(sources, _REALISM, f"{title}, how similar to captured motion ({names})."),
            ]
    tables += [_source_table(results), _seconds_table(results)]
    return Section(
        anchor=NAME,
        title="Grafts beside other generators",
        question="A reader can make new motions from a few clips in other ways. How do grafts "
        "compare in variety, in similarity to captured motion, and in seconds?",
        data=f"Every source by itself, at most {MAX_CLIPS} clips of each. Every generator makes "
        f"{N_RUNS} motions of the length of every clip; all clips of the source are its examples. "
        + " ".join(f"{own.name}: {own.description}." for own in catalogue.GENERATORS)
        + " Grafts, donors, CutMix, motion matching and GenMM of the upper body keep the legs and "
        "the root of the clip. Grafts may keep the captured upper body of a segment. GenMM of the "
        "upper body and motion matching may not use the 30 frames around the replaced ones, which "
        "would give the clip itself. GenMM is reimplemented from its paper with the authors' "
        "constants, without skeleton-aware patches and without its repair of feet.",
        measure=_MEASURE,
        null="The row `captured` is captured motion itself: for the distances, coverage, density "
        "and the Fréchet distance the blocks of one half against the other half; for the AUC two "
        "random halves of the captured windows, four times, which should give 0.5; for skating "
        "the recordings.",
        tables=tuple(tables),
        conclusions=_conclusions(results),
        limits=(
            "That one generator is better. A generator that changes little is close to the "
            "recordings in every measure of similarity: compare rows of similar local distance, "
            "and `graft` with `random, same segments`, which exchanges the same segments.",
            "That the Fréchet distance is the published FID: its points are windows of 0.5 s in "
            "our embedding of the source, and few windows make it large.",
            "That motions look natural. No person has judged them.",
            "That GenMM with the parts that were left out would have the same values.",
        ),
    )


_MEASURE = (
    "Coverage (GANimator, Li et al. 2022): share of the captured windows of 1 s whose 6D rotations "
    "are within a mean L2 distance of 2 of a window of the run. Local distance: mean distance of "
    "windows of 0.5 s from the nearest captured one, root mean square of the 6D rotations per "
    "joint; a copied window has a distance of at most 0.01. Global distance: that from the nearest "
    "sequence of captured pieces of at least 1 s, by dynamic programming. Distance between runs: "
    "global distance of a motion from the next run's motion for the same clip. AUC: classifiers "
    "that tell windows of 0.57 s from captured ones, tested on other blocks than they were trained "
    "on; 0.5 is chance. Gross: trees on positions, velocities and accelerations; fine: a logistic "
    "regression that also sees jerk. Density and coverage of balls: Naeem et al. 2020, five "
    "neighbours. Fréchet distance: of windows of 0.5 s in our embedding. Skating: share of the toe "
    "contacts (below 5 cm) with a speed above 0.2 m/s, for a stature of 1.7 m; where the legs are "
    "kept it is that of the recordings. Means over sources; the intervals resample blocks of five "
    "seconds (Fréchet distance: jackknife), and n is the number of windows, pieces or contacts."
)


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


def _table(results, columns, caption):
    rows = []
    for name in _rows(results):
        cells = [
            format_estimate(_pool(results, name, key), digits, scale, suffix)
            for key, _, digits, scale, suffix in columns
        ]
        n_sources = sum(_has_values(found.get(name)) for found in results.values())
        rows.append((name, str(n_sources), *cells))
    head = ("generator", "sources", *(title for _, title, *_ in columns))
    return Table(head, tuple(rows), caption)


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
    caption = "AUC, gross, of every source; n is the number of generated windows."
    return Table(("source", "n", *names), tuple(rows), caption)


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
    return Table(
        ("generator", "CPU seconds", "n, sources"),
        tuple(rows),
        "CPU seconds for 10 s of motion, smallest and largest of the sources. The library of the "
        "source is built before; databases, graphs and libraries of single generators are "
        "included.",
    )


_SHARES = ("coverage", "copied", "gross", "fine", "embedding coverage", "skate")
_COMPARED = ("gross", "fine", "local", "inter")
_LARGER_IS_BETTER = ("density", "embedding coverage")
_DENSER = tuple((key, "below") for key in _LARGER_IS_BETTER)


def _others():
    return [own.name for own in catalogue.GENERATORS if own.name != GRAFT]


def _comparison_table(results, title):
    """The verdicts on grafts less every other generator, over sources."""
    rows, keys = [], (*_COMPARED, *_LARGER_IS_BETTER)
    for name in _others():
        found = [_differences(results, name, key) for key in keys]
        if all(found):
            rows.append((name, str(len(found[0])), *map(_short_verdicts, found)))
    titles = {key: title for key, title, *_ in (*_VARIETY, *_REALISM)}
    head = ("grafts less", "sources", *(titles[key] for key in keys))
    return Table(
        head,
        tuple(rows),
        f"{title}: in how many sources the interval of the difference from grafts lies below or "
        "above 0. Below means: grafts are harder to detect (AUC), nearer to the recordings "
        "(local distance), more similar from run to run, or less dense and less covering (last two "
        "columns, where above is in favour of grafts). The difference is that of two estimates "
        "whose errors are taken as independent.",
    )


def _short_verdicts(estimates):
    found = [verdict(own) for own in estimates]
    counts = ((found.count(own), own) for own in ("below", "above", "undecided"))
    return ", ".join(f"{n} {own}" for n, own in counts if n)


def _differences(results, name, key):
    """Return the differences of grafts from a generator in every source that has both."""
    found = [
        subtract(own[GRAFT][key], own[name][key])
        for own in results.values()
        if _has_values(own.get(GRAFT)) and _has_values(own.get(name))
    ]
    return [own for own in found if own["value"] is not None]


def _conclusions(results):
    lines = []
    for names, title in ((TEST, "test sources"), (DEVELOPMENT, "development sources")):
        chosen = {name: found for name, found in results.items() if name in names}
        if chosen:
            lines += _conclusions_of_use(chosen, title)
    lines += _seconds_conclusion(results)
    return tuple(lines)


def _conclusions_of_use(results, title):
    """Return the conclusions on the test or on the development sources."""
    values = {
        name: {key: pool(_estimates(results, name, key)) for key in _COMPARED}
        for name in _rows(results)
        if name != CAPTURED
    }
    lines = [
        f"Windows of grafts against captured windows, {title}: AUC "
        + " and ".join(
            f"{format_estimate(values[GRAFT][key], 2)} ({key}; captured motion "
            f"{format_estimate(pool(_estimates(results, CAPTURED, key)), 2, has_n=False)})"
            for key in ("gross", "fine")
        )
        + "."
    ]
    for key, what in (
        ("gross", f"The gross classifier detects grafts less well, in each of the {title}, than"),
        ("fine", f"The fine classifier detects grafts less well, in each of the {title}, than"),
        ("local", f"Grafts are nearer to the recordings, in each of the {title}, than"),
        ("inter", f"Grafts vary less from run to run, in each of the {title}, than"),
    ):
        lines.append(f"{what}: {_quoted(_decided(results, values, key))}.")
    lines += [*_against_grafts(results, title), *_distance_conclusion(values, title)]
    return lines


def _against_grafts(results, title):
    """Return in how many sources a generator is more similar to captured motion than grafts."""
    titles = {key: own for key, own, *_ in _REALISM}
    for key, sign in (*((key, "above") for key in ("gross", "fine")), *_DENSER):
        cells = []
        for name in _others():
            found = [verdict(own) for own in _differences(results, name, key)]
            if sign in found:
                cells.append(f"`{name}` in {found.count(sign)} of {len(found)}")
        yield f"Better than grafts in {titles[key]}, {title}: {', '.join(cells) or 'none'}."


def _distance_conclusion(values, title):
    if not all(math.isfinite(own["local"]["value"] or math.nan) for own in values.values()):
        return
    nearer = [
        name
        for name in values
        if values[name]["local"]["value"] <= MAX_RATIO * values[GRAFT]["local"]["value"]
        and verdict(subtract(values[name]["gross"], values[GRAFT]["gross"])) == "above"
    ]
    yield (
        f"Generators with at most {MAX_RATIO:g} times the local distance of grafts that the gross "
        f"classifier detects better, in the mean over {title}: {_quoted(nearer)}. For these, "
        "nearness to the recordings does not explain the difference."
    )


def _seconds_conclusion(results):
    """Return the CPU seconds of grafts beside the other generators."""
    largest = {
        name: max(own)
        for name in (own.name for own in catalogue.GENERATORS)
        if (own := [f[name]["seconds"] for f in results.values() if _has_values(f.get(name))])
    }
    if GRAFT in largest:
        slower = [name for name in largest if largest[name] > 2 * largest[GRAFT]]
        yield (
            f"Ten seconds of motion by grafts take at most {largest[GRAFT]:.2f} CPU seconds. More "
            f"than twice as long: {_quoted(slower)}. No generator takes more than "
            f"{max(largest.values()):.2f} s. Intervals of the times were not computed."
        )


def _quoted(names):
    return ", ".join(f"`{name}`" for name in names) or "none"


def _decided(test, values, key):
    """Return the generators whose value is larger than that of grafts in every source."""
    return [
        name
        for name in values
        if name != GRAFT and {verdict(own) for own in _differences(test, name, key)} == {"below"}
    ]
