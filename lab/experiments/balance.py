"""Experiment 5.5 of the paper: static balance of exchanged segments, paired.

Share of segments whose centre of mass (static) or zero-moment point (dynamic) is outside the hull
of the soles in all grounded frames. The columns of the methods have the change in percentage points
from the same segments of the recording.
"""

from lab.donors.donor_methods import RandomLength, makers
from lab.donors.methods import Analogy, ContactPattern
from lab.experiments import bases
from lab.experiments.bases import MAX_BASES, N_GRAFTS
from lab.experiments.tables import Table, format_estimate
from mograft.evaluation import evaluate

NAME = "balance"
HELPERS = (bases,)
SOURCES = ("salsa A", "salsa B", "perfume", "indian", "basketball", "slow walks", "locomotion")
METHODS = (RandomLength(), ContactPattern(), Analogy())

PAPER_TABLE = {"contact pattern": (85.8, 478), "analogy": (81.7, 478), "original": (64.0, 478)}
"""Table 3 of the paper: unbalanced segments (mean of 10 runs) and all segments, by method."""


def measure(recordings, *, is_quick):
    """Rates of unbalanced segments of a source, for each method."""
    runs, bases = (1, 1) if is_quick else (N_GRAFTS, MAX_BASES)
    found = evaluate(
        recordings.library, ["balance"], methods=makers(METHODS), runs=runs, bases=bases
    )
    return [
        {
            "kind": row.kind,
            "method": row.method,
            "rate": row.rate.as_dict(),
            "difference": row.difference_changed.as_dict(),
        }
        for row in found.balance
        if row.rule == "all"
    ]


def tables(results):
    """Changes of the unbalanced share, and those of the paper."""
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
    paper = [
        (method, f"{100 * hits / n:.2f} %", str(n)) for method, (hits, n) in PAPER_TABLE.items()
    ]
    titles = (f"{m.name}, change in points" for m in METHODS)
    return {
        "changes": Table(("source", "balance", "recording, %", *titles), rows),
        "paper": Table(("donors in the paper", "unbalanced", "n"), paper),
    }
