"""The files that ``mograft graft`` and ``mograft demo`` write."""

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mograft import Graft, Library, report_page
from mograft._util.names import portable_stem
from mograft.cli.files import check_suffix, check_writable, library_folder
from mograft.cli.output import print_error, print_remark
from mograft.cli.syntax.arguments import Options, UsageError
from mograft.cli.syntax.options import GraftOptions
from mograft.evaluation.robot_checks import feasible_limits, robot_checks
from mograft.io.formats import SUFFIXES, split_address
from mograft.provenance.graft_record import read_record
from mograft.provenance.writing import MOTION_SUFFIXES, files_of_graft
from mograft.viewing.page import open_file

_MAX_EXCESS = 1e-6  # of a check; less is rounding


def with_target(options: GraftOptions) -> GraftOptions:
    """Return the options with ``output`` set, and with ``into`` if that file is to be updated.

    Raise a UsageError unless the output is a folder or a motion file to which the options apply.
    """
    into, name = options.into, "-o" if options.into is None else "--into"
    if (options.output is None) == (into is None):
        given = "both" if into else "none; -o out writes to a folder"
        raise UsageError(f"one of -o and --into is required, got {given}")
    target = options.output if into is None else into
    suffix = target.suffix.lower()
    if into is None:
        may_be_robot = options.model or options.from_ or library_folder(options.files)
        suffixes = [own for own in MOTION_SUFFIXES if may_be_robot or own != ".csv"]
        check_suffix(target, *suffixes, is_folder=True)
    elif suffix != ".glb":
        raise UsageError(f"--into must be a .glb file, got {target.name}")
    elif not into.is_file():
        raise FileNotFoundError(2, "No such file", str(into))
    if suffix in (".bvh", ".csv") and options.count != 1:
        raise UsageError(
            f"-o must be a folder, or a .glb or .npz file, if -n is above 1; got {target}"
        )
    if options.given("digits") and suffix in (".csv", ".glb", ".npz"):
        raise UsageError(f"--digits requires .bvh; got {target.name}")
    if options.as_ is not None and (suffix != ".glb" or options.count != 1):
        raise UsageError(f"--as requires a .glb file and a single motion; got {name} {target.name}")
    if options.from_ is not None and suffix == ".glb" and target.is_file():
        into = target
    return replace(options, output=target, into=into)


def files_of_grafts(paths: Iterable[Path]) -> list[Path]:
    """Return the files that are written for grafts with the motions `paths`, each once."""
    return list(dict.fromkeys(file for path in paths for file in files_of_graft(path)))


def renamed(graft: Graft, name: str | None) -> Graft:
    """Return a graft whose motion has another name; the graft itself if `name` is None."""
    return graft if name is None else replace(graft, motion=replace(graft.motion, name=name))


def new_paths(
    options: GraftOptions, first: str, suffix: str, page: str, inputs: Sequence[str]
) -> tuple[list[Path], Path]:
    """Return the paths of the files of new grafts; names begin with the base, or "scenario".

    `first` is the first file, or the name of the first clip of a library.
    """
    path, clip = split_address(options.base or first)
    if clip is None:
        is_motion = Path(path).suffix.lower() in SUFFIXES
        clip = Path(path).stem if is_motion else Path(path).name
    stem = "scenario" if options.scenario == "graph" else portable_stem(clip)
    names = [f"{stem}_graft{i}" for i in range(options.count)]
    return output_paths(options, names, suffix, page, inputs)


def output_paths(
    options: GraftOptions,
    names: Sequence[str],
    suffix: str,
    page: str | None = None,
    inputs: Sequence[str] = (),
) -> tuple[list[Path], Path]:
    """Return the path of each motion and the path of the report page.

    All motions have the same path if ``-o`` is a file; in a folder, they have `names` with
    `suffix`, and the page has the name `page` or that of the first motion. Raise an OSError if one
    of the files must not be written; the file of ``--into`` may be.
    """
    target = options.output
    if target.suffix.lower() in MOTION_SUFFIXES:
        paths, page = [target] * len(names), None
    else:
        paths = [target / f"{name}{suffix}" for name in names]
    report = paths[0].with_suffix(".html") if page is None else target / page
    written = [*files_of_grafts(paths), *[report] * options.report]
    others = [file for file in written if file != options.into]
    check_writable(others, force=options.force, inputs=inputs)
    return paths, report


def with_command(graft: Graft, options: Options, sources: Sequence[str]) -> Graft:
    """Return a copy of a graft whose `request` holds the command line and the files `sources`."""
    command = shlex.join(options.words)
    return replace(graft, request=replace(graft.request, command=command, sources=tuple(sources)))


def new_command(options: GraftOptions) -> str:
    """Return the command that made the graft of ``--from``, with the other words of this one."""
    source = options.from_ or ""
    words = [word for word in options.words if word not in ("--from", source, f"--from={source}")]
    try:
        record = read_record(source)
    except (OSError, ValueError):
        return shlex.join(["mograft", "graft", "FILE", *words[2:]])
    first = shlex.split(record.document["request"]["command"] or "")
    if first[1:2] != ["graft"]:  # in Python, or by another command
        first = ["mograft", "graft", *(record.sources or ["FILE"])]
    for flag in ("-o", "-n"):  # of the other output
        if flag in first:
            at = first.index(flag)
            del first[at : at + 2]
    return shlex.join([*first, *words[2:]])


def find_feasible(grafts: Sequence[Graft], library: Library) -> list[int]:
    """Return the indices of the grafts that are feasible; print why the others are not."""
    limits, kept = feasible_limits(library.clips), list[int]()
    for index, graft in enumerate(grafts):
        found = robot_checks(graft.motion, graft.base).items()
        worse = [(name, own) for name, own in found if own > limits[name] + _MAX_EXCESS]
        kept += [] if worse else [index]
        if worse:
            text = ", ".join(f"{name} {own:.3g} > {limits[name]:.3g}" for name, own in worse)
            print_remark(f"{graft.motion.name} is not written: {text} of the recordings")
    if not kept:
        print_error(f"none of {len(grafts)} motions is as feasible as the recordings")
    return kept


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
