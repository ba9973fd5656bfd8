"""``mograft lib``: the contents, the integrity and the tables of a library."""

import argparse
from pathlib import Path
from typing import Any

from mograft.cli.exclusions import describe_excluded
from mograft.cli.files import check_suffix, check_writable
from mograft.cli.output import print_remark, print_result
from mograft.config import Config
from mograft.library.clip_table import ClipInfo
from mograft.library.discover import SourceFile
from mograft.library.export import export_tables
from mograft.library.files import storage
from mograft.library.library import Library


def run_info(options: argparse.Namespace) -> int:
    """Run ``lib info``."""
    library = Library.open(options.library)
    document = describe_library(library)
    clips = [_describe_clip(entry) for entry in library.entries]
    lines = [
        f"{options.library}",
        f"  {document['clips']} clips, {document['frames']} frames at {document['rate']:.6g} fps",
        f"  {document['segments']} segments{_describe_segmentation(library.config)}",
    ]
    for name, group in document["groups"].items():
        lines.append(
            f"  {name}: {group['clusters']} clusters of diameter {group['sigma']:.4g} at most"
        )
    if document["tags"]:
        lines.append(f"  tags: {' '.join(document['tags'])}")
    lines += [f"  {line}" for line in describe_excluded(document["left_out"])]
    for clip in clips if options.clips else []:
        faults = f"; {'; '.join(clip['faults'])}" if clip["faults"] else ""
        tags = f" [{' '.join(clip['tags'])}]" if clip["tags"] else ""
        lines.append(f"  {clip['name']}{tags}: {clip['frames']} frames, {clip['file']}{faults}")
    print_result(options, "lib", {**document, "files": clips}, lines)
    return 0


def _describe_segmentation(config: Config) -> str:
    """Return how the clips of a library were segmented, or "" for the default method."""
    if not isinstance(config.segmentation, str):
        return " by given cut frames"
    if config.segmentation == Config.segmentation:
        return ""
    values = [f"{name} {value}" for name, value in config.segmentation_parameters.items()]
    return f" by {', '.join([config.segmentation, *values])}"


def describe_library(library: Library) -> dict[str, Any]:
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


def run_verify(options: argparse.Namespace) -> int:
    """Run ``lib verify``."""
    differences = storage.verify(options.library)
    if options.sources and not differences:
        differences = _verify_sources(options.library)
    for name in storage.list_leftovers(options.library):
        print_remark(f"{name} remains from an interrupted write; the next write removes it")
    document = {"library": str(options.library), "wrong": differences}
    print_result(options, "verify", document, differences or [f"{options.library}: unchanged"])
    return 3 if differences else 0


def _verify_sources(folder: Path) -> list[str]:
    """Return one message for each source file that is missing or has changed.

    Source files are the files from which the library in `folder` was built.
    """
    differences: dict[str, None] = {}  # one for all clips of a file
    for entry in Library.open(folder).entries:
        source = entry.source_file
        if source is None:
            continue
        try:
            if SourceFile.from_path(source.path).sha256 != source.sha256:
                differences[f"{source.path} has changed since the library read it"] = None
        except OSError as error:
            differences[f"{source.path}: {error.strerror}"] = None
    return list(differences)


def run_export(options: argparse.Namespace) -> int:
    """Run ``lib export``."""
    if options.kind == "npz":
        check_suffix(options, ".npz")
    else:
        check_suffix(options, is_folder=True)
    library = Library.open(options.library)
    check_writable([options.output], force=options.force)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    paths = [str(path) for path in export_tables(library, options.output, options.kind)]
    print_result(options, "tables", {"kind": options.kind, "files": paths}, paths)
    return 0
