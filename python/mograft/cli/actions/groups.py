"""``mograft groups``: the joint groups of a file as TOML, to edit and to pass to ``--groups``."""

import argparse
from pathlib import Path

from mograft._util.atomic import write_text
from mograft._util.automatic_groups import automatic_number, is_automatic
from mograft.body.groups import JointGroups
from mograft.cli.configuration import selected_skeleton
from mograft.cli.files import check_suffix, check_writable, expand_folders
from mograft.cli.output import print_result
from mograft.io.addresses import read_clip
from mograft.library.group_choice import discover_groups


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    target: Path | None = options.output
    if target is not None:
        check_suffix(options, ".toml")
    files = expand_folders([options.file])
    rest = selected_skeleton(options)
    skeleton = read_clip(files[0], skeleton=rest).skeleton
    if is_automatic(options.preset):
        number = automatic_number(options.preset)
        groups = discover_groups(files, number, skeleton=rest).groups
    else:
        groups = JointGroups.preset(options.preset, skeleton)
    if target is not None:
        check_writable([target], force=options.force)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, groups.to_toml())
    members = groups.resolve(skeleton).items()
    document = {
        "file": None if target is None else str(target),
        "base": groups.base,
        "groups": {name: [skeleton.names[j] for j in joints] for name, joints in members},
    }
    print_result(options, "groups", document, [target or groups.to_toml().removesuffix("\n")])
    return 0
