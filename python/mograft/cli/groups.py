"""``mograft groups``: joint groups of a file, to edit and pass back."""

import argparse
from pathlib import Path
from typing import Any

from mograft.cli._common import PRESETS, check_free, print_json, write_text


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    groups = commands.add_parser("groups", help="joint groups of a file, to edit and pass back")
    groups.add_argument("file", metavar="FILE")
    groups.add_argument("--preset", choices=PRESETS, default="lower_upper")
    groups.add_argument("-o", "--output", type=Path, help="TOML file to write; default: stdout")
    groups.add_argument("--force", action="store_true", help="overwrite what is there")
    groups.add_argument("--json", action="store_true", help="as one JSON document")
    groups.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.body.groups import JointGroups
    from mograft.io.bvh import read_bvh

    skeleton = read_bvh(options.file).skeleton
    groups = JointGroups.preset(options.preset, skeleton)
    target: Path | None = options.output
    if target is not None:
        check_free([target], force=options.force)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, groups.to_toml())
    if options.json:
        members = groups.resolve(skeleton).items()
        document = {
            "schema": "mograft.groups/1",
            "file": None if target is None else str(target),
            "base": groups.base,
            "groups": {name: [skeleton.names[j] for j in joints] for name, joints in members},
        }
        print_json(document)
    elif target is None:
        print(groups.to_toml(), end="")
    else:
        print(target)
    return 0
