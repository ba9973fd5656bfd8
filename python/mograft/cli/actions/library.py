"""``mograft index`` and ``lib``: libraries in folders."""

from collections.abc import Mapping
from typing import Any

from mograft import Library
from mograft._util.workers import worker_processes
from mograft.cli import configuration
from mograft.cli.files import check_suffix, check_writable, refuse_library
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax import commands
from mograft.cli.syntax.arguments import UsageError
from mograft.library.clip_keys import TEXT_TAG, read_tags
from mograft.library.clip_table import ClipInfo
from mograft.library.duplicates import find_duplicates
from mograft.library.export import export_tables
from mograft.library.files import storage


def run_index(options: commands.IndexOptions) -> int:
    """Create a library, or add files to one."""
    check_suffix(options.output, is_folder=True)
    for name in options.files:
        refuse_library(name)
    if options.add:
        fixed = (*configuration.FIXED_OPTIONS, "variety", "set", "force")
        configuration.refuse_fixed_options(options, *fixed)
    elif not options.force and (options.output.is_file() or any(options.output.glob("*"))):
        raise FileExistsError(f"{options.output} exists; use --force to replace a library")
    if options.tag_columns is not None and options.tags is None:
        raise UsageError("--tag-columns requires --tags")
    tags = None if options.tags is None else read_tags(options.tags, options.tag_columns)
    known: Mapping[str, str] = {}
    with show_progress() as progress, worker_processes(options.jobs) as executor:
        keywords: dict[str, Any] = {"executor": executor, "progress": progress, "tags": tags}
        keywords |= {"frame_rates": dict(options.true_rate), "strict": options.strict}
        keywords["include_grafts"] = options.include_grafts
        if options.add:
            library = Library.open(options.output)
            known = library.refused
            library = library.add(options.files, **keywords)
        else:
            groups = configuration.selected_groups(options.groups)
            config = configuration.selected_config(options)
            keywords |= {"match": options.match or "names", "rate": options.rate}
            skeleton = configuration.selected_skeleton(options)
            keywords |= {"skeleton": skeleton, "force": options.force}
            library = Library.index(options.files, options.output, groups, config, **keywords)
    refused = {name: why for name, why in library.refused.items() if name not in known}
    for line in configuration.describe_excluded(refused, options):
        print_remark(line)
    if not options.json:
        print_remark(f"{library}")
    document = {**_describe_library(library), "left_out": refused}
    print_result(options, "index/1", document, [options.output])
    return 0


def run_info(options: commands.LibInfoOptions) -> int:
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
    lines += [
        f"  {name}: {group['clusters']} clusters of diameter {group['sigma']:.4g} at most"
        for name, group in document["groups"].items()
    ]
    words = [tag for tag in document["tags"] if not tag.startswith(TEXT_TAG)]
    if words:
        lines.append(f"  tags: {' '.join(words)}")
    if n_texts := len(document["tags"]) - len(words):
        lines.append(f"  {n_texts} descriptions")
    lines += [
        f"  {line}" for line in configuration.describe_excluded(document["left_out"], options)
    ]
    for clip in clips if options.clips else []:
        faults = f"; {'; '.join(clip['faults'])}" if clip["faults"] else ""
        tags = f" [{' '.join(clip['tags'])}]" if clip["tags"] else ""
        lines.append(f"  {clip['name']}{tags}: {clip['frames']} frames, {clip['file']}{faults}")
    if options.duplicates:
        spans = find_duplicates(library)
        document["duplicates"] = [vars(own) for own in spans]
        lines.append(f"  {len(spans) or 'no'} span{'s' * (len(spans) != 1)} that occur twice")
        lines += [f"    {own}" for own in spans]
    print_result(options, "lib/1", {**document, "files": clips}, lines)
    return 0


def _describe_library(library: Library) -> dict[str, Any]:
    """Return a summary of a library as a dict for JSON: its size, clusters and configuration."""
    groups = {}
    for group, labels in library.labels.items():
        joints = [library.skeleton.names[joint] for joint in library.joints(group)]
        sizes = {"clusters": int(labels.max(initial=-1)) + 1, "sigma": library.sigma[group]}
        groups[group] = {**sizes, "sigma_scale": library.config.sigma_scale, "joints": joints}
    n_frames = sum(entry.n_frames for entry in library.entries)
    return {
        "library": str(library.folder),
        **{"clips": len(library.entries), "frames": n_frames, "rate": library.rate},
        **{"segments": len(library.segments), "groups": groups, "base_group": library.groups.base},
        "tags": sorted({tag for entry in library.entries for tag in entry.tags}),
        **{"config": library.config.as_dict(), "left_out": dict(library.refused)},
    }


def _describe_clip(entry: ClipInfo) -> dict[str, Any]:
    file = entry.source_file
    source = {"name": entry.name, "file": file and file.path, "format": file and file.format}
    source |= {"clip": file and file.clip, "sha256": file and file.sha256}
    lists = {"tags": list(entry.tags), "faults": list(entry.faults)}
    return {**source, "frames": entry.n_frames, "own_rate": entry.source_rate, **lists}


def run_verify(options: commands.VerifyOptions) -> int:
    """Run ``lib verify``."""
    differences = storage.verify(options.library)
    for name in storage.list_leftovers(options.library):
        print_remark(f"{name} remains from an interrupted write; the next write removes it")
    document = {"library": str(options.library), "wrong": differences}
    print_result(options, "verify/1", document, differences or [f"{options.library}: unchanged"])
    return 3 if differences else 0


def run_export(options: commands.TablesOptions) -> int:
    """Run ``lib export``."""
    check_suffix(options.output, is_folder=True)
    library = Library.open(options.library)
    check_writable([options.output], force=options.force)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    paths = [str(path) for path in export_tables(library, options.output, options.format)]
    print_result(options, "tables/1", {"kind": options.format, "files": paths}, paths)
    return 0
