"""``mograft config``: the settings of the configuration file and the environment."""

import argparse
import json
from pathlib import Path
from typing import Any

from mograft.cli.output import print_result
from mograft.cli.settings import Setting, find_config_file, find_settings
from mograft.errors import suggest_name


def run_show(options: argparse.Namespace) -> int:
    """Run ``config show``."""
    path = find_config_file(Path.cwd())
    rows = _collect(options)
    lines = [f"# {path}" if path is not None else "# no mograft.toml in this folder or above"]
    last = None
    for row in rows:
        if row["command"] != last:
            lines.append(f"\n[{row['command']}]")
        last = row["command"]
        value, name = row["value"], row["name"]
        line = f"# {name} =" if value is None else f"{name} = {_as_toml(value)}"
        lines.append(f"{line:32} # {row['origin']}" if options.origin else line)
    document = {"file": None if path is None else str(path), "settings": rows}
    print_result(options, "config", document, lines)
    return 0


def _collect(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Return one dict per setting, with the keys command, name, value and origin.

    The origin is the file or environment variable that sets the value, or ``"default"``.
    `options.only` limits the settings to those of one command.
    """
    names = [command.name for command in options.commands]
    if options.only is not None and options.only not in names:
        hint = suggest_name(options.only, names)
        options.usage_error(f"COMMAND must be one of {', '.join(names)}; got {options.only}{hint}")
    rows = []
    for command in options.commands:
        if options.only not in (None, command.name):
            continue
        found = find_settings(command, options.commands)
        for argument in command.settings():
            default = Setting(argument.default, "default", argument.default)
            setting = found.get(argument.dest, default)
            row = {"command": command.name, "name": argument.name}
            rows.append({**row, "value": setting.plain, "origin": setting.origin})
    return rows


def _as_toml(value: object) -> str:
    """Return a string, number or boolean in the syntax of TOML.

    This is the syntax of JSON, except that TOML also requires an escape for the character DEL.
    """
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
