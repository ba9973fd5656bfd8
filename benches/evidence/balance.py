"""Experiment 5.5 of the paper: static balance of exchanged segments, paired."""

from benches.evidence import bases
from benches.evidence.bases import MAX_BASES, N_GRAFTS
from benches.evidence.section import Section, Table, count_verdicts, format_estimate
from benches.evidence.sources import DEVELOPMENT, TEST
from mograft.evaluation import Analogy, ContactPattern, RandomLength, evaluate
from mograft.evaluation.balance import PAPER_TABLE

NAME = "balance"
HELPERS = (bases,)
SOURCES = ("salsa A", "salsa B", "perfume", "indian", "basketball", "slow walks", "locomotion")
METHODS = (RandomLength(), ContactPattern(), Analogy())


def measure(recordings, *, is_quick):
    """Rates of unbalanced segments of a source, for each method."""
    runs, bases = (1, 1) if is_quick else (N_GRAFTS, MAX_BASES)
    found = evaluate(recordings.library, ["balance"], methods=METHODS, runs=runs, bases=bases)
    return [
        {
            "kind": row.kind,
            "method": row.method,
            "rate": row.rate.as_dict(),
            "difference": row.difference.as_dict(),
        }
        for row in found.balance
        if (row.rule, row.margin) == ("all", 0.0)
    ]


def render(results):
    """The section."""
    rows = []
    for name, found in results.items():
        for kind in ("static", "dynamic"):
            own = {row["method"]: row for row in found if row["kind"] == kind}
            if own:
                cells = [
                    format_estimate(own[m.name]["difference"], 1, 100) if m.name in own else "-"
                    for m in METHODS
                ]
                recording = format_estimate(own["recording"]["rate"], 1, 100)
                rows.append((name, kind, recording, *cells))
    paper = tuple(
        (method, f"{100 * hits / n:.2f} %", str(n)) for method, (hits, n) in PAPER_TABLE.items()
    )
    return Section(
        anchor=NAME,
        title="Experiment 5.5: do exchanges cost balance?",
        question="The paper compares shares of unbalanced segments (table 3). How much do "
        "exchanges change them?",
        data=f"Up to {MAX_BASES} clips of each source as bases, {N_GRAFTS} grafts of each. "
        "Only exchanged segments, each compared with the same segment of the recording.",
        measure="Share of segments whose centre of mass (static) or zero-moment point (dynamic) is "
        "outside the hull of the soles in all grounded frames. The columns of the methods have "
        "the change in percentage points; n is the number of exchanged segments.",
        null="The recording: its own rate is in the third column. Its dynamic rate shows the floor "
        "of that measure, since a person who did not fall was never dynamically unbalanced.",
        tables=(
            Table(
                (
                    "source",
                    "balance",
                    "recording, %",
                    *(f"{m.name}, change in points" for m in METHODS),
                ),
                tuple(rows),
            ),
            Table(("donors in the paper", "unbalanced", "n"), paper),
        ),
        conclusions=(
            *_conclusions(results),
            "In the paper 17.95 % and 17.09 % of 478 segments differ by 0.86 points; the standard "
            "error of each is 1.8 points. Taken as independent, their difference is "
            "not significant; a paired difference cannot be computed from the table.",
        ),
        limits=(
            "That balanced grafts look natural: a walk is statically unbalanced.",
            "That the rate of grafts by itself shows the effect of a method: the rates of the "
            "recordings differ more between rows than the changes do, and their dynamic rate is "
            "far "
            "above 0 in some rows.",
            "That an undecided change is 0: some intervals are several points wide.",
        ),
    )


def _conclusions(results):
    for names, title in ((TEST, "Test sources"), (DEVELOPMENT, "Development sources")):
        for kind in ("static", "dynamic"):
            for method in METHODS:
                differences = [
                    row["difference"]
                    for name, found in results.items()
                    for row in found
                    if name in names and row["kind"] == kind and row["method"] == method.name
                ]
                if differences:
                    yield (
                        f"{title}, change of the {kind} rate by exchanges, {method.name}: "
                        f"{count_verdicts(differences)}."
                    )
