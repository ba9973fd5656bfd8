"""The page of all experiments: their order, the tables of sources and constants, the text."""

import importlib

from benches.evidence.constants import CONSTANTS
from benches.evidence.section import Table, heading
from benches.evidence.sources import SOURCES

EXPERIMENTS: tuple[str, ...] = (
    "retrieval",
    "matched",
    "ablation",
    "new_motions",
    "collisions",
    "counts",
    "balance",
    "seam_tests",
    "generators",
    "learning",
)
"""Modules of `benches.evidence`, in the order of the page."""

HEADER = """# Evidence

`python benches/experiments.py --write` writes this page; every figure on it comes from that script.
Two numbers in brackets after a value are its 95 % interval, with three exceptions that the sections
state: null columns and the last column in [retrieval](#retrieval) (range of 95 % of the shuffles),
[counts](#counts) (range of 95 % of the draws), and the shares of segments in [matched](#matched).
The measure of each section names what n counts. The intervals come from resampling: clips, or
blocks of segments or frames, of the recordings named in the row, placements in
[collisions](#collisions), and draws of training clips in [learning](#learning). They do not cover
the choice of the recordings. "Better" and "worse" mean that the interval of the difference does not
contain 0; without any difference this happens in about one of twenty comparisons. "Undecided" means
that the interval contains 0 or does not exist. It does not show that two methods are equal.
Constants were chosen on the development sources, so only the test sources are held out. The seed is
0, and all recordings are resampled to 30 frames per second.

Experiments 5.1, 5.2, 5.4 and 5.5 are those of the paper. Experiment 5.3, on naturalness, is
missing, because no person has judged motions; [matched](#matched) has a classifier instead.
"""


def experiments():
    """Return the modules of all experiments, in the order of the page."""
    return [importlib.import_module(f"benches.evidence.{name}") for name in EXPERIMENTS]


def write_page(results, facts, notes):
    """Return the page.

    `results` maps the name of an experiment to the stored values by source, `facts` the name of a
    source to its numbers of clips, frames and segments. `notes` are sentences about the run.
    """
    lines = [*HEADER.splitlines(), "", *notes, "", "## Recordings and constants", ""]
    lines += _sources_table(facts).lines()
    lines += _constants_table().lines()
    for experiment in experiments():
        stored = results.get(experiment.NAME, {})
        measured = {name: own["value"] for name, own in stored.items() if "value" in own}
        if measured:
            lines += experiment.render(measured).lines()
            lines += list_left_out(experiment)
        else:
            lines += [heading(experiment.NAME), "", "Not measured in this run.", ""]
        refused = {name: own["refused"] for name, own in stored.items() if "refused" in own}
        if refused:
            lines += ["Not measured:", ""]
            lines += [f"- {name}: {why}" for name, why in refused.items()] + [""]
    return "\n".join(lines).rstrip() + "\n"


def list_left_out(experiment):
    """Return the lines on the sources that an experiment does not have."""
    names = [name for name in SOURCES if name not in experiment.SOURCES]
    if not names:
        return []
    reason = getattr(experiment, "LEFT_OUT", "The experiment was not computed for them.")
    return [f"Sources that are not in this section: {', '.join(names)}. {reason}", ""]


def _sources_table(facts):
    rows = [
        (
            name,
            "test" if SOURCES[name].is_test else "development",
            SOURCES[name].description,
            *map(str, facts[name]),
        )
        for name in SOURCES
        if name in facts
    ]
    return Table(
        ("source", "use", "recordings", "clips", "frames", "segments"),
        tuple(rows),
        "No constant was chosen on the clips of test sources. The six clips of Bandai-Namco set 1 "
        "on which constants were chosen (table below) have the normal style, which `everyday` "
        "leaves out, so that no clip is in both uses. The files do not name their performers: a "
        "performer of set 1 may be in both uses, and `everyday` is then not independent of the "
        "constants. Set 2 has another bone table than set 1. The segments are those of the "
        "default configuration; other configurations and the removal of faulty segments give "
        "other numbers in the sections.",
    )


def _constants_table():
    rows = [
        (
            own.name,
            f"{own.value:.4g}" if isinstance(own.value, float) else str(own.value),
            own.paper,
            own.chosen_on,
        )
        for own in CONSTANTS
    ]
    return Table(
        ("constant", "value", "in the paper", "chosen on"),
        tuple(rows),
        "Three constants were changed after the test sources had been measured. Their former "
        "values are 2 (angle scale / typical angle), 5 (`Config.novelty`) and 1 "
        "(`Config.temperature`). The new values were chosen on development sources, but some other "
        "values of these constants had been tried on test sources too. All results were then "
        "measured again with the values of this table. The recordings of salsa, perfume and indian "
        "are in folders whose names begin with `dance_`.",
    )
