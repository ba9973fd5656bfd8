"""Experiment 5.5 of the paper: static balance of exchanged segments, paired.

Share of segments whose centre of mass (static) or zero-moment point (dynamic) is outside the hull
of the soles in all grounded frames. The columns of the methods have the change in percentage points
from the same segments of the recording; the paired differences are those of two methods on the
segments that both exchange in the same run.
"""

import numpy as np

from lab.donors.methods import Analogy, ContactPattern
from lab.experiments.bases import MAX_BASES, N_GRAFTS
from lab.experiments.tables import Table, format_estimate
from mograft.evaluation import RandomLength, estimate, grafts_by
from mograft.evaluation.balance import BALANCES, BalancedBase, balance_row

NAME = "balance"
SOURCES = ("salsa A", "salsa B", "perfume", "indian", "basketball", "slow walks", "locomotion")
METHODS = (RandomLength(), ContactPattern(), Analogy())

PAPER_TABLE = {"contact pattern": (85.8, 478), "analogy": (81.7, 478), "original": (64.0, 478)}
"""Table 3 of the paper: unbalanced segments (mean of 10 runs) and all segments, by method."""


def measure(recordings, *, is_quick):
    """Rates of unbalanced segments of a source for each method, and differences of methods."""
    library = recordings.library
    runs, n_bases = (1, 1) if is_quick else (N_GRAFTS, MAX_BASES)
    ends = np.linspace(0, len(library.entries) - 1, min(n_bases, len(library.entries)))
    clips = np.unique(ends.round().astype(int)).tolist()
    bases = [BalancedBase.of(library, clip) for clip in clips]
    names = [library.entries[clip].name for clip in clips]
    made = {"recording": [None] * len(clips)} | {
        method.name: [list(grafts_by(method, library, name, runs, seed=0)) for name in names]
        for method in METHODS
    }
    found = []
    for kind in BALANCES:
        samples = {
            name: [base.sample(kind, own) for base, own in zip(bases, grafts, strict=True)]
            for name, grafts in made.items()
        }
        for name, own in samples.items():
            row = balance_row(kind, name, own)
            paired = {
                other.name: pair(samples[Analogy.name], samples[other.name]).as_dict()
                for other in METHODS[:-1]
                if name == Analogy.name
            }
            estimates = {"rate": row.rate, "difference": row.difference_changed}
            estimates = {key: value.as_dict() for key, value in estimates.items()}
            found.append({"kind": kind, "method": name, **estimates, "paired": paired})
    return found


def pair(first, second):
    """Return the unbalanced share of one method less that of another, on the same segments.

    These are the segments that both exchange in the same run. `first` and `second` have the
    `BalanceSample` of each base.
    """
    states = [np.concatenate([own.after for own in two], axis=1) for two in (first, second)]
    changed = [np.concatenate([own.changed for own in two], axis=1) for two in (first, second)]
    difference = np.where(changed[0] & changed[1], states[0] - states[1], np.nan)
    lengths = [len(own.before) for own in first]
    blocks = estimate.segment_blocks(np.repeat(np.arange(len(first)), lengths))
    repeated = np.broadcast_to(blocks, difference.shape).ravel()
    return estimate.block_mean(difference.ravel(), repeated, "segments that both exchange")


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
    pairs = [
        (name, row["kind"], other, format_estimate(own, 1, 100))
        for name, found in results.items()
        for row in found
        for other, own in row["paired"].items()
    ]
    return {
        "paired": Table(("source", "balance", "analogy less", "points"), pairs),
        "changes": Table(("source", "balance", "recording, %", *titles), rows),
        "paper": Table(("donors in the paper", "unbalanced", "n"), paper),
    }
