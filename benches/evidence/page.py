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
Numbers in brackets are 95 % intervals, and n is the number that the text names. The intervals cover
the choice of segments, donors and blocks of the recordings named in the row. They do not cover the
choice of the recordings. "Better" and "worse" mean that the interval does not contain 0; by chance
this happens in about one of twenty comparisons. The seed is 0, and all recordings are resampled to
30 frames per second.
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
        else:
            lines += [heading(experiment.NAME), "", "Not measured in this run.", ""]
        refused = {name: own["refused"] for name, own in stored.items() if "refused" in own}
        if refused:
            lines += ["Not measured:", ""]
            lines += [f"- {name}: {why}" for name, why in refused.items()] + [""]
    return "\n".join(lines).rstrip() + "\n"


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
        "No constant was chosen on test sources. The Bandai-Namco files do not name their "
        "performers, so a performer of set 1 may be in both uses; set 2 has another bone table "
        "than set 1.",
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
        "The constants were not changed after the test sources were measured.",
    )
