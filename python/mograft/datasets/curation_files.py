"""The table, the page and the files of a choice of clips."""

import html
import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path

import numpy as np

from mograft._util.atomic import atomic_folder, write_bytes
from mograft._util.validate import check_choice, check_type
from mograft.datasets.curation import Choice, Curation
from mograft.io.csv import to_csv
from mograft.library.library import Library
from mograft.viewing.page import Page, assemble_page, viewer_html
from mograft.viewing.report import REPORT_STYLE, curve_svg, wide_table
from mograft.viewing.scene import Scene

_N_EXAMPLES = 5  # of kept and of dropped clips, in the viewer
_EXAMPLE_SECONDS = 10.0
_MAX_ROWS = 500  # of a table on the page


def curation_table(found: Curation) -> bytes:
    """Return a CSV table with each clip and the reason for its choice."""
    rows = (
        (own.clip, int(own.is_kept), own.frames, f"{own.nearest:.6g}", own.reason)
        for own in found.choices
    )
    return to_csv([("clip", "kept", "frames", "nearest", "reason"), *rows])


def curation_page(library: Library, found: Curation) -> Page:
    """Return a page with the curve of a choice, examples in the viewer, and the reasons.

    Parameters
    ----------
    library : Library
        The library.
    found : Curation
        The result of `curate` for this library.

    Returns
    -------
    Page
        The page. The viewer shows five kept clips, and the five dropped ones that are farthest.
    """
    kept = [own for own in found.choices if own.is_kept]
    dropped = [own for own in found.choices if not own.is_kept]
    dropped.sort(key=lambda own: -np.nan_to_num(own.nearest, nan=-1.0))
    lead = (
        f"{len(kept)} of {len(found.choices)} clips are kept, {found.kept_share:.1%} of the frames."
        f" Every segment without faults of the others is within {found.radius:.3f} cluster diameter"
        " thresholds of a segment of a kept clip."
    )
    shown = [("kept", own) for own in kept[:_N_EXAMPLES]]
    shown += [("dropped", own) for own in dropped[:_N_EXAMPLES] if not np.isnan(own.nearest)]
    length = round(_EXAMPLE_SECONDS * library.rate)
    rows = {name: index for index, name in enumerate(library.names)}
    motions = [
        replace(library.clips[rows[own.clip]][:length], name=f"{word}: {own.clip}", path=None)
        for word, own in shown
    ]
    total = sum(own.frames for own in found.choices)
    shares = [(0.0, 0.0), *((frames / total, own) for frames, own in found.curve)]
    body = f"""<main>
<h1>Choice of clips</h1>
<p class="lead">{lead}</p>
{curve_svg("Coverage of the clusters by kept clips", np.array(shares), "of the frames")}
<p class="note">Share of the clusters that have a segment of a kept clip, over the share of the
frames in kept clips, in the order in which they were chosen.</p>
<h2>Examples</h2>
{viewer_html(Scene.of(motions, library.groups), n_shown=2 * _N_EXAMPLES)}
<h2>Kept clips</h2>
{_rows(kept)}
<h2>Dropped clips, farthest first</h2>
{_rows(dropped)}
</main>"""
    return assemble_page("Choice of clips", body, "report", REPORT_STYLE)


def write_choice(
    library: Library, found: Curation, folder: str | PathLike[str], *, files: str = "none"
) -> Path:
    """Write the table, the page and, on request, the files of a choice of clips.

    Parameters
    ----------
    library : Library
        The library.
    found : Curation
        The result of `curate` for this library.
    folder : path
        The folder to create; it gets ``clips.csv`` and ``index.html``.
    files : {"none", "link", "copy"}
        Whether the folder also gets ``clips``, with links to the files of the kept clips, or copies
        of them, in the folders that they have.

    Returns
    -------
    Path
        The folder. It is complete, or it is not written.

    Raises
    ------
    FileExistsError
        If the folder has files.
    ValueError
        If `files` is invalid, or a kept clip is from no file.
    OSError
        If a file is missing or cannot be written.
    """
    check_type("found", found, Curation)
    check_choice("files", files, ("none", "link", "copy"))
    target = Path(fspath(folder))
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(f"{target} exists: choose another folder")
    sources = {} if files == "none" else _sources(library, found)
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic_folder(target) as draft:
        for name, source in sources.items():
            place = draft / "clips" / name
            place.parent.mkdir(parents=True, exist_ok=True)
            if files == "copy":
                shutil.copy2(source, place)
            else:
                source.stat()  # raises an OSError if the file is missing
                place.symlink_to(source)
        write_bytes(draft / "clips.csv", curation_table(found))
        curation_page(library, found).save(draft / "index.html")
    return target


def _sources(library: Library, found: Curation) -> dict[Path, Path]:
    """Return the files of the kept clips by their path from the folder that all are in."""
    pairs = zip(library.entries, found.choices, strict=True)
    kept = [entry for entry, own in pairs if own.is_kept]
    paths = [entry.source_file.path for entry in kept if entry.source_file is not None]
    if len(paths) < len(kept):
        n = len(kept) - len(paths)
        raise ValueError(f"`files` needs clips of files, {n} kept clips are from none")
    common = Path(os.path.commonpath([Path(path).parent for path in paths]))
    return {Path(path).relative_to(common): Path(path) for path in dict.fromkeys(paths)}


def _rows(choices: Sequence[Choice]) -> str:
    cells = [
        [html.escape(own.clip), str(own.frames), f"{own.nearest:.3f}", html.escape(own.reason)]
        for own in choices[:_MAX_ROWS]
    ]
    more = f"<p>{len(choices) - _MAX_ROWS:,} more rows</p>" if len(choices) > _MAX_ROWS else ""
    return wide_table(("clip", "frames", "nearest", "reason"), cells) + more
