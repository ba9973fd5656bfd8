"""``mograft config``: what is settled by the config file and the environment."""

import argparse
import json
import os
from pathlib import Path
from typing import Any

from mograft.cli._common import print_json
from mograft.cli._settings import Setting, command_parsers, nearest, settable, settings


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    config = commands.add_parser(
        "config", help="what the config file and the environment settle for the commands"
    )
    actions = config.add_subparsers(title="actions", required=True, metavar="ACTION")
    show = actions.add_parser(
        "show",
        help="all settings, as the file mograft.toml may hold them",
        description="Print the settings of the commands, as a mograft.toml that says the same. "
        "Settings come from mograft.toml in the working folder or the nearest one above it, "
        "where [graft] speaks to one command and what stands before all tables to every one; "
        "over it stand MOGRAFT_SEED and the like, then MOGRAFT_GRAFT_SEED; over these the "
        "command line.",
    )
    show.add_argument("only", nargs="?", metavar="COMMAND", help="those of one command")
    show.add_argument("--origin", action="store_true", help="tell where each value comes from")
    show.add_argument("--json", action="store_true", help="as one JSON document, with the origins")
    show.set_defaults(run=run, usage=show.error)


def run(options: argparse.Namespace) -> int:
    """Run ``config show``."""
    from mograft.cli import _parser

    everything = command_parsers(_parser())
    if options.only is not None:
        if options.only not in everything:
            options.usage(f"COMMAND must be one of {', '.join(everything)}; got {options.only}")
        everything = {options.only: everything[options.only]}
    path = nearest(Path.cwd())
    rows = []
    for command, parser in everything.items():
        found = settings(command, parser, environment=os.environ)
        for action in settable(parser):
            setting = found.get(action.dest, Setting(action.default, "default", action.default))
            name = action.option_strings[-1].lstrip("-")
            rows.append((command, name, setting))
    if options.json:
        document = [
            {"command": command, "name": name, "value": setting.plain, "origin": setting.origin}
            for command, name, setting in rows
        ]
        file = None if path is None else str(path)
        print_json({"schema": "mograft.config/1", "file": file, "settings": document})
        return 0
    lines = [f"# {path}" if path is not None else "# no mograft.toml here or above"]
    above = None
    for command, name, setting in rows:
        if command != above:
            lines += ["", f"[{command}]"]
        above = command
        none = setting.plain is None
        line = f"# {name} =" if none else f"{name} = {json.dumps(setting.plain)}"
        lines.append(f"{line:32} # {setting.origin}" if options.origin else line)
    print("\n".join(lines))
    return 0
