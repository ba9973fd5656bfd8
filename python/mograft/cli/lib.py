"""``mograft lib``: what a library holds, whether it is whole, and its tables for others."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli._common import check_free, left_out, print_json, say

if TYPE_CHECKING:
    from mograft.library.library import Library


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    lib = commands.add_parser("lib", help="look into a library, verify it, export its tables")
    actions = lib.add_subparsers(title="actions", required=True, metavar="ACTION")
    info = actions.add_parser("info", help="what it holds and by what it was made")
    info.add_argument("library", type=Path, metavar="LIB")
    info.add_argument("--clips", action="store_true", help="list the clips, too")
    info.add_argument("--json", action="store_true", help="as one JSON document")
    info.set_defaults(run=run_info)
    verify = actions.add_parser("verify", help="compare every byte with what was written")
    verify.add_argument("library", type=Path, metavar="LIB")
    verify.add_argument(
        "--sources", action="store_true", help="compare the files it was made of, too"
    )
    verify.add_argument("--json", action="store_true", help="as one JSON document")
    verify.set_defaults(run=run_verify)
    export = actions.add_parser("export", help="its tables, for DuckDB, Spark or pandas")
    export.add_argument("library", type=Path, metavar="LIB")
    kind = export.add_mutually_exclusive_group(required=True)
    for name in ("parquet", "csv", "npz"):
        kind.add_argument(f"--{name}", dest="kind", action="store_const", const=name)
    export.add_argument("-o", "--output", type=Path, required=True, help="folder; npz: a file")
    export.add_argument("--force", action="store_true", help="overwrite what is there")
    export.add_argument("--json", action="store_true", help="tell as JSON what was written")
    export.set_defaults(run=run_export)


def run_info(options: argparse.Namespace) -> int:
    """Run ``lib info``."""
    from mograft.library.library import Library

    library = Library.open(options.library)
    document = described(library)
    if options.clips or options.json:
        document["files"] = [_clip(library, index) for index in range(len(library.entries))]
    if options.json:
        print_json({"schema": "mograft.lib/1", **document})
        return 0
    print(f"{options.library}")
    print(f"  {document['clips']} clips, {document['frames']} frames at {document['rate']:.6g} fps")
    print(f"  {document['segments']} segments")
    for group, own in document["groups"].items():
        print(f"  {group}: {own['clusters']} clusters of diameter {own['sigma']:.4g} at most")
    if document["tags"]:
        print(f"  tags: {' '.join(document['tags'])}")
    for path, why in document["left_out"].items():
        print(f"  {left_out(path, why)}")
    for clip in document.get("files", []):
        faults = f"; {'; '.join(clip['faults'])}" if clip["faults"] else ""
        tags = f" [{' '.join(clip['tags'])}]" if clip["tags"] else ""
        print(f"  {clip['name']}{tags}: {clip['frames']} frames, {clip['file']}{faults}")
    return 0


def described(library: "Library") -> dict[str, Any]:
    """Return what a library holds, as JSON can hold it."""
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


def _clip(library: "Library", index: int) -> dict[str, Any]:
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
    from mograft.library import storage as store
    from mograft.library.ingest import describe_source_file
    from mograft.library.library import Library

    wrong = store.verify(options.library)
    if options.sources and not wrong:
        for entry in Library.open(options.library).entries:
            origin = entry.source_file
            if origin is None:
                continue
            try:
                if describe_source_file(origin.path).sha256 != origin.sha256:
                    wrong.append(f"{origin.path} has changed since it was read")
            except OSError as error:
                wrong.append(f"{origin.path}: {error.strerror}")
    for name in store.list_leftovers(options.library):
        say(f"{name} is left of an interrupted write; the next one removes it")
    if options.json:
        library = str(options.library)
        print_json({"schema": "mograft.verify/1", "library": library, "wrong": wrong})
    else:
        print("\n".join(wrong) if wrong else f"{options.library}: as it was written")
    return 3 if wrong else 0


def run_export(options: argparse.Namespace) -> int:
    """Run ``lib export``."""
    from mograft.library.export import export_tables
    from mograft.library.library import Library

    library = Library.open(options.library)
    check_free([options.output], force=options.force)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    paths = [str(path) for path in export_tables(library, options.output, options.kind)]
    if options.json:
        print_json({"schema": "mograft.tables/1", "kind": options.kind, "files": paths})
    else:
        print("\n".join(paths))
    return 0
