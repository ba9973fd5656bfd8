"""Do similar legs have similar upper bodies? Retrieval of held-out parts."""

import math

from benches.evidence.section import (
    Section,
    Table,
    format_estimate,
    join_words,
    plain_reading,
    verdict,
)
from benches.evidence.sources import DEVELOPMENT, TEST
from benches.evidence.sources import SOURCES as ALL_SOURCES
from mograft.evaluation import retrieval

NAME = "retrieval"
SOURCES = tuple(name for name in ALL_SOURCES if name != "actions and styles")
_DEGREES = 180 / math.pi


def measure(recordings, *, is_quick):  # noqa: ARG001
    """The retrieval of the upper body of a source."""
    return retrieval(recordings.library).as_dict()


def render(results):
    """The section."""
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
        data="All sources but `actions and styles`, whose actions are those of `locomotion` and "
        "`gestures`, each "
        "by itself. Five folds of clips, or of blocks of 20 segments if there are fewer than ten "
        "clips: a fold of clips divides recordings, a fold of blocks divides one recording. "
        "Principal components, threshold and clusters are "
        "computed from the other four folds, which have all donors. All rules choose among the "
        "donors of similar length, and only segments with a donor by analogy are compared; the "
        "column of segments has their number and the number of all. Where few segments have a "
        "donor by analogy, the result holds for those few.",
        measure="Error: mean joint angle between the donors' upper bodies and the removed one, "
        "and mean distance of bone ends in heights of the body, both attached to the captured "
        "legs. Random: the mean over all donors of similar length. Every other rule but ball "
        "selects as "
        "many donors as analogy has; ties are drawn at random. Ball is compared on the segments "
        "that have a donor in the ball, too, so that its errors are those of fewer segments than "
        "the column of segments says (see its n in the first table). Gain: by how much the "
        "donors are nearer to the removed part than to the parts of all segments, so that a rule "
        "that prefers average poses gains nothing. n is the number of compared segments. "
        "Definition: "
        "`mograft.evaluation.retrieval`.",
        null="The parts of all segments are shuffled, 40 times. The null column is the range of "
        f"95 % of the shuffles. It holds 0 for {n_holding} of {len(nulls)} advantages in angle "
        "and distance: the measure favours no rule if there is nothing to find. This says nothing "
        "in favour of analogy. The last column shuffles within clips or blocks only: an advantage "
        "that "
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
        conclusions=_conclusions(results),
        limits=(
            "That a graft looks natural: a person may accept a part that is far from the captured "
            "one, or reject a near one. No person has judged these grafts.",
            "That the result holds for other kinds of motion than those in the rows, or for donors "
            "of other performers: folds divide clips or blocks, not people.",
            "That the segments without a donor by analogy would give the same result.",
        ),
        notes=(
            "A difference of 0.00 (0.00 to 0.00) means that both rules selected the same donors "
            "(stage, nearest neighbours). Where contact pattern and random are equal to the last "
            "digit (gestures), all donors of similar length have the same foot contacts, so that "
            "the "
            "contact pattern orders none of them.",
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


def _conclusions(results):
    lines = []
    for names, title in ((TEST, "Test sources"), (DEVELOPMENT, "Development sources")):
        for rule, meaning in _MEANINGS.items():
            for key in ("angle", "distance"):
                found = {
                    name: own[key]
                    for name, result in results.items()
                    for own in result["advantages"]
                    if own["rule"] == rule and name in names
                }
                if found:
                    reading = plain_reading("analogy", meaning, found)
                    lines.append(f"{title}, gain in {key}: {reading}")
    return (
        *lines,
        *_rank_conclusion(results),
        *_clip_conclusion(results),
        _error_conclusion(results),
    )


def _rank_conclusion(results):
    """Return in how many sources other rules rank the nearest part before analogy does."""
    cells = []
    for rule in ("nearest neighbours", "ball", "linear regression", "contact pattern"):
        pairs = [
            (scores[rule]["rank"]["value"], scores["analogy"]["rank"]["value"])
            for result in results.values()
            for scores in [{own["rule"]: own for own in result["scores"]}]
            if rule in scores
        ]
        cells.append(f"{rule} in {sum(own < other for own, other in pairs)} of {len(pairs)}")
    if results:
        yield (
            "Other rules rank the donor with the nearest part before analogy does (smaller value "
            f"in the table of ranks): {join_words(cells)} sources. The clusters give all their "
            "members one rank, which is part of this difference. Intervals of the differences of "
            "ranks were not computed."
        )


def _clip_conclusion(results):
    shares = {
        name: own["angle_null_within"]["value"] / own["angle"]["value"]
        for name, result in results.items()
        for own in result["advantages"]
        if own["rule"] == "random" and own["angle_null_within"]["interval"][0] > 0
    }
    if shares:
        listed = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
        yield (
            "Part of the gain over random donors remains if parts are shuffled within clips or "
            f"blocks: {listed}. This part comes from finding the clip or block, and not the moment."
        )


def _error_conclusion(results):
    smaller = [
        name
        for name, result in results.items()
        for scores in [{own["rule"]: own["angle"]["value"] for own in result["scores"]}]
        if scores["linear regression"] < scores["analogy"]
    ]
    n_worse = sum(
        own["rule"] == "linear regression" and verdict(own["angle"]) == "below"
        for name in smaller
        for own in results[name]["advantages"]
    )
    return (
        "The error of the linear regression itself is smaller than that of analogy in "
        f"{len(smaller)} of {len(results)} sources ({', '.join(smaller)}). In gain, "
        f"analogy is worse in {n_worse} of these. A rule that selects parts near to all parts "
        "would have such an error; whether this is the reason was not tested. Intervals of the "
        "differences of errors were not computed."
    )
