"""``mograft augment``, ``find`` and ``curate``: data sets, searches, choices of clips."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft import InsufficientDataError, Library, Motion, view
from mograft._util.atomic import write_bytes
from mograft._util.workers import worker_processes
from mograft.cli import configuration
from mograft.cli.files import check_suffix, check_writable, frame_range
from mograft.cli.graft_files import open_page
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.datasets import AugmentOptions, CurateOptions, FindOptions
from mograft.datasets.augmentation import Augmentation, augment
from mograft.datasets.curation import curate
from mograft.datasets.curation_files import curation_table, write_choice
from mograft.datasets.features import DEFAULT_FEATURES
from mograft.datasets.finding import Hit, find
from mograft.datasets.measuring import measure
from mograft.datasets.splits import Part
from mograft.datasets.writing import write
from mograft.errors import join_names
from mograft.io.formats import read_clip, split_address
from mograft.library.files.storage import is_library
from mograft.viewing.page import temporary_path


def run_augment(options: AugmentOptions) -> int:
    """Write a data set of windows of grafts."""
    check_suffix(options.output, is_folder=True)
    if options.part is not None and options.split is None:
        raise UsageError("--part requires --split")
    if options.resume and not options.output.is_dir():
        raise FileNotFoundError(2, "No such folder", str(options.output))
    if not options.resume and options.output.exists() and any(options.output.glob("*")):
        raise FileExistsError(
            f"{options.output} exists; use --resume to continue it, or another folder"
        )
    library = configuration.load_library(options)
    if options.jobs > 1 and library.folder is None:
        raise UsageError("--jobs requires a library in a folder, which mograft index makes")
    names = ("seconds", "stride", "split", "part", "min_new")
    given = {name: getattr(options, name) for name in names} | {"seed": options.seed or 0}
    given["part"] = options.part or "train"
    features = options.features or DEFAULT_FEATURES
    windows = augment(library, bases=options.bases or "*", features=features, **given)
    _describe_part(windows.part)
    with show_progress() as progress, worker_processes(options.jobs) as executor:
        more: dict[str, Any] = {"executor": executor, "progress": progress}
        more |= {"format": options.format, "resume": options.resume}
        document = write(windows, options.output, options.count, **more)
    for line in _describe_report(document["report"], options.count):
        print_remark(line)
    if options.measure:
        document["detectability"] = _measure(windows, options.output)
    print_result(options, "augment/1", document, [options.output])
    return 0


def _measure(windows: Augmentation, folder: Path) -> dict[str, Any] | None:
    """Print how well classifiers distinguish grafts of a data set, and return it for JSON."""
    try:
        found = measure(windows, folder)
    except InsufficientDataError as error:  # the data set is complete
        print_remark(f"warning: {error}")
        return None
    for name, own in (("seams", found.seams), ("captured motion alone", found.other_moments)):
        print_remark(f"  AUC of classifiers, {name}: {own.gross.text()}, {own.fine.text()}")
    return found.as_dict()


def _describe_part(part: Part) -> None:
    if part.name != "all":
        print_remark(f"{part.name}: {int(part.clips.sum())} clips; {part.n_others} in other parts")
    if part.shared:
        print_remark(
            f"warning: {len(part.shared)} clips of {part.name} are left out, because other parts "
            f"hold the same motion: {join_names(part.shared)}"
        )


def _describe_report(report: dict[str, Any], count: int) -> list[str]:
    lines = [
        f"{report['windows']} windows, {report['seconds']:.6g} s, on {report['bases']} bases",
        f"  {report['new_frames']:.0%} of the frames are new; {report['degrees_from_base']:.1f}° "
        f"from the bases; widest seam of a window {report['degrees_at_widest_seam']:.1f}° (median)",
        f"  {report['segments_used']} of {report['segments_usable']} segments used; "
        f"{report['segments_with_faults']} excluded because of faults",
        "  segments whose cluster has a used one: "
        + ", ".join(f"{group} {share:.0%}" for group, share in report["coverage"].items()),
        f"  {report['rejected_windows']} windows were refused: not new enough, or repeated",
    ]
    if report["windows"] < count:
        lines.append(
            f"warning: {report['windows']} of {count} windows exist; a higher --variety, --set "
            "max_stretch=0.3, a lower --min-new or more clips give more"
        )
    return lines


_MAX_SHOWN = 11
"""Spans on a page, beside the query."""


def run_find(options: FindOptions) -> int:
    """List the spans of a library that are nearest to a query."""
    if options.query is None and options.text is None:
        raise UsageError(
            f"{options.library} is read as LIB, the last word; before it give the clip or file to "
            "find, or --text WORDS"
        )
    for name in options.given("frames", "part"):
        if options.query is None:
            raise UsageError(f"--{name} requires a clip or file before LIB")
    if options.query is not None and is_library(options.query) > is_library(options.library):
        raise UsageError(f"LIB comes last: mograft find {options.library} {options.query}")
    if options.output is not None:
        check_suffix(options.output, ".html", ".htm")
        check_writable([options.output], force=options.force)
    library = Library.open(options.library)
    query, frames = None, None
    if options.query is not None:
        query = _read_query(library, options.query)
        frames = frame_range(query, options.frames)
    given = {name: getattr(options, name) for name in ("part", "text", "top")}
    with worker_processes(options.jobs) as executor:
        hits = find(library, query, frames=frames, executor=executor, **given)
    lines = [_describe_hit(hit, library.rate) for hit in hits] or ["no span was found"]
    if options.output is not None or options.open:
        path = options.output or temporary_path()
        spans = [] if query is None or frames is None else [(query, *frames)]
        for own in hits[:_MAX_SHOWN]:
            spans.append((library.clips[library.names.index(own.clip)], own.start, own.stop))
        items = [
            replace(motion[start : stop + 1], name=f"{motion.name} {start}-{stop}", path=None)
            for motion, start, stop in spans
        ]
        path.parent.mkdir(parents=True, exist_ok=True)
        view(*items, groups=library.groups, show=False).save(path, force=True)
        if options.open:
            open_page(path)
        lines = [*lines, str(path)]
    document = [{**asdict(hit), "angle": _number(hit.angle)} for hit in hits]
    print_result(options, "find/1", {"hits": document}, lines)
    return 0


def _read_query(library: Library, name: str) -> Motion:
    """Return the clip of a library, or the motion in a file, with a name."""
    if name not in library.names and Path(split_address(name)[0]).exists():
        return read_clip(name, skeleton=library.spec.rest)
    base, clip = library.resolve_base(name)
    return base.clips[clip]


def _describe_hit(hit: Hit, rate: float) -> str:
    span = f"{hit.clip} {hit.start}-{hit.stop} ({hit.start / rate:.2f}-{hit.stop / rate:.2f} s)"
    if np.isnan(hit.angle):
        return f"{hit.clip}: {hit.stop + 1} frames"
    return f"{span}: {np.degrees(hit.angle):.1f}°, distance {hit.distance:.2f}"


def run_curate(options: CurateOptions) -> int:
    """Choose clips of a library that are near all others."""
    if options.radius is not None and options.keep is not None:
        raise UsageError(
            "--keep cannot be combined with --radius: each decides how many clips are kept"
        )
    output, is_table = options.output, False
    if output is not None:
        check_suffix(output, ".csv", is_folder=True)
        is_table = output.suffix.lower() == ".csv" and not output.is_dir()
        if is_table:
            check_writable([output], force=options.force)
        elif output.is_file() or any(output.glob("*")):
            raise FileExistsError(f"{output} exists; choose another folder")
    if options.files is not None and (output is None or is_table):
        raise UsageError("--files requires -o with a folder")
    library = Library.open(options.library)
    given = {name: getattr(options, name) for name in ("radius", "keep", "part", "shards")}
    with worker_processes(options.jobs) as executor:
        found = curate(library, executor=executor, **given)
    if output is not None and is_table:
        write_bytes(output, curation_table(found))
    elif output is not None:
        write_choice(library, found, output, files=options.files or "none")
    print_remark(
        f"{len(found.kept)} of {len(found.choices)} clips kept, {found.kept_share:.1%} of the "
        f"frames; every other segment is within {found.radius:.3f} of a kept one"
    )
    for share in (0.5, 0.9):
        number, own = next((i, own) for i, own in enumerate(found.curve, 1) if own[1] >= share)
        print_remark(f"  {share:.0%} of the clusters in {number} clips, {own[0]} frames")
    clips = [{**asdict(own), "nearest": _number(own.nearest)} for own in found.choices]
    document = {"radius": found.radius, "kept_share": found.kept_share, "curve": found.curve}
    pairs = zip(library.entries, found.choices, strict=True)
    kept = [entry for entry, own in pairs if own.is_kept]
    lines = [entry.source_file.address if entry.source_file else entry.name for entry in kept]
    print_result(options, "curate/1", {**document, "clips": clips}, lines)
    return 0


def _number(value: float) -> float | None:
    """Return a number as JSON has it, which has no NaN."""
    return None if np.isnan(value) else value
