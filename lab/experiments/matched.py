"""Matched comparison of the rules of donor selection by compatibility κ.

A classifier learns which upper bodies were captured with which legs. κ is 0 if the parts of a rule
are accepted as often as random ones, 1 if as often as captured ones. The differences are those of
analogy and another rule on the segments for which both have a donor. Null: the upper bodies of all
segments are shuffled before everything else; κ is then undefined, and the table has the difference
of the acceptance rates in percentage points. See `lab.donors.compatibility`.
"""

from lab.donors.compatibility import compatibility
from lab.donors.methods import Analogy, Ball, ContactPattern, Nearest
from lab.experiments.sources import SOURCES as ALL_SOURCES
from lab.experiments.tables import Table, format_estimate
from lab.experiments.verdicts import KAPPA_MARGIN, count_verdicts, verdict
from mograft.body.contacts import find_legs
from mograft.evaluation import RandomLength

NAME = "matched"
SOURCES = tuple(name for name in ALL_SOURCES if name != "actions and styles")
METHODS = (RandomLength(), ContactPattern(), Nearest(), Ball(), Analogy())
REFERENCE = "analogy"
COMPARED = ("random, length limit", "contact pattern", "nearest neighbours", "ball")
N_SPLITS = 2


def measure(recordings, *, is_quick):
    """κ of each rule on a source, and the differences with shuffled parts."""
    library = recordings.library
    methods = [method for method in METHODS if _is_possible(method, library)]
    splits = 1 if is_quick else N_SPLITS
    found = compatibility(library, methods=methods, splits=splits).as_dict()
    null = compatibility(library, methods=methods, splits=splits, is_null=True).as_dict()
    return {"found": found, "null": null["differences"]}


def _is_possible(method, library):
    return method.name != "contact pattern" or bool(find_legs(library.skeleton))


def _differences(rows):
    """Return the differences of analogy from the other rules, by name of the rule."""
    return {row["second"]: row for row in rows if row["first"] == REFERENCE}


def tables(results):
    """Differences of analogy from other rules, and the accepted parts of all rules."""
    rows = []
    for name, result in results.items():
        found, null = _differences(result["found"]["differences"]), _differences(result["null"])
        rows += [
            (
                name,
                rule,
                format_estimate(found[rule]["kappa"]),
                verdict(found[rule]["kappa"], KAPPA_MARGIN),
                format_estimate(found[rule]["accepted"], 1, 100, has_n=False),
                format_estimate(null[rule]["accepted"], 1, 100, has_n=False),
            )
            for rule in COMPARED
            if rule in found
        ]
    head = ("κ, same segments", "verdict", "accepted, points", "accepted, shuffled parts")
    verdicts = [
        (name, rule, verdict(found["kappa"], KAPPA_MARGIN))
        for name, result in results.items()
        for rule, found in _differences(result["found"]["differences"]).items()
        if rule in COMPARED
    ]
    accepted = [_score_row(name, result["found"]) for name, result in results.items()]
    return {
        "differences": Table(("source", "analogy less", *head), rows),
        "verdicts": count_verdicts(verdicts),
        "accepted": Table(
            ("source", "segments", "AUC", "captured", *(m.name for m in METHODS)), accepted
        ),
    }


def _score_row(name, found):
    scores = {score["method"]: score for score in found["scores"]}
    cells = [
        f"{format_estimate(scores[m.name]['accepted'], 0, 100)} "
        f"({100 * scores[m.name]['exchangeable']:.0f} %)"
        if m.name in scores and scores[m.name]["accepted"]["value"] is not None
        else "-"
        for m in METHODS
    ]
    captured = format_estimate(found["accepted_captured"], 0, 100, " %", has_n=False)
    auc = format_estimate(found["auc"], 2, has_n=False)
    return (name, str(found["segments"]), auc, captured, *cells)
