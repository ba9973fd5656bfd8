"""Do similar legs have similar upper bodies? Retrieval of held-out parts.

The upper body of every segment is removed, in five folds of clips, or of blocks of 20 segments if
there are fewer than ten clips. The errors of a rule are the mean joint angle between the donors'
upper bodies and the removed one, and the mean distance of bone ends in heights of the body. Gain:
by how much the donors are nearer to the removed part than to the parts of all segments. Null: the
parts of all segments are shuffled 40 times; the interval of a null is the range of 95 % of the
shuffles. See `lab.donors.retrieval`.
"""

import math

from lab.donors.retrieval import retrieval
from lab.experiments.sources import SOURCES as ALL_SOURCES
from lab.experiments.tables import Table, format_estimate
from lab.experiments.verdicts import ANGLE_MARGIN, count_verdicts, verdict

NAME = "retrieval"
SOURCES = tuple(name for name in ALL_SOURCES if name != "actions and styles")
_DEGREES = 180 / math.pi


def measure(recordings, *, is_quick):  # noqa: ARG001
    """The retrieval of the upper body of a source."""
    return retrieval(recordings.library).as_dict()


def tables(results):
    """Gains of analogy less those of other rules, and the errors and ranks of all rules."""
    return {
        "advantages": _advantage_table(results),
        "verdicts": count_verdicts(
            [
                (name, own["rule"], verdict(own["angle"], ANGLE_MARGIN, _DEGREES))
                for name, found in results.items()
                for own in found["advantages"]
            ]
        ),
        "angles": _score_table(results, "angle", _DEGREES, 1),
        "ranks": _score_table(results, "rank", 1, 2),
    }


_RULES = (
    "best possible",
    "analogy",
    "ball",
    "nearest neighbours",
    "linear regression",
    "contact pattern",
    "random",
)


def _score_table(results, key, scale, digits):
    """A table of one score of each rule."""
    rows = []
    for name, found in results.items():
        scores = {own["rule"]: own for own in found["scores"]}
        cells = [
            format_estimate(scores[rule][key], digits, scale, has_n=False)
            if rule in scores
            else "-"
            for rule in _RULES
        ]
        donors = scores["analogy"]["donors"]["value"]
        n = f"{found['segments']} of {found['held_out']}"
        rows.append((name, n, f"{donors:.1f}", *cells))
    return Table(("source", "segments", "donors", *_RULES), rows)


def _advantage_table(results):
    rows = [
        (
            name,
            own["rule"],
            format_estimate(own["angle"], 2, _DEGREES),
            verdict(own["angle"], ANGLE_MARGIN, _DEGREES),
            format_estimate(own["angle_null"], 2, _DEGREES, has_n=False),
            format_estimate(own["distance"], 4, has_n=False),
            format_estimate(own["distance_null"], 4, has_n=False),
            format_estimate(own["angle_null_within"], 2, _DEGREES, has_n=False),
        )
        for name, found in results.items()
        for own in found["advantages"]
    ]
    return Table(
        (
            "source",
            "analogy less",
            "angle, degrees",
            "verdict",
            "angle, null",
            "distance, heights",
            "distance, null",
            "angle, shuffled within clips",
        ),
        rows,
    )
