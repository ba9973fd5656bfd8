"""``mograft index`` and ``mograft lib``: libraries of many files, in folders."""

from collections.abc import Mapping, Sequence
from typing import Any

from mograft._util.workers import worker_processes
from mograft.cli import configuration
from mograft.cli.files import check_suffix, check_writable
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.commands import IndexOptions, LibInfoOptions, TablesOptions, VerifyOptions
from mograft.errors import join_names
from mograft.io.formats import split_address
from mograft.library.clip_table import ClipInfo
from mograft.library.discover import find_clips, matching_values, read_tags
from mograft.library.export import export_tables
from mograft.library.files import storage
from mograft.library.library import Library


def run_index(options: IndexOptions) -> int:
    """Create a library, or add files to one."""
    check_suffix(options.output, is_folder=True)
    if options.add:
        fixed = (*configuration.FIXED_OPTIONS, "variety", "rate", "set", "force")
        configuration.refuse_fixed_options(options, *fixed)
    elif not options.force and (options.output.is_file() or any(options.output.glob("*"))):
        raise FileExistsError(f"{options.output} exists; use --force to replace a library")
    rates = dict(options.true_rate)
    tags = None if options.tags is None else read_tags(options.tags)
    _warn_of_unused(options.files, rates, tags or {})
    library, refused = _index(options, rates, tags)
    for line in _describe_excluded(refused):
        print_remark(line)
    if not options.json:
        print_remark(f"{library}")
    document = {**_describe_library(library), "left_out": refused}
    print_result(options, "index/1", document, [options.output])
    return 0


def _warn_of_unused(
    files: Sequence[str], rates: Mapping[str, float], tags: Mapping[str, object]
) -> None:
    """Print a warning that lists the names of ``--true-rate`` and ``--tags`` that match no clip."""
    if not rates and not tags:
        return
    table = {key: key for key in (*rates, *tags)}
    used = {key for source in find_clips(files) for key in matching_values(table, source)}
    unused = [key for key in table if key not in used]
    if unused:
        print_remark(
            f"warning: no clip matches these names of --true-rate or --tags: {join_names(unused)}; "
            "they have no effect"
        )


def _index(
    options: IndexOptions, rates: Mapping[str, float], tags: Mapping[str, Sequence[str]] | None
) -> tuple[Library, dict[str, str]]:
    """Create a library, or add files to one; return the library and the newly excluded files.

    The excluded files are a dict from path to reason.
    """
    with show_progress() as progress, worker_processes(options.jobs) as executor:
        keywords: dict[str, Any] = {
            "frame_rates": rates,
            "tags": tags,
            "strict": options.strict,
            "executor": executor,
            "progress": progress,
            "include_grafts": options.include_grafts,
        }
        if options.add:
            library = Library.open(options.output)
            before = set(library.refused)
            library = library.add(options.files, **keywords)
            return library, {k: why for k, why in library.refused.items() if k not in before}
        groups = configuration.selected_groups(options.groups)
        config = configuration.selected_config(options)
        keywords |= {"match": options.match or "names", "rate": options.rate}
        skeleton = configuration.selected_skeleton(options.skeleton)
        keywords |= {"skeleton": skeleton, "force": options.force}
        library = Library.index(options.files, options.output, groups, config, **keywords)
    return library, dict(library.refused)


def _describe_excluded(excluded: Mapping[str, str]) -> list[str]:
    """Return the lines that report excluded clips, from the reasons by the address of the clip."""
    lines = []
    for address, reason in excluded.items():
        place = "" if reason.startswith(split_address(address)[0]) else f"{address}: "
        lines.append(f"excluded: {place}{reason}")
    return lines


def run_info(options: LibInfoOptions) -> int:
    """Run ``lib info``."""
    library = Library.open(options.library)
    document = _describe_library(library)
    clips = [_describe_clip(entry) for entry in library.entries]
    given = "" if library.config.segmentation == "energy" else " by given cut frames"
    lines = [
        f"{options.library}",
        f"  {document['clips']} clips, {document['frames']} frames at {document['rate']:.6g} fps",
        f"  {document['segments']} segments{given}",
    ]
    for name, group in document["groups"].items():
        lines.append(
            f"  {name}: {group['clusters']} clusters of diameter {group['sigma']:.4g} at most"
        )
    if document["tags"]:
        lines.append(f"  tags: {' '.join(document['tags'])}")
    lines += [f"  {line}" for line in _describe_excluded(document["left_out"])]
    for clip in clips if options.clips else []:
        faults = f"; {'; '.join(clip['faults'])}" if clip["faults"] else ""
        tags = f" [{' '.join(clip['tags'])}]" if clip["tags"] else ""
        lines.append(f"  {clip['name']}{tags}: {clip['frames']} frames, {clip['file']}{faults}")
    print_result(options, "lib/1", {**document, "files": clips}, lines)
    return 0


def _describe_library(library: Library) -> dict[str, Any]:
    """Return a summary of a library as a dict for JSON: its size, clusters and configuration."""
    return {
        "library": str(library.folder),
        "clips": len(library.entries),
        "frames": sum(entry.n_frames for entry in library.entries),
        "rate": library.rate,
        "segments": len(library.segments),
        "groups": {
            group: {
                "clusters": int(labels.max(initial=-1)) + 1,
                "sigma": library.sigma[group],
                "sigma_scale": library.config.sigma_scale,
                "joints": [library.skeleton.names[joint] for joint in library.joints(group)],
            }
            for group, labels in library.labels.items()
        },
        "base_group": library.groups.base,
        "tags": sorted({tag for entry in library.entries for tag in entry.tags}),
        "config": library.config.as_dict(),
        "left_out": dict(library.refused),
    }


def _describe_clip(entry: ClipInfo) -> dict[str, Any]:
    source = entry.source_file
    return {
        "name": entry.name,
        "file": None if source is None else source.path,
        "format": None if source is None else source.format,
        "clip": None if source is None else source.clip,
        "sha256": None if source is None else source.sha256,
        "frames": entry.n_frames,
        "own_rate": entry.source_rate,
        "tags": list(entry.tags),
        "faults": list(entry.faults),
    }


def run_verify(options: VerifyOptions) -> int:
    """Run ``lib verify``."""
    differences = storage.verify(options.library)
    for name in storage.list_leftovers(options.library):
        print_remark(f"{name} remains from an interrupted write; the next write removes it")
    document = {"library": str(options.library), "wrong": differences}
    print_result(options, "verify/1", document, differences or [f"{options.library}: unchanged"])
    return 3 if differences else 0


def run_export(options: TablesOptions) -> int:
    """Run ``lib export``."""
    if options.format == "npz":
        check_suffix(options.output, ".npz")
    else:
        check_suffix(options.output, is_folder=True)
    library = Library.open(options.library)
    check_writable([options.output], force=options.force)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    paths = [str(path) for path in export_tables(library, options.output, options.format)]
    print_result(options, "tables/1", {"kind": options.format, "files": paths}, paths)
    return 0
