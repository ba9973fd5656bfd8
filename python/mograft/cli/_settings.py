"""Settings: the config file, below the environment, below what the command line says."""

import argparse
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["FILE", "Setting", "command_parsers", "nearest", "parse", "settings"]

FILE = "mograft.toml"
_PREFIX = "MOGRAFT_"

# How a command works may be settled once; on what it works, and whether it may overwrite, is
# said anew each time.
_NEVER = {"help", "output", "force", "json", "open", "add", "base", "clip", "group", "count"}
_NEVER |= {"title", "frames", "tags", "scenario", "duration", "repair", "origin"}


class Setting(NamedTuple):
    """The value of an option that the command line does not give, and who gave it."""

    value: Any
    origin: str
    said: Any
    """The value as it was said, where the option makes more of it."""

    @property
    def plain(self) -> str | int | float | bool | None:
        """The value as a file may say it."""
        own: str | int | float | bool | None = self.said
        if isinstance(self.value, str | int | float):
            own = self.value
        return own


def parse(
    parser: argparse.ArgumentParser, arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse a command line; what it leaves open comes from the environment, then the file.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        The parser of all commands.
    arguments : sequence of str, optional
        The words after the program's name. Default: those of the process.

    Returns
    -------
    argparse.Namespace
        The options. ``origins`` tells of those that were set elsewhere where that was.
    """
    options = parser.parse_args(arguments)
    options.origins = {}
    command: argparse.ArgumentParser | None = command_parsers(parser).get(options.command)
    if command is None or options.command == "config":
        return options
    try:
        found = settings(options.command, command)
    except (OSError, ValueError) as error:
        command.error(str(error))
    # A default that is an object of its own tells afterwards whether it is still in its place.
    command.set_defaults(**found)
    options = parser.parse_args(arguments)
    options.origins = {}
    for name, setting in found.items():
        if getattr(options, name) is setting:
            setattr(options, name, setting.value)
            options.origins[name] = setting.origin
    return options


def command_parsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the commands, by name."""
    return {
        name: command
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
        for name, command in action.choices.items()
    }


def settings(
    command: str,
    parser: argparse.ArgumentParser,
    folder: Path | None = None,
    environment: Mapping[str, str] = os.environ,
) -> dict[str, Setting]:
    """Return what the config file and the environment settle for a command.

    Parameters
    ----------
    command : str
        The command's name.
    parser : argparse.ArgumentParser
        Its parser.
    folder : Path, optional
        Where to look for the file, there and above. Default: the working folder.
    environment : mapping, optional
        The environment.

    Returns
    -------
    dict of str to Setting
        By the options' names in the namespace.

    Raises
    ------
    ValueError
        If the file is no TOML, or a setting is unknown or has a wrong value; names its place.
    """
    path = nearest(Path.cwd() if folder is None else folder)
    table = {} if path is None else _table(path, command, parser)
    found = {}
    for action in settable(parser):
        if action.dest in table and path is not None:
            value = _of_file(action, table[action.dest], path)
            found[action.dest] = Setting(value, str(path), table[action.dest])
        for name in (action.dest, f"{command}_{action.dest}"):
            variable = _PREFIX + name.upper()
            if variable in environment:
                value = _read(action, environment[variable], variable)
                found[action.dest] = Setting(value, variable, environment[variable])
    return found


def nearest(folder: Path) -> Path | None:
    """Return the config file in a folder or the nearest one above it."""
    here = folder.resolve()
    return next((p / FILE for p in (here, *here.parents) if (p / FILE).is_file()), None)


def settable(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Go through the options of a command that a setting may stand for."""
    exclusive = {a for group in parser._mutually_exclusive_groups for a in group._group_actions}
    for action in parser._actions:
        single = isinstance(action, argparse._StoreAction) and action.nargs is None
        switch = isinstance(action, argparse._StoreTrueAction)
        settled = action.required or action in exclusive or action.dest in _NEVER
        if action.option_strings and (single or switch) and not settled:
            yield action


def _table(path: Path, command: str, parser: argparse.ArgumentParser) -> dict[str, Any]:
    """Return what a file says to a command, its own table over what all share."""
    import tomllib

    from mograft.cli import command_names

    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from None
    shared = {name: value for name, value in document.items() if not isinstance(value, dict)}
    tables = {name: value for name, value in document.items() if isinstance(value, dict)}
    everywhere = command_names()
    for name in tables:
        if name not in everywhere:
            raise ValueError(f"{path}: [{name}] must be one of {', '.join(everywhere)}")
    for name in shared:
        if not any(_dest(name) in known for known in everywhere.values()):
            raise ValueError(f"{path}: {name} is no setting: see mograft config show")
    known = {action.dest for action in settable(parser)}
    for name in tables.get(command, {}):
        if _dest(name) not in known:
            raise ValueError(f"{path}: {name} is no setting of mograft {command}")
    both = {_dest(name): value for name, value in shared.items() if _dest(name) in known}
    return both | {_dest(name): value for name, value in tables.get(command, {}).items()}


def _dest(name: str) -> str:
    return name.replace("-", "_")


def _of_file(action: argparse.Action, value: Any, path: Path) -> Any:  # noqa: ANN401 - of TOML
    place = f"{path}: {_name(action)}"
    if isinstance(value, bool) or isinstance(action, argparse._StoreTrueAction):
        if not (isinstance(value, bool) and isinstance(action, argparse._StoreTrueAction)):
            wanted = "true or false" if action.nargs == 0 else "a value"
            raise ValueError(f"{place} must be {wanted}, got {json.dumps(value, default=str)}")
        return value
    if not isinstance(value, str | int | float):
        raise ValueError(f"{place} must be a text or a number, got {value!r}")
    text = str(value)
    if text.endswith(".toml"):  # Groups: their file lies where this one says, not where we are.
        text = str(path.parent / text)
    return _read(action, text, place)


def _read(action: argparse.Action, text: str, place: str) -> Any:  # noqa: ANN401 - as argparse
    if isinstance(action, argparse._StoreTrueAction):
        words = {"1": True, "true": True, "0": False, "false": False, "": False}
        if text.lower() not in words:
            raise ValueError(f"{place} must be 1 or 0, got {text!r}")
        return words[text.lower()]
    convert: Any = action.type or str
    try:
        value = convert(text)
    except (argparse.ArgumentTypeError, ValueError, TypeError) as error:
        told = str(error) if isinstance(error, argparse.ArgumentTypeError) else f"got {text!r}"
        raise ValueError(f"{place}: {told}") from None
    if action.choices is not None and value not in action.choices:
        allowed = ", ".join(map(str, action.choices))
        raise ValueError(f"{place} must be one of {allowed}, got {text!r}")
    return value


def _name(action: argparse.Action) -> str:
    return action.option_strings[-1].lstrip("-")
