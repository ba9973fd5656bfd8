"""Do similar legs have similar upper bodies? Retrieval of held-out parts."""

import math

from benches.evidence.section import Section, Table, format_estimate, plain_reading
from benches.evidence.sources import SOURCES as ALL_SOURCES
from benches.evidence.sources import TEST
from mograft.evaluation import retrieval

NAME = "retrieval"
SOURCES = tuple(ALL_SOURCES)
_DEGREES = 180 / math.pi


def measure(recordings, *, is_quick):  # noqa: ARG001
    """The retrieval of the upper body of a source."""
    return retrieval(recordings.library).as_dict()


def render(results):
    """The section."""
    test = {name: found for name, found in results.items() if name in TEST}
    nulls = [
        own[key]
        for found in results.values()
        for own in found["advantages"]
        for key in ("angle_null", "distance_null")
    ]
    n_holding = sum(own["interval"][0] <= 0 <= own["interval"][1] for own in nulls)
    return Section(
        anchor=NAME,
        title="Do similar legs have similar upper bodies?",
        question="The upper body of every segment is removed. Do the donors of the paper's rule "
        "(the cluster of the legs, called analogy) have upper bodies that are nearer to the "
        "removed one than the donors of other rules?",
        data="All sources, each by itself. Five folds of clips, or of blocks of 20 segments if "
        "there are fewer than ten clips. Principal components, threshold and clusters are "
        "computed from the other four folds, which have all donors. Only segments with a donor "
        "by analogy are compared; the column of segments has their number and the number of all.",
        measure="Error: mean joint angle between the donors' upper bodies and the removed one, "
        "and mean distance of bone ends in heights of the body, both attached to the captured "
        "legs. Every rule but ball selects as many donors as analogy has. Gain: by how much the "
        "donors are nearer to the removed part than to the parts of all segments, so that a rule "
        "that prefers average poses gains nothing. Definition: `mograft.evaluation.retrieval`.",
        null="The parts of all segments are shuffled, 40 times. The null column is the range of "
        f"95 % of the shuffles. It holds 0 for {n_holding} of {len(nulls)} advantages in angle "
        "and distance. The last column shuffles within clips or blocks only: an advantage that "
        "remains there comes from whole clips, not from single segments.",
        tables=(
            _advantage_table(results),
            _score_table(
                results,
                "angle",
                _DEGREES,
                1,
                "Errors as mean joint angles in degrees. Best possible knows the removed part.",
            ),
            _score_table(
                results,
                "rank",
                1,
                2,
                "Relative rank of the allowed donor with the nearest part in the order of the "
                "rule: 0 is the first, 0.5 is chance. All members of a cluster have one rank, so "
                "that this measure favours rules with a finer order.",
            ),
        ),
        conclusions=_conclusions(test, results),
        limits=(
            "That a graft looks natural: a person may accept a part that is far from the captured "
            "one, or reject a near one. No person has judged these grafts.",
            "That the result holds for other kinds of motion than those in the rows, or for donors "
            "of other performers: folds divide clips, not people.",
            "In libraries with few segments, analogy has no donor for many segments. They are not "
            "part of the comparison.",
        ),
    )


_RULES = (
    "best possible",
    "analogy",
    "ball",
    "nearest neighbours",
    "linear regression",
    "contact pattern",
    "random",
)


def _score_table(results, key, scale, digits, caption):
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
    return Table(("source", "segments", "donors", *_RULES), tuple(rows), caption)


def _advantage_table(results):
    rows = [
        (
            name,
            own["rule"],
            format_estimate(own["angle"], 2, _DEGREES),
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
            "null",
            "distance, heights",
            "null",
            "angle, shuffled within clips",
        ),
        tuple(rows),
        "Gain of analogy less that of another rule on the same n segments; above 0 is in favour "
        "of analogy.",
    )


_MEANINGS = {
    "random": "random donors of similar length",
    "contact pattern": "as many donors with the most similar foot contacts",
    "linear regression": "as many donors by a linear regression from the legs",
    "nearest neighbours": "as many nearest neighbours",
    "ball": "the ball",
}


def _conclusions(test, results):
    lines = []
    for rule, meaning in _MEANINGS.items():
        for sources, title in ((test, "Test sources"), (results, "All sources")):
            found = [
                own["angle"]
                for result in sources.values()
                for own in result["advantages"]
                if own["rule"] == rule
            ]
            if found:
                lines.append(f"{title}, gain in angle: {plain_reading('analogy', meaning, found)}")
    shares = {
        name: own["angle_null_within"]["value"] / own["angle"]["value"]
        for name, result in results.items()
        for own in result["advantages"]
        if own["rule"] == "random" and own["angle_null_within"]["interval"][0] > 0
    }
    if shares:
        listed = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
        lines.append(
            "Part of the gain over random donors remains if parts are shuffled within clips or "
            f"blocks: {listed}. This part comes from finding the clip, its action or its style, "
            "not the moment."
        )
    smaller = [
        name
        for name, result in results.items()
        for scores in [{own["rule"]: own["angle"]["value"] for own in result["scores"]}]
        if scores["linear regression"] < scores["analogy"]
    ]
    lines.append(
        "The error of the linear regression itself is smaller than that of analogy in "
        f"{len(smaller)} of {len(results)} sources, because it selects parts that are near to all "
        "parts."
    )
    return tuple(lines)
