"""Values of options from the configuration file and the environment.

The command line takes precedence over the environment, the environment over the file.
"""

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mograft.cli.syntax.arguments import Argument, Command
from mograft.errors import suggest_name

CONFIG_FILE = "mograft.toml"


@dataclass(frozen=True)
class Setting:
    """Value of an option that the configuration file or the environment sets, or its default."""

    value: Any  # Converted as argparse converts it.
    origin: str  # The file or the environment variable that set it, or ``"default"``.
    text: Any  # The value before the conversion.

    @property
    def plain(self) -> Any:  # noqa: ANN401 - of TOML
        """The value as TOML and JSON represent it."""
        if isinstance(self.value, Path):
            return str(self.value)
        return self.value if isinstance(self.value, str | int | float) else self.text or None


def find_settings(command: Command, commands: Sequence[Command]) -> dict[str, Setting]:
    """Return the settings of a command, by the `Argument.dest` of the options that they set.

    Environment variables override the configuration file. The file is searched for in the working
    folder and the folders above it; it may have a table for each of `commands`. Raise a ValueError
    that names the file or the variable if the file is not TOML, or if a setting is unknown or
    invalid.
    """
    settings: dict[str, Setting] = {}
    arguments = command.settings()
    path = find_config_file(Path.cwd()) if arguments else None
    table = {} if path is None else _read_file(path, command, commands)
    for argument in arguments:
        if path is not None and argument.dest in table:
            text = table[argument.dest]
            settings[argument.dest] = Setting(_convert_toml(argument, text, path), str(path), text)
        for name in (argument.dest, f"{command.name}_{argument.dest}"):
            variable = f"MOGRAFT_{name.upper()}"
            if variable in os.environ:
                value = _convert_text(argument, os.environ[variable], variable)
                settings[argument.dest] = Setting(value, variable, os.environ[variable])
    return settings


def find_config_file(folder: Path) -> Path | None:
    """Return the path of ``mograft.toml`` in a folder or in the nearest folder above that has one.

    Return None if there is no such file.
    """
    start = folder.resolve()
    candidates = (parent / CONFIG_FILE for parent in (start, *start.parents))
    return next((path for path in candidates if path.is_file()), None)


def _read_file(path: Path, command: Command, commands: Sequence[Command]) -> dict[str, Any]:
    """Return the settings that a configuration file contains for a command, not yet converted.

    Keys before all tables apply to every command; the table of the command overrides them.
    `commands` are all commands, whose names are the allowed names of tables.
    """
    import tomllib

    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from None
    known = {each.name: {argument.dest for argument in each.settings()} for each in commands}
    shared = {k: v for k, v in document.items() if k == "set" or not isinstance(v, dict)}
    for name in document.keys() - shared.keys() - known.keys():
        raise ValueError(
            f"{path}: the name of a table must be one of {', '.join(known)}; got [{name}]"
            f"{suggest_name(name, known)}"
        )
    merged: dict[str, Any] = {}
    own = document.get(command.name, {})
    for table, allowed in ((shared, set().union(*known.values())), (own, known[command.name])):
        for key, value in table.items():
            name = key.replace("-", "_")
            if name not in allowed:
                hint = suggest_name(name, allowed) or "; mograft config show lists all"
                raise ValueError(f"{path}: unknown setting {key!r}{hint}")
            is_table = isinstance(value, dict) and isinstance(merged.get(name), dict)
            merged[name] = merged[name] | value if is_table else value
    return merged


def _convert_toml(argument: Argument, value: Any, path: Path) -> Any:  # noqa: ANN401 - of TOML
    place = f"{path}: {argument.name}"
    if argument.is_repeated:  # --set
        if not isinstance(value, dict):
            raise ValueError(f"{place} must be a table such as [set], got {value!r}")
        texts = ((name, str(text)) for name, text in value.items())
        return tuple(
            (name, str(path.parent / text) if text.lower().endswith(".json") else text)
            for name, text in texts
        )
    is_bool = isinstance(value, bool)
    if is_bool != (argument.value is None) or not isinstance(value, str | int | float):
        expected = "true or false" if argument.value is None else "a string or a number"
        raise ValueError(f"{place} must be {expected}, got {json.dumps(value, default=str)}")
    text = str(value)
    if argument.value and argument.value.is_path and Path(text).suffix:
        text = str(path.parent / text)  # relative to the configuration file
    return _convert_text(argument, text, place)


def _convert_text(argument: Argument, text: str, place: str) -> Any:  # noqa: ANN401 - as argparse
    if argument.value is None:
        words = {"1": True, "true": True, "0": False, "false": False, "": False}
        if text.lower() not in words:
            raise ValueError(f"{place} must be 1, true, 0 or false, got {text!r}")
        return words[text.lower()]
    convert = argument.value.convert
    try:
        return tuple(map(convert, text.split())) if argument.is_repeated else convert(text)
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"{place}: {error}") from None
