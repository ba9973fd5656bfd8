"""Results on stdout; progress, remarks and errors on stderr; grafts and reports in files."""

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft import __version__
from mograft._util.atomic import write_text

if TYPE_CHECKING:
    from mograft.synthesis.graft_result import Graft

__all__ = [
    "describe_excluded_file",
    "print_json",
    "print_remark",
    "show_progress",
    "write_graft",
    "write_report",
]


def print_json(document: dict[str, Any]) -> None:
    """Print a document on stdout."""
    print(json.dumps(document, indent=1))


def print_remark(text: str) -> None:
    """Print a line on stderr."""
    print(text, file=sys.stderr)


@contextmanager
def show_progress() -> Iterator[Callable[[str, int, int], None] | None]:
    """Yield a progress callback if stderr is a terminal, else None."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(stage: str, done: int, total: int) -> None:
        print(f"\r\033[K{stage} {done}/{total}", end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print("\r\033[K", end="", file=sys.stderr, flush=True)


def describe_excluded_file(path: str, reason: str) -> str:
    """Return the line for a file that a library does not contain; most reasons name the file."""
    return f"excluded: {reason}" if reason.startswith(path) else f"excluded: {path}: {reason}"


def write_graft(graft: "Graft", path: Path) -> None:
    """Write the motion of a graft, and its provenance beside it."""
    from mograft.io.bvh import write_bvh

    document = {"mograft": __version__, **graft.as_dict()}
    # The provenance comes first: an interruption then leaves no motion without it.
    write_text(path.with_suffix(".json"), json.dumps(document, indent=1) + "\n")
    write_bvh(graft.motion, path)


def write_report(
    grafts: "Sequence[Graft]", paths: Sequence[Path], target: Path, *, show: bool
) -> None:
    """Write the report page of grafts, with links to their files; open it if `show`."""
    from mograft.viewing.page import open_file
    from mograft.viewing.report import report_page

    links = [Path(os.path.relpath(path, target.parent)) for path in paths]
    report_page(grafts, links).save(target, force=True)
    if show and not open_file(target):
        print_remark(f"no browser found: open {target} yourself")
