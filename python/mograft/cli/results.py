"""The files of grafts, and pages in the browser."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mograft import __version__
from mograft._util.atomic import write_text
from mograft.cli.output import print_remark
from mograft.io.bvh.writer import write_bvh
from mograft.synthesis.graft_result import Graft
from mograft.viewing.page import open_file
from mograft.viewing.report import report_page

GRAFT_ENDINGS = (".bvh", ".json")
"""Endings of the files of a graft: the motion and its provenance."""


def write_graft(graft: Graft, path: Path, more: Mapping[str, Any] | None = None) -> None:
    """Write the motion of a graft to `path`, and its provenance to a .json file beside it.

    `more` holds additional entries of the .json file.
    """
    document = {"mograft": __version__, **graft.as_dict(), **(more or {})}
    # The provenance comes first: an interruption then leaves no motion without it.
    write_text(path.with_suffix(".json"), json.dumps(document, indent=1) + "\n")
    write_bvh(graft.motion, path)


def write_report(
    grafts: Sequence[Graft],
    paths: Sequence[Path],
    target: Path,
    columns: Sequence[Mapping[str, str]] = (),
) -> None:
    """Write the report page of grafts to `target`, with links to the files `paths` of the grafts.

    `columns` is passed to `report_page`.
    """
    links = [Path(os.path.relpath(path, target.parent)) for path in paths]
    report_page(grafts, links, columns=columns).save(target, force=True)


def open_page(path: Path) -> None:
    """Open a page in the browser, or print that no browser was found."""
    if not open_file(path):
        print_remark(f"no browser found: open {path} yourself")
