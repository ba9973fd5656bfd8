"""``mograft lib``: the contents, the integrity and the tables of a library."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli.arguments import Argument, Command, ExclusiveArguments, option, positional, switch
from mograft.cli.files import check_writable
from mograft.cli.options import FORCE, JSON
from mograft.cli.output import describe_excluded_file, print_json, print_remark

if TYPE_CHECKING:
    from mograft.library.library import Library


def run_info(options: argparse.Namespace) -> int:
    """Run ``lib info``."""
    from mograft.library.library import Library

    library = Library.open(options.library)
    document = describe_library(library)
    if options.clips or options.json:
        document["files"] = [_describe_clip(library, i) for i in range(len(library.entries))]
    if options.json:
        print_json({"schema": "mograft.lib/1", **document})
        return 0
    print(f"{options.library}")
    print(f"  {document['clips']} clips, {document['frames']} frames at {document['rate']:.6g} fps")
    print(f"  {document['segments']} segments")
    for name, group in document["groups"].items():
        print(f"  {name}: {group['clusters']} clusters of diameter {group['sigma']:.4g} at most")
    if document["tags"]:
        print(f"  tags: {' '.join(document['tags'])}")
    for path, reason in document["left_out"].items():
        print(f"  {describe_excluded_file(path, reason)}")
    for clip in document.get("files", []):
        faults = f"; {'; '.join(clip['faults'])}" if clip["faults"] else ""
        tags = f" [{' '.join(clip['tags'])}]" if clip["tags"] else ""
        print(f"  {clip['name']}{tags}: {clip['frames']} frames, {clip['file']}{faults}")
    return 0


def describe_library(library: "Library") -> dict[str, Any]:
    """Return the contents of a library as JSON can represent them."""
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
                "joints": [library.skeleton.names[joint] for joint in library.joints(group)],
            }
            for group, labels in library.labels.items()
        },
        "base_group": library.groups.base,
        "tags": sorted({tag for entry in library.entries for tag in entry.tags}),
        "config": library.config.as_dict(),
        "left_out": dict(library.refused),
    }


def _describe_clip(library: "Library", index: int) -> dict[str, Any]:
    entry = library.entries[index]
    return {
        "name": entry.name,
        "file": None if entry.source_file is None else entry.source_file.path,
        "sha256": None if entry.source_file is None else entry.source_file.sha256,
        "frames": entry.n_frames,
        "own_rate": entry.source_rate,
        "tags": list(entry.tags),
        "faults": list(entry.faults),
    }


def run_verify(options: argparse.Namespace) -> int:
    """Run ``lib verify``."""
    from mograft.library import storage

    differences = storage.verify(options.library)
    if options.sources and not differences:
        differences = _verify_sources(options.library)
    for name in storage.list_leftovers(options.library):
        print_remark(f"{name} remains from an interrupted write; the next write removes it")
    if options.json:
        library = str(options.library)
        print_json({"schema": "mograft.verify/1", "library": library, "wrong": differences})
    else:
        print("\n".join(differences) if differences else f"{options.library}: unchanged")
    return 3 if differences else 0


def _verify_sources(folder: Path) -> list[str]:
    """Return which source files of a library are missing or differ from the ones it read."""
    from mograft.library.ingest import SourceFile
    from mograft.library.library import Library

    differences = []
    for entry in Library.open(folder).entries:
        source = entry.source_file
        if source is None:
            continue
        try:
            if SourceFile.from_path(source.path).sha256 != source.sha256:
                differences.append(f"{source.path} has changed since the library read it")
        except OSError as error:
            differences.append(f"{source.path}: {error.strerror}")
    return differences


def run_export(options: argparse.Namespace) -> int:
    """Run ``lib export``."""
    from mograft.library.export import export_tables
    from mograft.library.library import Library

    library = Library.open(options.library)
    check_writable([options.output], force=options.force)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    paths = [str(path) for path in export_tables(library, options.output, options.kind)]
    if options.json:
        print_json({"schema": "mograft.tables/1", "kind": options.kind, "files": paths})
    else:
        print("\n".join(paths))
    return 0


def _table_format(name: str, help: str) -> Argument:  # noqa: A002 - as add_argument
    keywords = {"dest": "kind", "action": "store_const", "const": name, "help": help}
    return Argument(flags=(f"--{name}",), keywords=keywords)


_LIBRARY = positional("library", is_path=True, type=Path, metavar="LIB", help="folder of a library")

COMMAND = Command(
    name="lib",
    help="describe, verify or export a library",
    actions=(
        Command(
            name="info",
            help="print the contents and the configuration",
            run=run_info,
            arguments=(_LIBRARY, switch("--clips", help="also list the clips"), JSON),
        ),
        Command(
            name="verify",
            help="compare each file of the library with its checksum",
            run=run_verify,
            arguments=(
                _LIBRARY,
                switch("--sources", help="also compare the source files with their checksums"),
                JSON,
            ),
        ),
        Command(
            name="export",
            help="write the tables for DuckDB, Spark or pandas",
            run=run_export,
            arguments=(
                _LIBRARY,
                ExclusiveArguments(
                    (
                        _table_format("parquet", "Parquet files, with the extra parquet"),
                        _table_format("csv", "CSV files"),
                        _table_format("npz", "one NumPy archive"),
                    )
                ),
                option(
                    "-o",
                    "--output",
                    is_setting=False,
                    is_path=True,
                    type=Path,
                    required=True,
                    help="folder for the tables; with --npz a file",
                ),
                FORCE,
                JSON,
            ),
        ),
    ),
)
