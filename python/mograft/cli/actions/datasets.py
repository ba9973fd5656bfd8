"""``mograft augment``: data sets of grafts."""

from typing import Any

from mograft._util.workers import worker_processes
from mograft.cli import configuration
from mograft.cli.files import check_suffix
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.datasets import AugmentOptions
from mograft.datasets.augmentation import augment
from mograft.datasets.features import DEFAULT_FEATURES
from mograft.datasets.splits import Part
from mograft.datasets.writing import write
from mograft.errors import join_names


def run_augment(options: AugmentOptions) -> int:
    """Write a data set of windows of grafts."""
    check_suffix(options.output, is_folder=True)
    if options.resume and not options.output.is_dir():
        raise FileNotFoundError(2, "No such folder", str(options.output))
    if not options.resume and options.output.exists() and any(options.output.glob("*")):
        raise FileExistsError(f"{options.output} exists; use --resume to continue it")
    library = configuration.load_library(options)
    if options.jobs > 1 and library.folder is None:
        raise UsageError("--jobs requires a library in a folder, which mograft index makes")
    windows = augment(
        library,
        seconds=options.seconds,
        split=options.split,
        part=options.part,
        bases=options.bases or "*",
        features=options.features or DEFAULT_FEATURES,
        seed=options.seed or 0,
        variants=options.variants,
        min_new=options.min_new,
    )
    _describe_part(windows.part)
    with show_progress() as progress, worker_processes(options.jobs) as executor:
        document = write(
            windows,
            options.output,
            options.count,
            format=options.format,
            resume=options.resume,
            executor=executor,
            progress=progress,
        )
    report = document["report"]
    for line in _describe_report(report, options.count):
        print_remark(line)
    print_result(options, "augment/1", document, [options.output])
    return 0


def _describe_part(part: Part) -> None:
    if part.name != "all":
        print_remark(
            f"{part.name}: {int(part.clips.sum())} clips; {part.n_others} in other parts, "
            f"{part.n_unlisted} in none"
        )
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
        f"  {report['rejected_windows']} windows were refused: not new enough, or repeated",
    ]
    if report["windows"] < count:
        lines.append(
            f"warning: {report['windows']} of {count} windows exist; a higher --variety, --set "
            "max_stretch=0.3, a lower --min-new or more clips give more"
        )
    return lines
