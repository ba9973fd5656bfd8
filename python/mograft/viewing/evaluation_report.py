"""The page of an evaluation: tables, figures, intervals and limitations."""

import html
import json
from collections.abc import Sequence

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft.body.mass import mass_model
from mograft.evaluation.balance import BalanceRow
from mograft.evaluation.enrichment import PAPER_TABLES, Enrichment
from mograft.evaluation.label_judgement import Judgement
from mograft.evaluation.naturalness import Compatibility
from mograft.evaluation.suite import Evaluation
from mograft.viewing.page import Page, assemble_page
from mograft.viewing.plot import evaluation_plots as plots
from mograft.viewing.quality_report import (
    detectability_section,
    note,
    quality_section,
    world_section,
    world_sentences,
)
from mograft.viewing.report import REPORT_STYLE, format_number, html_table

_COMPARED = (
    ("analogy", "contact pattern"),
    ("contact pattern", "random"),
    ("analogy", "nearest neighbours"),
)
_EXTRA_STYLE = """
.report img { max-width: 100%; height: auto; zoom: 1.25; display: block; margin: 10px 0; }
.report li { max-width: 75ch; margin: 4px 0; }
.report .refused { border-left: 3px solid var(--accent); padding-left: 12px; }
"""


def compare_methods(found: Compatibility) -> list[str]:
    """Return one sentence for each of three differences of κ between two methods.

    They are analogy minus contact patterns, contact patterns minus random donors, and analogy minus
    equally many nearest neighbours.
    """
    sentences = []
    for first, second in _COMPARED:
        try:
            difference = found.difference(first, second)
        except KeyError:
            sentences.append(f"{first} and {second} were not both compared.")
            continue
        kappa = difference.kappa
        step = f"κ of {first} minus {second}, on the same segments: {kappa.text(2)}"
        if difference.verdict == "undecided":
            sentences.append(
                f"{step}: undecided. The interval contains 0 with {kappa.n} segments with "
                f"donors, {kappa.interval_method}."
            )
        else:
            sentences.append(f"{step}: the interval is {difference.verdict} 0.")
    return sentences


def summarize(evaluation: Evaluation) -> list[str]:
    """Return one sentence for each finding, and one for each measure without sufficient data."""
    sentences: list[str] = []
    if evaluation.enrichment is not None:
        counts = evaluation.enrichment
        pair = counts.counts[0]
        sentences.append(
            f"{counts.segments} segments in {counts.clusters} clusters of the base group combine "
            f"to {pair.filtered} segments with two groups and the length limit, {pair.new} of "
            "them new."
        )
    for found in evaluation.naturalness:
        scores = {score.method: score for score in found.scores}
        if "analogy" in scores:
            kappa = scores["analogy"].kappa
            sentences.append(
                f"Compatibility κ of {found.group} by analogy is {kappa.text(2)}; "
                "random parts have 0, captured parts have 1. The classifier scores a captured part "
                f"higher than a random one in {found.auc.text(0, 100, ' %')} of the pairs."
            )
        sentences += [f"{found.group}: {sentence}" for sentence in compare_methods(found)]
    for row in _static_rows(evaluation):
        if row.method == "recording":
            sentences.append(
                f"{row.rate.text(1, 100, ' %')} of the segments of the recording are statically "
                "unbalanced in all grounded frames."
            )
        if row.method == "analogy":
            change = row.difference.text(1, 100, " points")
            sentences.append(f"Exchanges by analogy change this by {change} on the same segments.")
    for measures in evaluation.quality:
        if measures.method == "analogy, by cost":
            share = measures.new_segments
            sentences.append(
                f"Choice by cost exchanges {share.text(0, 100, ' %')} of the parts. "
                f"The mean seam gap is {measures.seam_gap.text(1, 1, '°')}. The acceleration is "
                f"{measures.acceleration.text(2)} times that of the recording."
            )
    sentences += world_sentences(evaluation.world, evaluation.detectability)
    if evaluation.judgement is not None:
        people = evaluation.judgement
        sentences.append(
            f"A classifier that was trained on {people.learned} labels predicts "
            f"{people.accuracy.text(0, 100, ' %')} of {people.tested} test labels correctly."
        )
    return [*sentences, *(f"Not measured, {refusal}" for refusal in _refusals(evaluation))]


def _refusals(evaluation: Evaluation) -> list[str]:
    return [f"{topic}: {reason}" for topic, reason in evaluation.refusals.items()]


def _static_rows(evaluation: Evaluation) -> list[BalanceRow]:
    """Return the rows whose kind is "static", whose rule is "all" and whose margin is 0."""
    return [
        row
        for row in evaluation.balance
        if (row.kind, row.rule, row.margin) == ("static", "all", 0.0)
    ]


def evaluation_page(evaluation: Evaluation, title: str | None = None) -> Page:
    """Return a page with the results of an evaluation.

    Parameters
    ----------
    evaluation : Evaluation
        The result of `evaluate`.
    title : str, optional
        Title of the page. Default: "Evaluation of" and the names of the first two clips.

    Returns
    -------
    Page
        Self-contained page without scripts.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    library = evaluation.library
    names = library.names
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    title = title or f"Evaluation of {', '.join(names[:2])}{more}"
    lead = (
        f"{len(names)} clips, {sum(entry.n_frames for entry in library.entries)} frames at "
        f"{library.rate:.4g} frames per second, {len(library.segments)} segments. Seed "
        f"{evaluation.parameters['seed']}, mograft {VERSION}. In brackets: 95 % intervals. They "
        "cover the choice of segments and donors, but not the choice of the recordings."
    )
    parts = [
        "<main>",
        f"<h1>{html.escape(title)}</h1>",
        f'<p class="lead">{html.escape(lead)}</p>',
        "<h2>Summary</h2>",
        _list(summarize(evaluation)),
    ]
    if evaluation.refusals:
        refusals = _list(_refusals(evaluation))
        parts += ["<h2>Not measured</h2>", f'<div class="refused">{refusals}</div>']
    if evaluation.naturalness:
        parts += _compatibility_section(evaluation.naturalness)
    if evaluation.judgement is not None:
        parts += _label_section(evaluation.judgement)
    if evaluation.balance:
        parts += _balance_section(evaluation)
    if evaluation.quality:
        parts += quality_section(evaluation.quality)
    if evaluation.world:
        parts += world_section(evaluation.world)
    if evaluation.detectability:
        parts += detectability_section(evaluation.detectability)
    if evaluation.enrichment is not None:
        parts += _enrichment_section(evaluation, evaluation.enrichment)
    parts += [
        "<h2>Parameters</h2>",
        "<details><summary>All parameters</summary>",
        f"<pre>{html.escape(json.dumps(dict(evaluation.parameters), indent=1))}</pre></details>",
        "</main>",
    ]
    return assemble_page(title, "\n".join(parts), "report", REPORT_STYLE + _EXTRA_STYLE, "")


def _list(sentences: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{html.escape(sentence)}</li>' for sentence in sentences)}</ul>"


def _compatibility_section(compatibilities: Sequence[Compatibility]) -> list[str]:
    figure = plots.draw_kappa({found.group: found for found in compatibilities})
    parts = ["<h2>Compatibility</h2>", plots.as_image(figure, "Compatibility of each method")]
    for found in compatibilities:
        rows = [
            [
                html.escape(score.method),
                score.kappa.text(2),
                score.matched.text(2),
                score.accepted.text(0, 100, " %"),
                f"{100 * score.exchangeable:.0f} %",
                str(score.kappa.n),
            ]
            for score in found.scores
        ]
        head = [found.group, "κ", "κ, same segments", "accepted", "with a donor", "n"]
        parts.append(html_table(head, rows))
        parts.append(
            note(
                f"{found.segments} segments in {found.fold_groups} clips or blocks, which were "
                f"assigned {found.splits} times to {found.folds} folds. The classifier accepts "
                f"{found.captured.text(0, 100, ' %')} of the captured and "
                f"{found.random.text(0, 100, ' %')} of the random parts. It scores a captured "
                f"part higher than a random one in {found.auc.text(0, 100, ' %')} of the pairs."
            )
        )
    parts.append(
        note(
            "κ measures whether such combinations occur in these recordings: random parts have 0, "
            "captured parts have 1. It is not the share of natural motions. It does not measure "
            "seams or physics, and a plausible combination that was never captured scores low. A "
            "method that exchanges only common segments has a higher κ. The second column "
            "has the rates of random and captured parts of the same segments; the differences in "
            "the summary compare two methods on the segments for which both have a donor."
        )
    )
    return parts


def _label_section(people: Judgement) -> list[str]:
    rows = [
        [
            html.escape(verdict.method),
            verdict.called.text(0, 100, " %"),
            verdict.corrected.text(0, 100, " %"),
            str(verdict.called.n),
        ]
        for verdict in people.verdicts
    ]
    return [
        "<h2>Labels</h2>",
        html_table(["method", "called natural", "corrected", "n"], rows),
        note(
            f"{people.learned} training labels, {people.tested} test labels. Of the test labels, "
            f"the classifier predicts {people.accuracy.text(0, 100, ' %')} correctly: of the "
            f"natural ones {people.sensitivity.text(2)}, of the unnatural ones "
            f"{people.specificity.text(2)}. The person labelled "
            f"{people.natural.text(0, 100, ' %')} of the pieces with an exchanged part natural, "
            f"and {people.captured.text(0, 100, ' %')} of the captured pieces. Corrected shares "
            "allow for the errors of the classifier. The labels describe the judgement of one "
            "person."
        ),
    ]


def _balance_section(evaluation: Evaluation) -> list[str]:
    figure = plots.draw_balance({"static, all grounded frames": _static_rows(evaluation)})
    head = ["method", "rule", "unbalanced", "of changed", "change, points", "flight", "runs", "n"]
    order = {
        (row.kind, row.rule, row.margin): place for place, row in enumerate(evaluation.balance)
    }
    rows = sorted(evaluation.balance, key=lambda row: order[row.kind, row.rule, row.margin])
    model = mass_model(evaluation.library.skeleton)
    masses = (
        "has the masses of de Leva"
        if model.model == "de Leva"
        else "has rods with masses in proportion to the bone lengths, since the skeleton is not "
        "recognized as human"
    )
    unmatched = ", ".join(model.unmatched)
    unknown = f" Joints with unknown names: {unmatched}." if unmatched else ""
    return [
        "<h2>Balance</h2>",
        plots.as_image(figure, "Unbalanced segments of each method"),
        html_table(head, [_balance_cells(row) for row in rows]),
        note(
            f"The body model {masses}.{unknown} The rule states in which frames with a foot on the "
            "floor the reference point must be outside of the hull of the soles for a segment to "
            "be unbalanced: in all, in the majority or in any of them. The reference point of "
            "static balance is the projected centre of mass, that of dynamic balance is the "
            "zero-moment point. The change is paired: it compares changed segments with the same "
            "segments of the recording. An unbalanced segment is not necessarily unnatural: "
            "walking is statically unbalanced."
        ),
    ]


def _balance_cells(row: BalanceRow) -> list[str]:
    is_recording = row.method == "recording"
    return [
        html.escape(row.method),
        f"{row.kind}, {row.rule}" + (f", margin {row.margin:g}" if row.margin else ""),
        row.rate.text(1, 100, " %"),
        "" if is_recording else row.changed.text(1, 100, " %"),
        "" if is_recording else row.difference.text(1, 100),
        f"{100 * row.flight:.0f} %",
        str(row.runs),
        str(row.rate.n if is_recording else row.difference.n),
    ]


def _enrichment_section(evaluation: Evaluation, found: Enrichment) -> list[str]:
    head = ["groups", "clusters", "combinations", "per segment", "length limit", "new"]
    rows = [
        [
            str(count.groups),
            html.escape(
                ", ".join(f"{g} {n}" for g, n in evaluation.clusters.get(count.groups, {}).items())
                or "no preset"
            ),
            format_number(count.unfiltered),
            f"{count.unfiltered / found.segments:.1f}",
            format_number(count.filtered),
            format_number(count.new),
        ]
        for count in found.counts
    ]
    parts = ["<h2>Enrichment</h2>", html_table(head, rows)]
    if evaluation.sweep:
        paper = {
            k: [counts[k] / segments for _, segments, counts in PAPER_TABLES.values()]
            for k in (2, 3, 4, 5)
        }
        figure = plots.draw_counts({"scales": evaluation.sweep}, paper)
        parts.append(plots.as_image(figure, "Combinations by scale of the threshold"))
    failed = ", ".join(law.name for law in evaluation.laws if not law.holds)
    laws = (
        f"The counts violate laws of moments: {failed}."
        if failed
        else "The counts satisfy all laws of moments, as the counts of one clustering must."
    )
    parts.append(
        note(
            f"Threshold {found.sigma} times {found.sigma_scale:g}: {found.clusters} clusters of "
            f"the base group, the largest with {found.largest} segments. {laws} In the figure, "
            "dotted lines have the length limit. Triangles are tables 1 and 2 of the paper; their "
            "counts for five groups cannot come from a single clustering. Counts do not measure "
            "the quality of the combinations."
        )
    )
    return parts
