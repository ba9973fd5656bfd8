"""The page of an evaluation: sentences, tables, intervals and limitations."""

import html
import json
from collections.abc import Sequence

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft.body.mass import mass_model
from mograft.evaluation.balance import BalanceRow
from mograft.evaluation.detectability import Detectability
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.quality import Quality
from mograft.evaluation.suite import Evaluation
from mograft.evaluation.world_measures import WorldQuality
from mograft.viewing.page import Page, assemble_page
from mograft.viewing.report import REPORT_STYLE, wide_table

_EXTRA_STYLE = """
.report li { max-width: 75ch; margin: 4px 0; }
.report .refused { border-left: 3px solid var(--accent); padding-left: 12px; }
"""


def summarize(evaluation: Evaluation) -> list[str]:
    """Return sentences on the findings, and one for each measure without sufficient data."""
    sentences: list[str] = []
    for measures in evaluation.quality:
        share = measures.new_segments
        sentences.append(
            f"{share.text(0, 100, ' %')} of the parts of {measures.method} are exchanged. The mean "
            f"seam gap is {measures.seam_gap.text(1, 1, '°')}. The acceleration is "
            f"{measures.acceleration.text(2)} times that of the recording."
        )
    for row in evaluation.world:
        sentences.append(
            f"The jerk of the head of {row.method} is {row.head_jerk.text(2)} times that of base "
            f"and donors. {row.novelty.changed.text(0, 100, ' %')} of the half-second windows "
            f"differ from the base. Grafts of one base are {row.novelty.between.text(2)} of the "
            "distance of random captured windows apart."
        )
    for found in evaluation.detectability:
        gross, null = found.seams.gross, found.other_moments.gross
        sentences.append(
            f"A classifier distinguishes windows at seams of {found.method} from captured windows "
            f"with an AUC of {gross.text(2)}; one that also has magnitudes up to jerk, with an AUC "
            f"of {found.seams.fine.text(2)}; both in {gross.n} test windows. For captured windows "
            f"of other moments, the AUC of the first classifier is {null.text(2)}."
        )
    for balance in evaluation.balance:
        if balance.kind != "static":
            continue
        change = balance.difference_changed.text(1, 100, " points")
        sentences.append(
            f"{balance.rate.text(1, 100, ' %')} of the segments of the recording are statically "
            "unbalanced in all grounded frames."
            if balance.method == "recording"
            else f"In {balance.method} this changes by {change} on the same segments."
        )
    return [*sentences, *(f"Not measured, {refusal}" for refusal in _refusals(evaluation))]


def _refusals(evaluation: Evaluation) -> list[str]:
    return [f"{topic}: {reason}" for topic, reason in evaluation.refusals.items()]


def _section(heading: str, note: str, *tables: str) -> list[str]:
    """Return the HTML of a section: heading, tables, and a paragraph of explanation."""
    return [f"<h2>{heading}</h2>", *tables, f'<p class="note">{html.escape(note)}</p>']


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
    parts = ["<main>", f"<h1>{html.escape(title)}</h1>", f'<p class="lead">{html.escape(lead)}</p>']
    parts += ["<h2>Summary</h2>", _list(summarize(evaluation))]
    if refusals := _refusals(evaluation):
        parts += ["<h2>Not measured</h2>", f'<div class="refused">{_list(refusals)}</div>']
    parts += _quality_section(evaluation.quality) if evaluation.quality else []
    parts += _world_section(evaluation.world) if evaluation.world else []
    parts += _detectability_section(evaluation.detectability) if evaluation.detectability else []
    parts += _balance_section(evaluation) if evaluation.balance else []
    parameters = html.escape(json.dumps(dict(evaluation.parameters), indent=1))
    parts += ["<h2>Parameters</h2>", "<details><summary>All parameters</summary>"]
    parts += [f"<pre>{parameters}</pre></details>", "</main>"]
    return assemble_page(title, "\n".join(parts), "report", REPORT_STYLE + _EXTRA_STYLE, "")


def _list(sentences: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{html.escape(sentence)}</li>' for sentence in sentences)}</ul>"


def _quality_section(qualities: Sequence[Quality]) -> list[str]:
    measures = (
        ("new parts", "new_segments", 0, 100, " %"),
        ("seam gap", "seam_gap", 1, 1, "°"),
        ("acceleration", "acceleration", 2, 1, ""),
        ("jerk", "jerk", 2, 1, ""),
        ("diversity", "diversity", 1, 1, "°"),
    )
    return _section(
        "Quality",
        "Acceleration and jerk: those of the grafted joints divided by those of the recording. "
        "Diversity: between grafts of one base. All measures are relative to these recordings.",
        _measure_table([row.method for row in qualities], qualities, measures),
    )


def _measure_table(
    methods: Sequence[str],
    records: Sequence[object],
    measures: Sequence[tuple[str, str, int, float, str]],
) -> str:
    """Return an HTML table with a row for each measure and a column for each method.

    A measure is (title, field of `records`, digits, scale, suffix); see `Estimate.text`.
    """
    rows = []
    for title, name, digits, scale, suffix in measures:
        estimates: list[Estimate] = [getattr(record, name) for record in records]
        cells = [found.text(digits, scale, suffix) for found in estimates]
        n = max(found.n for found in estimates)
        rows.append([title, *cells, f"{n} {estimates[0].unit}"])
    return wide_table(["measure", *methods, "n"], rows)


def _world_section(qualities: Sequence[WorldQuality]) -> list[str]:
    methods = [row.method for row in qualities]
    measures = (
        ("jerk of the head", "head_jerk", 2, 1, ""),
        ("jerk of the chest", "chest_jerk", 2, 1, ""),
        ("jerk of the hands", "hands_jerk", 2, 1, ""),
        ("floor depth, % of height", "floor_depth", 2, 100.0, ""),
        ("feet under the floor, points", "under_floor", 1, 100.0, ""),
        ("foot skate, points", "skate", 1, 100.0, ""),
        ("out of balance, points", "balance", 1, 100.0, ""),
    )
    variety = (
        ("changed windows", "changed", 0, 100.0, " %"),
        ("novelty", "novelty", 2, 1, ""),
        ("coverage", "coverage", 0, 100.0, " %"),
        ("between grafts", "between", 2, 1, ""),
    )
    return _section(
        "World space",
        "Jerk: median over exchanged frames, divided by that of base and donors. The other "
        "rows of the first table are differences from the base: largest depth of a heel or "
        "toe under the floor, share of them more than 1.2 % of the height under it, sliding "
        "feet, and frames with the zero-moment point outside of the support. Novelty: "
        "distance from the nearest captured half-second window; 1 is the median distance of "
        "a captured window from the nearest other one. Coverage: share of the captured "
        "windows within this median distance of a changed window. Between grafts: distance "
        "of two grafts of one base; 1 is that of random captured windows.",
        _measure_table(methods, qualities, measures),
        _measure_table(methods, [row.novelty for row in qualities], variety),
    )


def _detectability_section(rows: Sequence[Detectability]) -> list[str]:
    titles = {
        "seams": "at seams",
        "between_seams": "between seams",
        "other_moments": "null: captured, other moments",
        "donor_windows": "null: captured windows of the donors",
    }
    found = [
        (row.method, title, getattr(row, name)) for row in rows for name, title in titles.items()
    ]
    cells = [
        [html.escape(method), title, own.gross.text(2), own.fine.text(2), str(own.gross.n)]
        for method, title, own in found
    ]
    return _section(
        "Detectability",
        "Area under the ROC curve of a classifier that distinguishes windows of grafts from "
        "captured windows at the same frames: 0.5 is chance. Gross: boosted trees on "
        "positions, velocities and accelerations of bone ends. Fine: logistic regression, "
        "also on the magnitudes of velocity, acceleration and jerk. The training windows do "
        "not come from the five-second blocks of the base and donors of a test window. The "
        "null rows compare captured windows with captured windows. n: test windows of grafts.",
        wide_table(["method", "windows", "gross", "fine", "n"], cells),
    )


def _balance_section(evaluation: Evaluation) -> list[str]:
    head = ["method", "balance", "unbalanced", "of changed", "change, points"]
    head += ["flight", "runs", "n"]
    rows = sorted(evaluation.balance, key=lambda row: row.kind, reverse=True)
    model, masses = mass_model(evaluation.library.skeleton), "has the masses of de Leva"
    if model.model != "de Leva":
        masses = (
            "has rods with masses in proportion to the bone lengths, since the skeleton is not "
            "recognized as human"
        )
    unmatched = ", ".join(model.unmatched)
    unknown = f" Joints with unknown names: {unmatched}." if unmatched else ""
    return _section(
        "Balance",
        f"The body model {masses}.{unknown} A segment is unbalanced if the reference point is "
        "outside of the hull of the soles in all frames with a foot on the floor. That of "
        "static balance is the projected centre of mass, that of dynamic balance is the "
        "zero-moment point. The change is paired: it compares changed segments with the same "
        "segments of the recording. An unbalanced segment is not necessarily unnatural: "
        "walking is statically unbalanced.",
        wide_table(head, [_balance_cells(row) for row in rows]),
    )


def _balance_cells(row: BalanceRow) -> list[str]:
    change, n = ["", ""], row.rate.n
    if row.method != "recording":
        changed, difference = row.rate_changed, row.difference_changed
        change, n = [changed.text(1, 100, " %"), difference.text(1, 100)], difference.n
    cells = [html.escape(row.method), row.kind, row.rate.text(1, 100, " %")]
    return [*cells, *change, f"{100 * row.flight:.0f} %", str(row.runs), str(n)]
