"""The report page of grafts, and pages in the browser."""

import argparse
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from mograft.cli.output import print_remark
from mograft.synthesis.graft_result import Graft
from mograft.viewing.page import open_file
from mograft.viewing.report import report_page


def with_command(graft: Graft, options: argparse.Namespace, sources: Sequence[str]) -> Graft:
    """Return a copy of a graft whose `request` holds the command line and the files `sources`."""
    command = shlex.join(options.words)
    return replace(graft, request=replace(graft.request, command=command, sources=tuple(sources)))


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
