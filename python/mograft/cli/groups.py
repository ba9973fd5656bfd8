"""``mograft groups``: the joint groups of a file as TOML, to edit and to pass to ``--groups``."""

import argparse
from pathlib import Path

from mograft._util.atomic import write_text
from mograft.cli.arguments import Command, option, positional
from mograft.cli.files import check_writable
from mograft.cli.options import FORCE, JSON, PRESETS
from mograft.cli.output import print_json


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.body.groups import JointGroups
    from mograft.io.bvh import read_bvh

    skeleton = read_bvh(options.file).skeleton
    groups = JointGroups.preset(options.preset, skeleton)
    target: Path | None = options.output
    if target is not None:
        check_writable([target], force=options.force)
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


COMMAND = Command(
    name="groups",
    help="print the joint groups of a file as TOML, to edit and to pass to --groups",
    run=run,
    arguments=(
        positional("file", is_path=True, metavar="FILE", help="BVH file"),
        option(
            "--preset",
            choices=PRESETS,
            default="lower_upper",
            help="preset of joint groups (default: lower_upper)",
        ),
        option(
            "-o",
            "--output",
            is_setting=False,
            is_path=True,
            type=Path,
            help="TOML file to write (default: stdout)",
        ),
        FORCE,
        JSON,
    ),
)
