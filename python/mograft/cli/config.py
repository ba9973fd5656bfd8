"""``mograft config``: the settings of the configuration file and the environment."""

import argparse
import json
import os
from pathlib import Path

from mograft.cli.arguments import Command
from mograft.cli.output import print_result
from mograft.cli.settings import Setting, find_config_file, find_settings

Row = tuple[str, str, Setting]
"""A command, the name of a setting, and its value."""


def run_show(options: argparse.Namespace) -> int:
    """Run ``config show``."""
    path = find_config_file(Path.cwd())
    rows = _collect(options)
    settings = [
        {"command": command, "name": name, "value": setting.plain, "origin": setting.origin}
        for command, name, setting in rows
    ]
    lines = [f"# {path}" if path is not None else "# no mograft.toml in this folder or above"]
    last = None
    for command, name, setting in rows:
        if command != last:
            lines.append(f"\n[{command}]")
        last = command
        line = f"# {name} =" if setting.plain is None else f"{name} = {_as_toml(setting.plain)}"
        lines.append(f"{line:32} # {setting.origin}" if options.origin else line)
    document = {"file": None if path is None else str(path), "settings": settings}
    print_result(options, "config", document, lines)
    return 0


def _collect(options: argparse.Namespace) -> list[Row]:
    """Return the settings of all commands, or of the one that the options name."""
    commands: dict[str, Command] = {command.name: command for command in options.commands}
    selected = list(commands.values())
    if options.only is not None:
        if options.only not in commands:
            options.usage_error(f"COMMAND must be one of {', '.join(commands)}; got {options.only}")
        selected = [commands[options.only]]
    rows: list[Row] = []
    for command in selected:
        found = find_settings(command, options.commands, environment=os.environ)
        for argument in command.settings():
            default = Setting(argument.default, "default", argument.default)
            rows.append((command.name, argument.name, found.get(argument.dest, default)))
    return rows


def _as_toml(value: object) -> str:
    """Return a value as TOML: its strings are those of JSON, and DEL is escaped as well."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
