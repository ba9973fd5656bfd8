"""``mograft groups``: joint groups of a file, to edit and pass back."""

import argparse
from pathlib import Path
from typing import Any

from mograft.cli._common import PRESETS, check_free, write_text


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    groups = commands.add_parser("groups", help="joint groups of a file, to edit and pass back")
    groups.add_argument("file", metavar="FILE")
    groups.add_argument("--preset", choices=PRESETS, default="lower_upper")
    groups.add_argument("-o", "--output", type=Path, help="TOML file to write; default: stdout")
    groups.add_argument("--force", action="store_true", help="overwrite what is there")
    groups.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.bvh import read_bvh
    from mograft.groups import JointGroups

    text = JointGroups.preset(options.preset, read_bvh(options.file).skeleton).to_toml()
    if options.output is None:
        print(text, end="")
    else:
        check_free([options.output], force=options.force)
        write_text(options.output, text)
        print(options.output)
    return 0
