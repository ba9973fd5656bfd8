"""The report page of grafts: motions, seams, donors and parameters."""

import html
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import FloatArray
from mograft._util.html_table import html_table
from mograft._util.verdict import compare
from mograft.body.mass import center_of_mass, mass_model
from mograft.library.library import Library
from mograft.search.costs import PRESELECTION, length_fits
from mograft.search.neighbourhoods import NEIGHBOURHOODS
from mograft.solve.candidates import count_combinations
from mograft.synthesis.graft_result import Graft, find_missing, seam_limit
from mograft.synthesis.newness import newness
from mograft.viewing.page import Page, assemble_page, asset, viewer_html
from mograft.viewing.scene import Scene

_MAX_SHOWN = 4
"""Maximum number of grafts that the viewer shows at first, beside their base."""

_WIDTH, _HEIGHT, _MARGIN = 480, 220, 44  # of a curve, in pixels

REPORT_STYLE = f"\n{asset('report.css')}\n"


def report_page(
    grafts: Sequence[Graft],
    files: Sequence[Path | None] = (),
    title: str | None = None,
    *,
    columns: Sequence[Mapping[str, str]] = (),
) -> Page:
    """Return a report page about grafts, with tables and the viewer.

    Parameters
    ----------
    grafts : sequence of Graft
        Grafts of one base and one library.
    files : sequence of Path or None, optional
        The file of each graft. The page links to it, and shows commands that edit the graft from
        the provenance beside it. For None, the page shows neither a link nor commands. Relative
        paths are relative to the page.
    title : str, optional
        Title of the page. Default: the name of the base and the number of motions.
    columns : sequence of mapping of str to str, optional
        Additional columns of the table of motions: for each graft, the text of each column by
        title, such as ``evaluation.world_measures(graft).columns()``.

    Returns
    -------
    Page
        The page. The viewer shows the base and the first four grafts, and others on request.

    Raises
    ------
    ValueError
        If there is no graft, or the number of files or columns differs from that of the grafts.

    Examples
    --------
    >>> from mograft import Library, graft
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> report_page([graft(library)]).title
    'dance: 1 new motion'
    """
    if not grafts:
        raise ValueError("`grafts` must contain at least one graft, got none")
    for name, values in (("files", files), ("columns", columns)):
        if values and len(values) != len(grafts):
            raise ValueError(
                f"`{name}` must have {len(grafts)} entries, one per graft, got {len(values)}"
            )
    first = grafts[0]
    library = first.library
    count = "1 new motion" if len(grafts) == 1 else f"{len(grafts)} new motions"
    heading = title or f"{first.base.name}: {count}"
    lead = (
        f"{count} on the base {first.base.name}. Captured group: {library.groups.base}; exchanged: "
        f"{', '.join(first.alternatives)}. Seed {first.seed}, mograft {VERSION}."
    )
    shown = ""
    if len(grafts) > _MAX_SHOWN:
        shown = f"The buttons above the figures show and hide each of the {len(grafts)} motions. "
    summary = "\n".join(graft.report() for graft in grafts)
    motions = _motion_table(grafts, files or [None] * len(grafts), columns or [{}] * len(grafts))
    pairs = zip(grafts, files, strict=False)  # a graft with a file has the command that edits it
    scene = Scene.of(grafts).with_files({id(own.motion): path for own, path in pairs if path})
    parameters = _parameter_table(library).replace('class="wide"', 'class="wide plain"')
    body_html = f"""<main>
<h1>{html.escape(heading)}</h1>
<p class="lead">{html.escape(lead)}</p>
{viewer_html(scene, n_shown=1 + _MAX_SHOWN)}
<p class="note">{shown}{_TIMELINE_NOTE}</p>
{_cards(library)}
<h2>Motions</h2>
{motions}
<p class="note">{_MOTION_NOTE}{_MEASURE_NOTE if columns else ""}</p>
<h2>Limits on donors</h2>
{_donor_table(first)}
<h2>Clips</h2>
{_clip_table(grafts)}
{_details("Summary", f"<pre>{html.escape(summary)}</pre>")}
{_details("Parameters", parameters)}
</main>"""
    return assemble_page(heading, body_html, "report", REPORT_STYLE)


def _details(heading: str, content: str) -> str:
    return f"<details><summary><h2>{heading}</h2></summary>\n{content}\n</details>"


_TIMELINE_NOTE = (
    "Coloured blocks of the timeline are exchanged, one colour per clip; the mark at the left edge "
    "of a block is the angle of its seam. Click a block to list its donors, point at a donor to "
    "see it; your choices become a command."
)
_MOTION_NOTE = (
    "New frames: share of frames in which a grafted joint differs by more than 5° from the base; "
    "then the mean angle of these joints to the base and to the nearest other motion of the page. "
    "Seam angle: mean angle between the joints of the two poses that meet at a seam, before "
    "blending. Balance shift: horizontal distance between the centres of mass of the motion and "
    "of its base, in percent of the body height."
)
_MEASURE_NOTE = (
    " Jerk: of the end of the bone in the world, divided by that of base and donors. Floor depth, "
    "foot skate and out of balance: difference from the base; depth in percent of the body height, "
    "out of balance over frames with the zero-moment point outside of the support. In brackets: "
    "the middle half of the parts of the base."
)
_DONOR_NOTE = (
    "Average number of donors per segment that satisfy each condition and all previous ones: "
    "{inside}; similar duration and no recording fault; candidate, that is, allowed by the "
    "constraints and, if there are no constraints, among the cheapest donors "
    f"({PRESELECTION} times max_candidates). A segment without donors keeps its captured motion."
)


def _cards(library: Library) -> str:
    n, n_clips = len(library.segments), len(library.entries)
    frames = sum(entry.n_frames for entry in library.entries)
    total = count_combinations(library.labels[library.groups.base], len(library.groups.names))
    counts = {
        "clip" if n_clips == 1 else "clips": n_clips,
        f"frames, {(frames - n_clips) / library.rate:.0f} s": frames,
        "segments": n,
        **{f"clusters of {own}": int(found.max()) + 1 for own, found in library.labels.items()},
    }
    cards = {label: format_number(count) for label, count in counts.items()}
    combinations = f"as many combinations as segments ({format_number(total)} in all)"
    cards[combinations] = f"{total / n:.1f} \N{MULTIPLICATION SIGN}"
    items = (
        f"<div><b>{n}</b><span>{html.escape(label)}</span></div>" for label, n in cards.items()
    )
    return f'<div class="cards">{"".join(items)}</div>'


def _motion_table(
    grafts: Sequence[Graft], links: Sequence[Path | None], columns: Sequence[Mapping[str, str]]
) -> str:
    rows = []
    for graft, link, more in zip(grafts, links, columns, strict=True):
        new = sum(not s.is_own for s in graft.substitutions)
        angles = np.degrees([seam.gap for seam in graft.seams])
        n_without = sum(int(find_missing(graft, group).sum()) for group in graft.alternatives)
        shift, largest = 100 * _balance_shift(graft), float(angles.max(initial=0.0))
        verdict = compare(largest, 0.0, float(np.degrees(seam_limit(graft))), ".0f")
        found = newness(graft, [other.motion for other in grafts if other is not graft])
        apart = "none" if found.apart is None else f"{np.degrees(found.apart):.1f}°"
        rows.append(
            {
                "motion": _link(graft.motion.name, link),
                "segments exchanged": f"{new} of {len(graft.substitutions)}",
                "segments kept": f"{len(graft.substitutions) - new}",
                "without other donors": f"{n_without}",
                "new frames": f"{found.new:.0%}",
                "from the base": f"{np.degrees(found.changed):.1f}°",
                "from the nearest other": apart,
                "seams": f"{len(angles)}",
                "seam angle, mean": f"{angles.mean():.1f}°" if len(angles) else "none",
                "seam angle, largest": f"{largest:.1f}° ({verdict})" if len(angles) else "none",
                "balance shift, mean": f"{shift.mean():.1f} %",
                "balance shift, largest": f"{shift.max():.1f} %",
                **{title: html.escape(text) for title, text in more.items()},
            }
        )
    return wide_table(list(rows[0]), [list(row.values()) for row in rows])


def _balance_shift(graft: Graft) -> FloatArray:
    """Return the horizontal distance between the centres of mass of a graft and of its base.

    It is in body heights, one value per frame.
    """
    offset = center_of_mass(graft.motion) - center_of_mass(graft.base)
    offset[:, graft.library.up] = 0.0
    return np.linalg.norm(offset, axis=1) / mass_model(graft.base.skeleton).height


def _donor_table(graft: Graft) -> str:
    """Return an HTML table of the mean number of donors per segment by condition, and a note.

    A donor counts for a condition only if it also satisfies those of the previous columns.
    """
    library = graft.library
    lengths = library.segments.lengths
    used = np.unique([s.segment for s in graft.substitutions])
    # The neighbourhood depends on the base group only: it is the same for all grafted groups.
    neighbours = library.pool(next(iter(graft.alternatives))).neighbours(used, library.config)
    n_similar, n_fitting = [], []
    for segment, similar in zip(used.tolist(), neighbours, strict=True):
        fits = length_fits(lengths[[segment]], lengths[similar], library.rate, library.config)
        n_similar.append(len(similar) - 1)
        n_fitting.append((fits & library.is_donor[similar] & (similar != segment)).sum())
    inside = NEIGHBOURHOODS[library.config.neighbourhood].inside
    head = ["group", f"{inside} of {library.groups.base}", "similar duration"]
    head += ["candidates", "segments without donors"]
    rows = []
    for group, counts in graft.alternatives.items():
        means = [f"{np.mean(own):.1f}" for own in (n_similar, n_fitting, counts)]
        n_without = f"{int(find_missing(graft, group).sum())} of {len(counts)}"
        rows.append([html.escape(group), *means, n_without])
    return f'{wide_table(head, rows)}\n<p class="note">{_DONOR_NOTE.format(inside=inside)}</p>'


def _clip_table(grafts: Sequence[Graft]) -> str:
    """Return an HTML table of the clips used in the grafts, and the number of clips not used."""
    library = grafts[0].library
    donors: Counter[int] = Counter()
    frames: Counter[int] = Counter()
    clips = set()
    for substitution in (s for graft in grafts for s in graft.substitutions):
        clip = int(library.segments.clip[substitution.donor])
        clips |= {clip, int(library.segments.clip[substitution.segment])}
        if not substitution.is_own:
            donors[clip] += 1
            frames[clip] += substitution.donor_stop - substitution.donor_start
    rows = []
    for clip in sorted(clips):
        entry, file = library.entries[clip], library.file_name(clip)
        name = html.escape(f"{entry.name} ({file})" if file else entry.name)
        n, *used = map(format_number, (entry.n_frames, donors[clip], frames[clip]))
        rows.append([name, n, f"{(entry.n_frames - 1) / library.rate:.1f} s", *used])
    table = wide_table(["clip", "frames", "duration", "donors used", "donor frames used"], rows)
    n_others = len(library.entries) - len(rows)
    others = (
        f"{format_number(n_others)} other clip{'s'[: n_others - 1]} of the library are not used."
    )
    return f'{table}<p class="note">{others}</p>' if n_others else table


def _parameter_table(library: Library) -> str:
    rows = [(name, _format(value)) for name, value in library.config.as_dict().items()]
    names = library.skeleton.names
    for group, joints in library.groups.resolve(library.skeleton).items():
        label = f"group {group}{' (base)' if group == library.groups.base else ''}"
        rows.append((label, ", ".join(names[j] for j in joints)))
    return wide_table(["parameter", "value"], [list(map(html.escape, row)) for row in rows])


def _format(value: object) -> str:
    if value is None:
        return "unlimited"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def format_number(value: int) -> str:
    """Return an integer with thin spaces between groups of three digits."""
    return f"{value:,}".replace(",", "\N{THIN SPACE}")


def _link(name: str, path: Path | None) -> str:
    """Return HTML for the name of a motion: a link to its file, or the name if `path` is None.

    Relative links begin with ``./``, as browsers read the start of ``a:b.bvh`` as a URL scheme.
    """
    if path is None:
        return html.escape(name)
    target = path.as_uri() if path.is_absolute() else "./" + quote(os.fsencode(path.as_posix()))
    return f'<a href="{html.escape(target)}">{html.escape(path.name)}</a>'


def wide_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an HTML table that scrolls; texts of `head` are plain, cells of `rows` are HTML."""
    cells = ("".join(f"<td>{cell}</td>" for cell in row) for row in rows)
    return f'<div class="wide">{html_table(head, cells)}</div>'


def curve_svg(title: str, shares: FloatArray, unit: str) -> str:
    """Return a curve of two shares, (n, 2), as SVG, which needs neither scripts nor style sheets.

    `unit` is that of the first share, whose axis ends with the curve.
    """
    right = max(float(shares[-1, 0]), 1e-9)
    left, top, bottom, end = _MARGIN, _MARGIN, _HEIGHT - _MARGIN, _WIDTH - _MARGIN
    x = left + shares[:, 0] / right * (end - left)
    y = bottom - shares[:, 1] * (bottom - top)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    line = 'stroke="currentColor" fill="none"'
    text = 'fill="currentColor" font-size="12"'
    return f"""<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" height="{_HEIGHT}" role="img">
<title>{title}</title>
<path d="M{left} {top}V{bottom}H{end}" opacity="0.5" {line}/>
<polyline points="{points}" stroke-width="2" {line}/>
<text x="{left - 6}" y="{top + 4}" text-anchor="end" {text}>100 %</text>
<text x="{left - 6}" y="{bottom + 4}" text-anchor="end" {text}>0 %</text>
<text x="{end}" y="{bottom + 18}" text-anchor="end" {text}>{right:.1%} {unit}</text>
</svg>"""
