"""The sections of an evaluation page on quality, world-space measures and detectability."""

import html
from collections.abc import Sequence

from mograft.evaluation.detectability import Detectability
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.quality import Quality
from mograft.evaluation.world_quality import WorldQuality
from mograft.viewing.plot import evaluation_plots as plots
from mograft.viewing.report import html_table


def note(text: str) -> str:
    """Return a paragraph of explanation."""
    return f'<p class="note">{html.escape(text)}</p>'


def world_sentences(qualities: Sequence[WorldQuality], rows: Sequence[Detectability]) -> list[str]:
    """Return one sentence each on world-space measures and detectability, if they were measured.

    The sentences are on the method "analogy, by cost".
    """
    sentences = []
    for row in qualities:
        if row.method == "analogy, by cost":
            sentences.append(
                f"With choice by cost, the jerk of the head is {row.head_jerk.text(2)} times that "
                f"of base and donors. The share of frames with the zero-moment point outside of "
                f"the support increases by {row.balance.text(1, 100, ' points')}."
            )
    for found in rows:
        if found.method == "analogy, by cost":
            gross, null = found.seams.gross, found.other_moments.gross
            sentences.append(
                f"A classifier distinguishes windows at seams from captured windows with an AUC of "
                f"{gross.text(2)}; one that also has magnitudes up to jerk, with an AUC of "
                f"{found.seams.fine.text(2)}; both in {gross.n} test windows. For captured windows "
                f"of other moments, the AUC of the first classifier is {null.text(2)}."
            )
    return sentences


def quality_section(qualities: Sequence[Quality]) -> list[str]:
    """Return the HTML lines of the section on the quality of each method."""
    measures = (
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
        ("arms and legs, lag", "lag", 2, 1, " s"),
    )
    figure = plots.draw_quality(qualities)
    return [
        "<h2>Quality</h2>",
        plots.as_image(figure, "Measures of quality of each method"),
        _measure_table([row.method for row in qualities], qualities, measures),
        note(
            "Acceleration and jerk: those of the grafted joints divided by those of the recording. "
            "Foot skate: minus that of the recording. Coverage: share of the one-second windows of "
            "the library that are near a window of the graft. Local diversity: distance from the "
            "nearest captured half-second window. Diversity: between grafts of one base. Arms and "
            "legs: change in the correlation of arm swing and opposite leg swing, and of its lag. "
            "All measures are relative to these recordings."
        ),
    ]


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
    return html_table(["measure", *methods, "n"], rows)


def world_section(qualities: Sequence[WorldQuality]) -> list[str]:
    """Return the HTML lines of the section on the world-space measures of each method."""
    methods = [row.method for row in qualities]
    measures = (
        ("jerk of the head", "head_jerk", 2, 1.0, ""),
        ("jerk of the chest", "chest_jerk", 2, 1.0, ""),
        ("jerk of the hands", "hands_jerk", 2, 1.0, ""),
        ("floor depth, % of height", "floor_depth", 2, 100.0, ""),
        ("feet under the floor, points", "under_floor", 1, 100.0, ""),
        ("foot skate, points", "skate", 1, 100.0, ""),
        ("out of balance, points", "balance", 1, 100.0, ""),
    )
    variety = (
        ("changed windows", "changed", 0, 100.0, " %"),
        ("novelty", "novelty", 2, 1.0, ""),
        ("coverage", "coverage", 0, 100.0, " %"),
        ("between grafts", "between", 2, 1.0, ""),
    )
    return [
        "<h2>World space</h2>",
        plots.as_image(plots.draw_world(qualities), "World-space measures of each method"),
        _measure_table(methods, qualities, measures),
        _measure_table(methods, [row.novelty for row in qualities], variety),
        note(
            "Jerk: median over exchanged frames, divided by that of base and donors. The other "
            "rows of the first table are differences from the base: largest depth of a heel or "
            "toe under the floor, share of them more than 1.2 % of the height under it, sliding "
            "feet, and frames with the zero-moment point outside of the support. Novelty: "
            "distance from the nearest captured half-second window; 1 is the median distance of "
            "a captured window from the nearest other one. Coverage: share of the captured "
            "windows within this median distance of a changed window. Between grafts: distance "
            "of two grafts of one base; 1 is that of random captured windows."
        ),
    ]


def detectability_section(rows: Sequence[Detectability]) -> list[str]:
    """Return the HTML lines of the section on the detectability of each method."""
    titles = {
        "seams": "at seams",
        "between_seams": "between seams",
        "other_moments": "null: captured, other moments",
        "donor_windows": "null: captured windows of the donors",
    }
    cells = [
        [
            html.escape(row.method),
            title,
            found.gross.text(2),
            found.fine.text(2),
            str(found.gross.n),
        ]
        for row in rows
        for name, title in titles.items()
        for found in [getattr(row, name)]
    ]
    return [
        "<h2>Detectability</h2>",
        plots.as_image(plots.draw_detectability(rows), "Detectability of each method"),
        html_table(["method", "windows", "gross", "fine", "n"], cells),
        note(
            "Area under the ROC curve of a classifier that distinguishes windows of grafts from "
            "captured windows at the same frames: 0.5 is chance. Gross: boosted trees on "
            "positions, velocities and accelerations of bone ends. Fine: logistic regression, "
            "also on the magnitudes of velocity, acceleration and jerk. The training windows do "
            "not come from the five-second blocks of the base and donors of a test window. The "
            "null rows compare captured windows with captured windows. n: test windows of grafts."
        ),
    ]
