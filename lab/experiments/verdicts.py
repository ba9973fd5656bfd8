"""What an interval says about a difference: better, equal within a margin, worse, or undecided.

Equal is a result of its own, not the absence of one: two one-sided tests (Schuirmann, J.
Pharmacokinetics and Biopharmaceutics 15, 1987) at 2.5 % reject that the difference is at least the
margin, which is so if the 95 % interval lies between the negative and the positive margin. The
margins were stated before the differences were measured.
"""

from collections import Counter

from lab.experiments.sources import SOURCES
from lab.experiments.tables import Table

ANGLE_MARGIN = 0.5  # degrees
KAPPA_MARGIN = 0.05
VERDICTS = ("better", "equal", "worse", "undecided", "no interval")


def verdict(estimate, margin, scale=1.0):
    """Return the verdict of a difference of which more is better; `margin` is on its scale."""
    if estimate["value"] is None or estimate["interval"] is None:
        return "no interval"
    low, high = (scale * end for end in estimate["interval"])
    if -margin < low and high < margin:
        return "equal"
    return "better" if low > 0 else "worse" if high < 0 else "undecided"


def count_verdicts(found):
    """Count verdicts by rule and use of the source; `found` has (source, rule, verdict)."""
    counts = Counter((rule, SOURCES[source].use, own) for source, rule, own in found)
    keys = dict.fromkeys((rule, SOURCES[source].use) for source, rule, _ in found)
    rows = [(*key, *(str(counts[*key, name]) for name in VERDICTS)) for key in sorted(keys)]
    return Table(("analogy less", "sources", *VERDICTS), rows)
