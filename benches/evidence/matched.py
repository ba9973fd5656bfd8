"""Matched comparison of the rules of donor selection by compatibility κ."""

from benches.evidence.section import Section, Table, format_estimate, plain_reading, verdict
from benches.evidence.sources import DEVELOPMENT, TEST
from benches.evidence.sources import SOURCES as ALL_SOURCES
from mograft.body.contacts import find_legs
from mograft.evaluation import (
    Analogy,
    Ball,
    ContactPattern,
    Nearest,
    RandomLength,
    compatibility,
)

NAME = "matched"
SOURCES = tuple(name for name in ALL_SOURCES if name != "actions and styles")
METHODS = (RandomLength(), ContactPattern(), Nearest(), Ball(), Analogy())
REFERENCE = "analogy"
COMPARED = ("random, length limit", "contact pattern", "nearest neighbours", "ball")
_MEANINGS = {
    "random, length limit": "random donors of similar length",
    "contact pattern": "donors with similar foot contacts",
    "nearest neighbours": "as many nearest neighbours",
    "ball": "the ball",
}
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


def render(results):
    """The section."""
    rows, score_rows, nulls = [], [], []
    for name, result in results.items():
        found, null = _differences(result["found"]["differences"]), _differences(result["null"])
        for rule in COMPARED:
            if rule not in found:
                continue
            accepted = null[rule]["accepted"]
            nulls.append(verdict(accepted))
            rows.append(
                (
                    name,
                    rule,
                    format_estimate(found[rule]["kappa"]),
                    format_estimate(found[rule]["accepted"], 1, 100, has_n=False),
                    format_estimate(accepted, 1, 100, has_n=False),
                )
            )
        score_rows.append(_score_row(name, result["found"]))
    conclusions = []
    for sources, title in ((TEST, "Test sources"), (DEVELOPMENT, "Development sources")):
        for rule in COMPARED:
            kappas = {
                name: _differences(result["found"]["differences"])[rule]["kappa"]
                for name, result in results.items()
                if name in sources and rule in _differences(result["found"]["differences"])
            }
            if kappas:
                reading = plain_reading("analogy", _MEANINGS[rule], kappas)
                conclusions.append(f"{title}: {reading}")
    n_undecided = nulls.count("undecided")
    return Section(
        anchor=NAME,
        title="Does the cluster rule select more compatible parts than simpler rules?",
        question="A classifier learns which upper bodies were captured with which legs. Does it "
        "accept the donors of analogy more often than those of other rules for the same segments?",
        data="All sources but `actions and styles`, whose actions are those of `locomotion` and "
        "`gestures`, each "
        "by itself, in five folds of clips or of blocks of 20 segments: one "
        "fold has the bases, two are the library (features, threshold and clusters are computed "
        "from them, and all donors are in them), and two train the classifier.",
        measure="κ of analogy minus κ of the other rule (0 if parts are accepted as "
        "often as random ones, 1 if as often as captured ones, and above 1 if more often), on the "
        "n segments for which both have a donor in one split or more. Nearest neighbours are as "
        "many as "
        "analogy has donors for the same segment. Intervals resample the clips or blocks that "
        "folds do not divide, and splits. Definition: `mograft.evaluation.compatibility`.",
        null="The upper bodies of all segments are shuffled before everything else. κ is then "
        "undefined, so the null is the difference of acceptance rates, in percentage points. Its "
        f"interval holds 0 in {n_undecided} of {len(nulls)} comparisons: the measure favours no "
        "rule if there is nothing to find. This says nothing in favour of analogy.",
        tables=(
            Table(
                (
                    "source",
                    "analogy less",
                    "κ, same segments",
                    "accepted, points",
                    "accepted, shuffled parts",
                ),
                tuple(rows),
            ),
            Table(
                ("source", "segments", "AUC", "captured", *(m.name for m in METHODS)),
                tuple(score_rows),
                "Accepted parts in percent. n is the number of segments that have a donor in one "
                f"of the {N_SPLITS} splits or more; the last brackets have the share of segments "
                "with a donor, mean over splits, which is smaller than n divided by all segments. "
                "The column captured has all segments, the other columns those with a donor, so "
                "that a rule can be above captured (stage). AUC: probability that the classifier "
                "scores a captured part above a "
                "random one.",
            ),
        ),
        conclusions=tuple(conclusions),
        limits=(
            "That people would judge in the same way: κ is not a share of natural motions.",
            "That analogy is worse or better in libraries with more clips: the library is two "
            "fifths of each source here.",
        ),
        notes=(
            "The classifier has features of its own, but similar legs have similar features in "
            "any description. The section on [retrieval](#retrieval) has no classifier.",
            "The table of accepted parts compares different segments; only the first table "
            "compares the same segments.",
        ),
    )


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
