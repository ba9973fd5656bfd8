"""The page that ends a run: what was made, from what, and how well it holds together."""

import html
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import FloatArray, IntArray
from mograft.body.mass import center_of_mass, mass_model
from mograft.library.library import Library
from mograft.search.candidates import count_combinations, length_fits
from mograft.synthesis.graft import Graft
from mograft.viewing.page import Page, assembled, viewer
from mograft.viewing.scene import Scene

__all__ = ["report_page"]

_SHOWN = 4
"""Grafts that the viewer shows at once: more are too small to be judged."""

STYLE = """
.report main { max-width: 1180px; margin: 0 auto; padding: 20px 20px 60px; }
.report h1 { font-size: 26px; line-height: 1.2; margin: 8px 0 4px; overflow-wrap: anywhere; }
.report h2 { font-size: 18px; margin: 34px 0 8px; }
.report .lead { color: var(--faint); margin: 0 0 18px; font-size: 15px; }
.report .viewer { height: 78vh; min-height: 560px; border: 1px solid var(--line);
  border-radius: 10px; overflow: hidden auto; }
@media (max-width: 600px) {
  .report main { padding-inline: 12px; }
  .report .viewer { height: auto; }
  .report .viewer .stage { min-height: 470px; }
}
.report .cards { display: grid; gap: 12px; margin: 18px 0;
  grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); }
.report .cards div { background: var(--panel); border-radius: 10px; padding: 12px 14px; }
.report .cards b { display: block; font-size: 24px; font-variant-numeric: tabular-nums; }
.report .cards span { color: var(--faint); font-size: 13px; }
.report .wide { overflow-x: auto; }
.report main > .wide table { border-collapse: collapse; min-width: 100%; font-size: 14px; }
.report main > .wide :is(th, td) { text-align: right; padding: 6px 10px;
  border-bottom: 1px solid var(--line); font-variant-numeric: tabular-nums; }
.report main > .wide :is(th, td):first-child { text-align: left; overflow-wrap: anywhere;
  min-width: 10.5em; padding-left: 0; }
.report main > .plain :is(th, td) { text-align: left; }
.report th { color: var(--faint); font-weight: 500; font-size: 12.5px; vertical-align: bottom; }
.report a { color: var(--group0); }
.report .charts { display: grid; gap: 24px;
  grid-template-columns: repeat(auto-fit, minmax(280px, 1fr)); }
.report figure { margin: 0; } .report figcaption { font-size: 13px; color: var(--faint); }
.report svg.chart { width: 100%; height: auto; display: block; font-size: 11px; }
.report svg text { fill: var(--faint); } .report svg .bar { fill: var(--group0); }
.report svg .over { fill: var(--accent); } .report svg .axis { stroke: var(--line); }
.report pre { background: var(--panel); border-radius: 8px; padding: 10px 14px; overflow-x: auto;
  font-size: 13px; }
.report .note { color: var(--faint); font-size: 13.5px; max-width: 75ch; }
"""


def report_page(
    grafts: Sequence[Graft],
    files: Sequence[Path | None] = (),
    title: str | None = None,
) -> Page:
    """Return a page that tells what grafts are made of, with the viewer in it.

    Parameters
    ----------
    grafts : sequence of Graft
        The grafts of one run: of one base and one library.
    files : sequence of Path or None, optional
        The file of each graft, as the page should link to it: relative to where the page is.
    title : str, optional
        The page's title. Default: the base's name and how many motions were made.

    Returns
    -------
    Page
        The page; the viewer shows the base and the first four grafts.

    Raises
    ------
    ValueError
        If there is no graft, or files are given for another number of grafts.

    Examples
    --------
    >>> from mograft import Library, graft
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> report_page([graft(library)]).title
    'dance: 1 new motion'
    """
    if not grafts:
        raise ValueError("grafts must hold at least one, got none")
    if files and len(files) != len(grafts):
        raise ValueError(f"files must be given for {len(grafts)} grafts, got {len(files)}")
    first = grafts[0]
    count = "1 new motion" if len(grafts) == 1 else f"{len(grafts)} new motions"
    named = title or f"{first.base.name}: {count}"
    links = list(files) or [None] * len(grafts)
    library = first.library
    base = library.groups.base
    *others, last = first.alternatives
    swapped = f"{', '.join(others)} and {last} come" if others else f"{last} comes"
    lead = (
        f"{count}: of {first.base.name} the group {base} is kept; {swapped} from elsewhere. "
        f"Seed {first.seed}, mograft {VERSION}."
    )
    more = len(grafts) - _SHOWN
    note = f"The viewer shows the first {_SHOWN} of {len(grafts)}. " if more > 0 else ""
    body_text = "\n".join(
        [
            "<main>",
            f"<h1>{html.escape(named)}</h1>",
            f'<p class="lead">{html.escape(lead)}</p>',
            viewer(Scene.of(grafts[:_SHOWN])),
            f'<p class="note">{note}Hatched parts of the timeline were exchanged; point at one '
            "to see its donor.</p>",
            _cards(library),
            "<h2>What was made</h2>",
            _made(grafts, links),
            f'<p class="note">{_MADE}</p>',
            "<h2>Seams and choice</h2>",
            _charts(grafts),
            "<h2>Why not more</h2>",
            _funnel(first),
            f'<p class="note">{_WHY}</p>',
            "<h2>From what</h2>",
            _sources(grafts),
            "<h2>In words</h2>",
            f"<pre>{html.escape(chr(10).join(own.report() for own in grafts))}</pre>",
            "<h2>By which parameters</h2>",
            _parameters(library).replace('class="wide"', 'class="wide plain"'),
            "</main>",
        ]
    )
    return assembled(named, body_text, "report", STYLE)


_MADE = (
    "Gap: the mean angle between the joints of two poses that meet at a seam, before it is "
    "closed. Balance: how far the centre of mass strays from where it is in the base, in "
    "heights of the figure; legs that were captured under one upper body carry another."
)
_WHY = (
    "Donors that each segment has on average. Of those whose base group moves alike some are "
    "too long or too short, or hold a fault; of those that fit some would leave a gap wider "
    "than the limit at every neighbour they could have. Segments without a donor keep their own."
)


def _cards(library: Library) -> str:
    base = library.groups.base
    n = len(library.segments)
    frames = sum(entry.n_frames for entry in library.entries)
    seconds = (frames - len(library.entries)) / library.rate
    whole = count_combinations(library.labels[base], len(library.groups.names))
    cards = [
        (number(len(library.entries)), "clip" if len(library.entries) == 1 else "clips"),
        (number(frames), f"frames, {seconds:.0f} s"),
        (number(n), "segments"),
        *(
            (number(int(labels.max()) + 1), f"clusters of {group}")
            for group, labels in library.labels.items()
        ),
        (
            f"{whole / n:.1f} \N{MULTIPLICATION SIGN}",
            f"{number(whole)} combinations of what was captured",
        ),
    ]
    shown = "".join(
        f"<div><b>{html.escape(value)}</b><span>{html.escape(what)}</span></div>"
        for value, what in cards
    )
    return f'<div class="cards">{shown}</div>'


def _made(grafts: Sequence[Graft], links: Sequence[Path | None]) -> str:
    head = ["motion", "parts exchanged", "kept", "no candidate", "seams"]
    head += ["mean gap", "widest gap", "balance, mean", "balance, most"]
    rows = []
    for own, link in zip(grafts, links, strict=True):
        new = sum(not s.is_own for s in own.substitutions)
        gaps = np.degrees([seam.gap for seam in own.seams])
        stray = _stray(own)
        rows.append(
            [
                _link(own.motion.name, link),
                f"{new} of {len(own.substitutions)}",
                f"{len(own.substitutions) - new}",
                f"{sum(int((counts == 0).sum()) for counts in own.alternatives.values())}",
                f"{len(gaps)}",
                f"{gaps.mean():.1f}°" if len(gaps) else "none",
                f"{gaps.max():.1f}°" if len(gaps) else "none",
                f"{100 * stray.mean():.1f} %",
                f"{100 * stray.max():.1f} %",
            ]
        )
    return table(head, rows)


def _stray(graft: Graft) -> FloatArray:
    """Return how far the centre of mass is from the base's on the ground, in heights."""
    gap = center_of_mass(graft.motion) - center_of_mass(graft.base)
    gap[:, graft.library.up] = 0.0
    stray: FloatArray = np.linalg.norm(gap, axis=1) / mass_model(graft.base.skeleton).height
    return stray


def _charts(grafts: Sequence[Graft]) -> str:
    limit = float(np.degrees(grafts[0].library.config.max_angle))
    gaps = np.degrees([seam.gap for own in grafts for seam in own.seams])
    edges = np.linspace(0, max(limit * 4 / 3, float(gaps.max(initial=0.0)) + 1), 25)
    counts = np.histogram(gaps, edges)[0]
    figures = [
        _bars(
            counts,
            [f"{edge:.0f}°" for edge in edges],
            f"Gaps at {len(gaps)} seams; the limit is {limit:.0f}°",
            edges[:-1] >= limit - 1e-6,
        )
    ]
    for group, counts in grafts[0].alternatives.items():
        top = min(int(counts.max(initial=0)) + 1, 24)
        tally = np.bincount(np.minimum(counts, top), minlength=top + 1)
        names = [str(k) for k in range(top)] + [f"{top}+", ""]
        caption = f"Donors besides itself that each segment has for {group}"
        figures.append(_bars(tally, names, caption, np.arange(top + 1) == 0))
    return f'<div class="charts">{"".join(figures)}</div>'


def _bars(counts: IntArray, names: Sequence[str], caption: str, over: object) -> str:
    """Return a bar chart; bars of which `over` is true stand out."""
    marked = np.asarray(over, bool)
    wide, tall, left, foot = 420, 150, 34, 18
    step = (wide - left - 14) / len(counts)
    top = max(int(counts.max(initial=0)), 1)
    parts = []
    for index, count in enumerate(counts.tolist()):
        height = (tall - foot - 12) * count / top
        parts.append(
            f'<rect class="{"bar over" if marked[index] else "bar"}" '
            f'x="{left + index * step + 0.5:.1f}" y="{tall - foot - height:.1f}" '
            f'width="{step - 1:.1f}" height="{height:.1f}">'
            f"<title>{html.escape(names[index])}: {count}</title></rect>"
        )
        if index % max(1, len(counts) // 6) == 0:
            parts.append(
                f'<text x="{left + index * step + 1:.1f}" y="{tall - 4}">'
                f"{html.escape(names[index])}</text>"
            )
    parts.append(f'<text x="0" y="18">{top}</text>')
    line = tall - foot
    parts.append(f'<path class="axis" d="M{left} {line}H{wide}M{left} 12V{line}" fill="none"/>')
    words = html.escape(caption)
    return (
        f'<figure><svg class="chart" viewBox="0 0 {wide} {tall}" role="img" '
        f'aria-label="{words}">{"".join(parts)}</svg><figcaption>{words}</figcaption></figure>'
    )


def _funnel(graft: Graft) -> str:
    library = graft.library
    segments = library.segments
    labels = library.labels[library.groups.base]
    own = np.array(
        sorted({s.segment for s in graft.substitutions}),
        dtype=np.int64,
    )
    alike = np.empty(len(own))
    fitting = np.empty(len(own))
    for at, segment in enumerate(own.tolist()):
        mates = np.flatnonzero(labels == labels[segment])
        fits = length_fits(
            segments.lengths[[segment]], segments.lengths[mates], library.rate, library.config
        )
        alike[at] = len(mates) - 1
        fitting[at] = (fits & library.is_donor[mates] & (mates != segment)).sum()
    head = ["group", f"{library.groups.base} alike", "of fitting length", "within the gap limit"]
    head += ["segments with none"]
    rows = [
        [
            html.escape(group),
            f"{alike.mean():.1f}",
            f"{fitting.mean():.1f}",
            f"{counts.mean():.1f}",
            f"{int((counts == 0).sum())} of {len(counts)}",
        ]
        for group, counts in graft.alternatives.items()
    ]
    return table(head, rows)


def _with_file(library: Library, clip: int) -> str:
    name, file = library.entries[clip].name, library.file_name(clip)
    return name if file is None else f"{name} ({file})"


def _sources(grafts: Sequence[Graft]) -> str:
    library = grafts[0].library
    parts: Counter[str] = Counter()
    frames: Counter[str] = Counter()
    for own in grafts:
        for s in own.substitutions:
            if not s.is_own:
                parts[s.clip] += 1
                frames[s.clip] += s.donor_stop - s.donor_start
    rows = [
        [
            html.escape(_with_file(library, index)),
            number(entry.n_frames),
            f"{(entry.n_frames - 1) / library.rate:.1f} s",
            number(parts[entry.name]),
            number(frames[entry.name]),
        ]
        for index, entry in enumerate(library.entries)
    ]
    return table(["clip", "frames", "length", "parts lent", "frames lent"], rows)


def _parameters(library: Library) -> str:
    rows = [
        [html.escape(name), html.escape("unlimited" if value is None else _plain(value))]
        for name, value in library.config.as_dict().items()
    ]
    members: Mapping[str, IntArray] = library.groups.resolve(library.skeleton)
    names = library.skeleton.names
    rows += [
        [
            html.escape(f"group {group}{' (kept)' if group == library.groups.base else ''}"),
            html.escape(", ".join(names[joint] for joint in joints)),
        ]
        for group, joints in members.items()
    ]
    return table(["parameter", "value"], rows)


def _plain(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def number(value: int) -> str:
    return f"{value:,}".replace(",", "\N{THIN SPACE}")


def _link(name: str, path: Path | None) -> str:
    """Return a name, as a link if there is a file; a relative one is never taken for a scheme."""
    if path is None:
        return html.escape(name)
    target = path.as_uri() if path.is_absolute() else "./" + quote(os.fsencode(path.as_posix()))
    return f'<a href="{html.escape(target)}">{html.escape(path.name)}</a>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; the cells are HTML already, the head is not."""
    top = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in head)
    body_rows = "".join(
        "<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{top}</tr></thead>'
        f"<tbody>{body_rows}</tbody></table></div>"
    )
