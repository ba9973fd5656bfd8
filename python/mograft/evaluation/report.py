"""The page of an evaluation: what was measured, how sure it is, and what it does not say."""

import html
import json
import math
from collections.abc import Sequence
from itertools import pairwise

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft.body.mass import mass_model
from mograft.evaluation import plots
from mograft.evaluation.balance import BalanceRow
from mograft.evaluation.enrichment import PAPER_TABLES
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.naturalness import Compatibility
from mograft.evaluation.suite import Evaluation
from mograft.viewing.page import Page, assemble_page
from mograft.viewing.report import REPORT_STYLE, format_number, html_table

__all__ = ["evaluation_page", "order_of", "reading"]

_ORDER = ("analogy", "contact pattern", "random")
_MORE_STYLE = """
.report img { max-width: 100%; height: auto; zoom: 1.25; display: block; margin: 10px 0; }
.report li { max-width: 75ch; margin: 4px 0; }
.report .refused { border-left: 3px solid var(--accent); padding-left: 12px; }
"""


def order_of(found: Compatibility) -> list[str]:
    """Return in words whether analogy is above contact patterns and these above chance.

    Parameters
    ----------
    found : Compatibility
        With these ways among those that were compared.

    Returns
    -------
    list of str
        A sentence for each step of the order.
    """
    told = []
    for first, second in pairwise(_ORDER):
        try:
            gap = found.difference(first, second)
        except KeyError:
            told.append(f"{first} and {second} were not both compared.")
            continue
        step = f"{first} less {second}: {gap.kappa.text(2)}"
        if gap.verdict == "above":
            told.append(f"{step}: above, outside of the interval.")
        elif gap.verdict == "below":
            told.append(f"{step}: below, against the order expected.")
        else:
            told.append(
                f"{step}: undecided. The interval holds 0 at {gap.kappa.n} segments with "
                f"donors, {gap.kappa.interval}."
            )
    return told


def reading(evaluation: Evaluation) -> list[str]:
    """Return in plain sentences what an evaluation says.

    Parameters
    ----------
    evaluation : Evaluation
        The evaluation.

    Returns
    -------
    list of str
        One for each finding and each refusal.
    """
    told: list[str] = []
    if evaluation.counted is not None:
        own = evaluation.counted
        two = own.counts[0]
        told.append(
            f"{own.segments} segments of {own.clusters} base clusters combine to {two.filtered} "
            f"of two groups within the limits of length, {two.new} of them new."
        )
    for found in evaluation.naturalness:
        scores = {score.method: score for score in found.scores}
        if "analogy" in scores:
            kappa = scores["analogy"].kappa.text(2)
            told.append(
                f"Compatibility of {found.group} by analogy is {kappa} on a scale from random "
                f"parts, 0, to captured ones, 1; a captured part is told from a random one in "
                f"{found.auc.text(0, 100, ' %')} of the pairs."
            )
        told += [f"{found.group}: {sentence}" for sentence in order_of(found)]
    static = [
        row
        for row in evaluation.balance
        if (row.kind, row.rule, row.margin) == ("static", "all", 0.0)
    ]
    for row in static:
        if row.method == "recording":
            told.append(
                f"{row.rate.text(1, 100, ' %')} of the recording's segments are out of static "
                "balance in all of their grounded frames."
            )
        if row.method == "analogy":
            change = row.difference.text(1, 100, " points")
            told.append(f"Exchanges by analogy change that by {change} on the same segments.")
    for made in evaluation.quality:
        if made.method == "analogy, by cost":
            told.append(
                f"Chosen by cost, {made.new_segments.text(0, 100, ' %')} of the parts are "
                f"exchanged; seams have to close {made.seam_gap.text(1, 1, '°')}; acceleration is "
                f"{made.acceleration.text(2)} of the recording's."
            )
    if evaluation.people is not None:
        people = evaluation.people
        told.append(
            f"A classifier that learned from {people.learned} labels is right about "
            f"{people.accuracy.text(0, 100, ' %')} of {people.tested} others."
        )
    told += [f"Refused, {what}: {why}" for what, why in evaluation.refused.items()]
    return told


def evaluation_page(evaluation: Evaluation, title: str | None = None) -> Page:
    """Return a page that tells what was measured.

    Parameters
    ----------
    evaluation : Evaluation
        What was measured.
    title : str, optional
        Default: the names of the first clips.

    Returns
    -------
    Page
        Self-contained, without any script.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    library = evaluation.library
    names = [entry.name for entry in library.entries]
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    named = title or f"Evaluation of {', '.join(names[:2])}{more}"
    known = mass_model(library.skeleton)
    lead = (
        f"{len(names)} clips, {sum(entry.n_frames for entry in library.entries)} frames at "
        f"{library.rate:.4g} a second, {len(library.segments)} segments. Seed "
        f"{evaluation.parameters['seed']}, mograft {VERSION}. In brackets: 95 % intervals; "
        "they hold the choice of segments and donors, not that of the recordings."
    )
    parts = [
        "<main>",
        f"<h1>{html.escape(named)}</h1>",
        f'<p class="lead">{html.escape(lead)}</p>',
        "<h2>In words</h2>",
        _list(reading(evaluation)),
    ]
    if evaluation.refused:
        parts += [
            "<h2>Refused</h2>",
            '<div class="refused">',
            _list([f"{what}: {why}" for what, why in evaluation.refused.items()]),
            "</div>",
        ]
    if evaluation.naturalness:
        parts += _natural(evaluation)
    if evaluation.people is not None:
        parts += _people(evaluation)
    if evaluation.balance:
        parts += _balance(evaluation, known.model, known.unmatched)
    if evaluation.quality:
        parts += _quality(evaluation)
    if evaluation.counted is not None:
        parts += _counts(evaluation)
    parts += [
        "<h2>By which parameters</h2>",
        "<details><summary>All of them</summary>",
        f"<pre>{html.escape(json.dumps(dict(evaluation.parameters), indent=1))}</pre></details>",
        "</main>",
    ]
    return assemble_page(named, "\n".join(parts), "report", REPORT_STYLE + _MORE_STYLE, "")


def _list(sentences: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{html.escape(own)}</li>' for own in sentences)}</ul>"


def _note(text: str) -> str:
    return f'<p class="note">{html.escape(text)}</p>'


def _natural(evaluation: Evaluation) -> list[str]:
    parts = ["<h2>Compatibility</h2>"]
    several = {found.group: found for found in evaluation.naturalness}
    parts.append(plots.as_image(plots.draw_kappa(several), "Compatibility of each way"))
    for found in evaluation.naturalness:
        rows = [
            [
                html.escape(own.method),
                own.kappa.text(2),
                own.matched.text(2),
                own.accepted.text(0, 100, " %"),
                f"{100 * own.exchangeable:.0f} %",
                str(own.kappa.n),
            ]
            for own in found.scores
        ]
        head = [found.group, "κ", "κ, same segments", "accepted", "with a donor", "n"]
        parts.append(html_table(head, rows))
        parts.append(
            _note(
                f"{found.segments} segments, {found.splits} times dealt into {found.folds} folds "
                f"of {found.fold_groups} clips or blocks. Accepted are "
                f"{found.real.text(0, 100, ' %')} of captured and "
                f"{found.random.text(0, 100, ' %')} of random parts; a captured part scores "
                f"above a random one in {found.auc.text(0, 100, ' %')}."
            )
        )
    parts.append(
        _note(
            "κ says whether such combinations occur in these recordings: 0 as random parts, 1 as "
            "captured ones. It does not see seams or physics, is no share of natural motions, "
            "and holds a good combination that was never captured for a bad one. A way that "
            "exchanges only common segments gains by that; the second column compares on the "
            "same segments."
        )
    )
    return parts


def _people(evaluation: Evaluation) -> list[str]:
    people = evaluation.people
    if people is None:
        return []
    rows = [
        [
            html.escape(own.method),
            own.called.text(0, 100, " %"),
            own.corrected.text(0, 100, " %"),
            str(own.called.n),
        ]
        for own in people.verdicts
    ]
    return [
        "<h2>Labels</h2>",
        html_table(["way", "called natural", "corrected", "n"], rows),
        _note(
            f"Learned from {people.learned} labels, tested on {people.tested}: right about "
            f"{people.accuracy.text(0, 100, ' %')}; of natural ones {people.sensitivity.text(2)}, "
            f"of unnatural ones {people.specificity.text(2)}. The person called "
            f"{people.natural.text(0, 100, ' %')} of pieces with random donors natural, and "
            f"{people.captured.text(0, 100, ' %')} of captured ones. Corrected shares allow for "
            "the classifier's errors; one person's labels tell of one person."
        ),
    ]


def _rate(own: Estimate) -> str:
    return own.text(1, 100, " %") if math.isfinite(own.value) else "none"


def _balance(evaluation: Evaluation, model: str, unmatched: Sequence[str]) -> list[str]:
    parts = ["<h2>Balance</h2>"]
    static = [
        row
        for row in evaluation.balance
        if (row.kind, row.rule, row.margin) == ("static", "all", 0.0)
    ]
    figure = plots.draw_balance({"static, all grounded frames": static})
    parts.append(plots.as_image(figure, "Unbalanced segments of each way"))

    def row_of(row: BalanceRow) -> list[str]:
        rule = f"{row.kind}, {row.rule}" + (f", margin {row.margin:g}" if row.margin else "")
        points = row.difference.text(1, 100) if row.method != "recording" else ""
        changed = _rate(row.changed) if row.method != "recording" else ""
        return [
            html.escape(row.method),
            rule,
            _rate(row.rate),
            changed,
            points,
            f"{100 * row.flight:.0f} %",
            str(row.runs),
            str(row.difference.n if row.method != "recording" else row.rate.n),
        ]

    head = ["way", "rule", "unbalanced", "of changed", "change, points", "flight", "runs", "n"]
    order = {(row.kind, row.rule, row.margin): at for at, row in enumerate(evaluation.balance)}
    rows = sorted(evaluation.balance, key=lambda row: order[row.kind, row.rule, row.margin])
    parts.append(html_table(head, [row_of(row) for row in rows]))
    masses = (
        "de Leva's masses"
        if model == "de Leva"
        else ("rods, masses as the lengths of bones, since the skeleton is not known as a human's")
    )
    unknown = f" Joints known by their place alone: {', '.join(unmatched)}." if unmatched else ""
    parts.append(
        _note(
            f"Centre of mass by {masses}.{unknown} A segment is unbalanced where all, most or any "
            "of its frames with a foot on the floor have the point outside of the soles' hull; "
            "static: the centre of mass over the floor, dynamic: the zero-moment point. The "
            "change is paired: changed segments against the recording's own. Out of balance is "
            "not unnatural: whoever walks is."
        )
    )
    return parts


def _quality(evaluation: Evaluation) -> list[str]:
    measures: tuple[tuple[str, str, int, float, str], ...] = (
        ("new parts", "new_segments", 0, 100, " %"),
        ("seam gap", "seam_gap", 1, 1, "°"),
        ("seam gap, 90th percentile", "seam_gap_p90", 1, 1, "°"),
        ("acceleration", "acceleration", 2, 1, ""),
        ("jerk", "jerk", 2, 1, ""),
        ("foot skate, points", "foot_skate", 1, 100, ""),
        ("coverage", "coverage", 2, 1, ""),
        ("local diversity", "local_diversity", 3, 1, ""),
        ("diversity", "diversity", 1, 1, "°"),
        ("arms and legs", "coordination", 2, 1, ""),
        ("their lag", "lag", 2, 1, " s"),
    )
    head = ["measure", *(own.method for own in evaluation.quality), "n"]
    rows = []
    for title, name, digits, scale, unit in measures:
        several: list[Estimate] = [getattr(own, name) for own in evaluation.quality]
        told = [own.text(digits, scale, unit) for own in several]
        rows.append([title, *told, f"{max(own.n for own in several)} {several[0].of}"])
    figure = plots.draw_quality(evaluation.quality)
    return [
        "<h2>Quality</h2>",
        plots.as_image(figure, "Measures of quality of each way"),
        html_table(head, rows),
        _note(
            "Acceleration and jerk of the grafted joints as ratios to the recording's; foot skate "
            "less the recording's; coverage: share of the recordings' seconds that come near in "
            "a graft; local diversity: distance from the nearest captured half second; "
            "diversity: between grafts of one base; arms and legs: change in the correlation of "
            "an arm's swing with the opposite leg's, and of its lag. All is relative to these "
            "recordings."
        ),
    ]


def _counts(evaluation: Evaluation) -> list[str]:
    counted = evaluation.counted
    if counted is None:
        return []
    head = ["groups", "clusters", "combinations", "per segment", "within length", "new"]
    rows = [
        [
            str(own.groups),
            html.escape(
                ", ".join(f"{g} {n}" for g, n in evaluation.clusters.get(own.groups, {}).items())
                or "no preset"
            ),
            format_number(own.unfiltered),
            f"{own.unfiltered / counted.segments:.1f}",
            format_number(own.filtered),
            format_number(own.new),
        ]
        for own in counted.counts
    ]
    paper = {
        k: [counts[k] / segments for _, segments, counts in PAPER_TABLES.values()]
        for k in (2, 3, 4, 5)
    }
    parts = ["<h2>Enrichment</h2>", html_table(head, rows)]
    if evaluation.swept:
        figure = plots.draw_counts({"scales": evaluation.swept}, paper)
        parts.append(plots.as_image(figure, "Combinations by scale of the threshold"))
    failed = [law.name for law in evaluation.laws if not law.holds]
    laws = f"but {', '.join(failed)}" if failed else "as counts of one clustering must"
    parts.append(
        _note(
            f"Threshold {counted.sigma} times {counted.sigma_scale:g}: {counted.clusters} base "
            f"clusters, the largest of {counted.largest}. The counts obey all laws of moments, "
            f"{laws}. In the plot dots are with the limits of length, triangles are the paper's "
            "tables 1 and 2; those of five groups cannot come from one clustering. A count of "
            "combinations says nothing of how good they are."
        )
    )
    return parts
