"""The files that ``mograft graft`` and ``mograft demo`` write."""

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mograft._util.names import portable_stem
from mograft.cli.files import check_suffix
from mograft.cli.output import print_remark
from mograft.cli.syntax.arguments import Options, UsageError
from mograft.cli.syntax.options import GraftOptions
from mograft.io.formats import SUFFIXES, split_address
from mograft.provenance.writing import MOTION_SUFFIXES
from mograft.synthesis.graft_result import Graft
from mograft.viewing.page import open_file
from mograft.viewing.report import report_page

_INPUTS_OF_SUFFIX = {".glb": {".glb", ".gltf"}, ".npz": {".npz"}}
"""Suffixes of files of which an output with a suffix may be a copy."""


def check_graft_suffix(options: GraftOptions) -> None:
    """Raise a UsageError unless ``-o`` of ``mograft graft`` is a folder or a motion file.

    A .glb file requires an input that may be a glTF file, an .npz file an input that may be an
    AMASS file. ``--digits`` is a usage error with both, because it applies to .bvh files only.
    """
    paths = [Path(split_address(name)[0]) for name in options.files]
    is_any = options.from_ is not None or any(path.is_dir() for path in paths)
    given = {path.suffix.lower() for path in paths}
    suffixes = [own for own, inputs in _INPUTS_OF_SUFFIX.items() if is_any or given & inputs]
    check_suffix(options.output, ".bvh", *suffixes, is_folder=True)
    if options.output.suffix.lower() in _INPUTS_OF_SUFFIX and options.given("digits"):
        raise UsageError(f"--digits requires .bvh; got {options.output.name}")


def files_of_grafts(paths: Iterable[Path]) -> list[Path]:
    """Return the files that are written for grafts with the motions `paths`, each once.

    They are the motions and the .json files beside them.
    """
    files = [file for path in paths for file in (path, path.with_suffix(".json"))]
    return list(dict.fromkeys(files))


def output_paths(options: GraftOptions, first: str) -> tuple[list[Path], Path]:
    """Return the path of each motion and the path of the report page.

    All motions have the same path if ``-o`` is a file. `first` is the first file, or the name of
    the first clip of a library.
    """
    if options.output.suffix.lower() in MOTION_SUFFIXES:
        return [options.output] * options.count, options.output.with_suffix(".html")
    path, clip = split_address(options.base or first)
    if clip is None:
        is_motion = Path(path).suffix.lower() in SUFFIXES
        clip = Path(path).stem if is_motion else Path(path).name
    stem = portable_stem(clip) if options.scenario == "original" else "scenario"
    paths = [options.output / f"{stem}_graft{i}.bvh" for i in range(options.count)]
    return paths, options.output / "index.html"


def with_command(graft: Graft, options: Options, sources: Sequence[str]) -> Graft:
    """Return a copy of a graft whose `request` holds the command line and the files `sources`."""
    command = shlex.join(options.words)
    return replace(graft, request=replace(graft.request, command=command, sources=tuple(sources)))


def write_report(
    grafts: Sequence[Graft], paths: Sequence[Path], target: Path, columns: Sequence[Any] = ()
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
