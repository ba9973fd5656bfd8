"""The options of a command line, from its words, the environment and the configuration file.

The command line takes precedence over the environment, the environment over the file. The argparse
parsers are built from the declarations of the commands.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from mograft import __version__
from mograft._util.documents import read_document
from mograft.cli.syntax.arguments import SECTIONS, Argument, Command, Options
from mograft.cli.syntax.commands import COMMANDS
from mograft.errors import suggest_name

CONFIG_FILE = "mograft.toml"
_GENERAL = ("quiet", "verbose", "json")
"""Options that ``--help`` shows if it would leave out nothing else."""

_COUNT_WORDS = ("num", "outputs", "copies", "variants", "amount")

Parsers = dict[tuple[str, ...], argparse.ArgumentParser]


@dataclass(frozen=True)
class Setting:
    """Value of an option that the configuration file or the environment sets, or its default."""

    value: Any  # Converted as argparse converts it.
    origin: str  # The file or the environment variable that set it, or ``"default"``.
    text: Any  # The value before the conversion.

    @property
    def plain(self) -> Any:  # noqa: ANN401 - of TOML
        """The value as TOML and JSON represent it."""
        return self.value if isinstance(self.value, str | int | float) else self.text or None


class _Parser(argparse.ArgumentParser):
    """A parser that prints each error as two lines: the usage, then the error."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and an error, and end the program with exit code 2."""
        usage = " ".join(self.format_usage().split())
        help_words = self.prog if self.prog in usage else "mograft"
        print(f"{usage} (see {help_words} --help)\nerror: {message}", file=sys.stderr)
        raise SystemExit(2)


def build_parsers(*, is_short: bool = False, is_completion: bool = False) -> Parsers:
    """Return the argparse parsers of the program, of its commands and of their subcommands.

    The keys are the words of a command, such as ``("lib", "verify")``, and ``()`` for the program.
    With `is_short` they print the help without the options and details of ``--help-all``, with
    `is_completion` they have the attributes that shtab reads.
    """
    root = _Parser(
        prog="mograft",
        usage="mograft COMMAND [options]",
        description="Create natural motions from captured ones by exchanging body parts.",
    )
    root.add_argument("--version", action="version", version=f"mograft {__version__}")
    root.add_argument("--help-all", action="help", help=argparse.SUPPRESS)
    parsers: Parsers = {(): root}

    def add(path: tuple[str, ...], members: Sequence[Command]) -> None:
        kind = "action" if path else "command"
        subparsers = parsers[path].add_subparsers(
            title=f"{kind}s", prog=parsers[path].prog, required=True, metavar=kind.upper()
        )
        for command in members:
            words = (*path, command.name)
            name = f"mograft {' '.join(words)}"
            parsers[words] = parser = subparsers.add_parser(
                command.name,
                prog=name,
                usage=f"{name} {_summarize(command)}",
                help=command.help,
                description=None if command.actions else command.options.__doc__,
                add_help=bool(command.actions),
                formatter_class=lambda prog: argparse.HelpFormatter(prog, max_help_position=28),
            )
            if command.actions:
                parser.add_argument("--help-all", action="help", help=argparse.SUPPRESS)
                add(words, command.actions)
            else:
                parser.set_defaults(command=command)
                _add_arguments(parser, command, is_short=is_short, is_completion=is_completion)

    add((), COMMANDS)
    return parsers


def _add_arguments(
    parser: argparse.ArgumentParser, command: Command, *, is_short: bool, is_completion: bool
) -> None:
    arguments = command.arguments()
    has_more = any((a.is_expert or a.details) and a.dest not in _GENERAL for a in arguments)
    for section in SECTIONS:
        members = [argument for argument in arguments if argument.section == section]
        if members:
            group = parser.add_argument_group(section)
        for argument in members:
            keywords = _keywords(argument, is_short=is_short and has_more)
            action = group.add_argument(*argument.flags, **keywords)
            if is_completion and argument.value is not None:
                _add_completion(action, argument)
    # The last group is that of --quiet, which every command has.
    group.add_argument("-h", "--help", action="help", help="show this text")
    text = "show all options, with details" if has_more else argparse.SUPPRESS
    group.add_argument("--help-all", action="help", help=text)


def _keywords(argument: Argument, *, is_short: bool) -> dict[str, Any]:
    """Return the keyword arguments of ``add_argument``; what is not given has the value None."""
    text = argument.help
    if argument.details and not is_short:
        text = f"{text}; {argument.details}"
    is_hidden = is_short and argument.is_expert
    keywords: dict[str, Any] = {"help": argparse.SUPPRESS if is_hidden else text.replace("%", "%%")}
    if argument.value is None:
        return {**keywords, "action": "store_true", "dest": argument.dest, "default": None}
    keywords = {**keywords, "type": argument.value.read, "metavar": argument.value.placeholder}
    if argument.is_positional:
        return {**keywords, "nargs": argument.count}
    if argument.implied is not None:
        keywords |= {"nargs": "?", "const": argument.value.convert(argument.implied)}
    action = "append" if argument.is_repeated else "store"
    required = argument.is_required and argument.alternative is None
    return {**keywords, "action": action, "required": required, "dest": argument.dest}


def _add_completion(action: Any, argument: Argument) -> None:  # noqa: ANN401 - shtab adds attributes
    import shtab

    from mograft.config_text import field_choices

    assert argument.value is not None
    if argument.value.is_path:
        action.complete = shtab.FILE
    action.choices = field_choices() if argument.dest == "set" else argument.value.choices or None


def _summarize(command: Command) -> str:
    """Return the positional arguments and the required options of a command, as one line."""
    if command.actions:
        return "ACTION [options]"
    shown = (a.usage for a in command.arguments() if a.is_positional or a.is_required)
    return " ".join([*shown, "[options]"])


def _check_names(parsers: Parsers, words: Sequence[str]) -> tuple[str, ...]:
    """Return the words of the command, ``()`` if `words` do not name a whole one.

    End with a usage error if a command or a long option in `words` does not exist. The message
    suggests the most similar name.
    """
    path: tuple[str, ...] = ()
    while names := [known[-1] for known in parsers if known and known[:-1] == path]:
        word = words[len(path)] if len(path) < len(words) else "-"
        if word.startswith("-"):
            return ()
        if word not in names:
            kind, hint = "ACTION" if path else "COMMAND", suggest_name(word, names)
            parsers[path].error(f"{kind} must be one of {', '.join(names)}; got {word!r}{hint}")
        path = (*path, word)
    command: Command = parsers[path].get_default("command")
    flags = [own.flags[-1] for own in command.arguments() if not own.is_positional]
    flags += ["--help", "--help-all"]
    for word in takewhile(lambda word: word != "--", words[len(path) :]):
        name = word.partition("=")[0]
        if name.startswith("--") and not any(flag.startswith(name) for flag in flags):
            hint = suggest_name(name, flags, prefix="--", cutoff=0.7)
            if any(word in name for word in _COUNT_WORDS) and "--count" in flags:
                hint = "; did you mean '-n', the number of motions?"
            for own in (parser for key, parser in parsers.items() if key[:1] != path[:1]):
                other: Command | None = own.get_default("command")
                if other and any(name in each.flags for each in other.arguments()):
                    hint = f"; {(own.usage or '').removesuffix(' [options]')} has it"
                    break
            hint = hint or f"; mograft {' '.join(path)} --help-all lists all options"
            parsers[path].error(f"{' '.join(path)} has no option {name}{hint}")
    return path


def parse(
    arguments: Sequence[str] | None = None,
) -> tuple[Command, Options, argparse.ArgumentParser]:
    """Parse the words `arguments` of a command line (default: ``sys.argv[1:]``).

    Return the command, its options, and the parser that reports its usage errors. Options that are
    not given take their values from environment variables, otherwise from the configuration file,
    otherwise from their defaults.
    """
    words = sys.argv[1:] if arguments is None else arguments
    is_short = not any(word.startswith("--help-") for word in words)
    parsers = build_parsers(is_short=is_short)
    path = _check_names(parsers, words)
    parser = parsers[path]
    # A parser with commands takes no files; without one, it prints its help or an error.
    parse_words = parser.parse_known_intermixed_args if path else parser.parse_known_args
    known, unknown = parse_words(words[len(path) :])
    found = vars(known)
    command: Command = found["command"]
    if unknown:
        hint = f"; {parser.prog} --help-all lists all options"
        if unknown[0] == "-n" and hasattr(known, "keep"):
            hint = "; did you mean '--keep', how much is kept?"
        parser.error(f"unexpected words {' '.join(unknown)}{hint}")
    try:
        settings = find_settings(command)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    values: dict[str, Any] = {"words": ("mograft", *words)}
    if "set" in settings:
        values["configured"] = settings.pop("set").value
    used = {name: own for name, own in settings.items() if found[name] is None}
    values["origins"] = {name: own.origin for name, own in used.items()}
    found |= {name: own.value for name, own in used.items()}
    for argument in command.arguments():
        value = found[argument.dest]
        if value is None:
            value = argument.default
            if isinstance(value, str) and argument.value is not None:
                value = argument.value.convert(value)
        values[argument.dest] = tuple(value) if argument.is_repeated else value
    return command, command.options(**values), parser


def find_settings(command: Command) -> dict[str, Setting]:
    """Return the settings of a command, by the `Argument.dest` of the options that they set.

    Environment variables override the configuration file. The file is searched for in the working
    folder and the folders above it; it may have a table for each command. Raise a ValueError that
    names the file or the variable if the file is not TOML, or if a setting is unknown or invalid.
    """
    settings: dict[str, Setting] = {}
    arguments = command.settings()
    path = find_config_file(Path.cwd()) if arguments else None
    table = {} if path is None else _read_file(path, command)
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


def _read_file(path: Path, command: Command) -> dict[str, Any]:
    """Return the settings that a configuration file contains for a command, not yet converted.

    Keys before all tables apply to every command; the table of the command overrides them.
    """
    document = read_document(path, "TOML")
    known = {each.name: {argument.dest for argument in each.settings()} for each in COMMANDS}
    # A setting may have the name of a command, such as `groups`.
    tables = {k: v for k, v in document.items() if k != "set" and isinstance(v, dict)}
    for name in tables.keys() - known.keys():
        raise ValueError(
            f"{path}: the name of a table must be one of {', '.join(known)}; got [{name}]"
            f"{suggest_name(name, known)}"
        )
    merged: dict[str, Any] = {}
    shared = {k: v for k, v in document.items() if k not in tables}
    own = tables.get(command.name, {})
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
    if argument.is_repeated:
        if not isinstance(value, dict):
            raise ValueError(f"{place} must be a table such as [set], got {value!r}")
        texts = {name: str(text) for name, text in value.items()}
        for name, text in texts.items():
            if text.lower().endswith(".json"):
                texts[name] = str(path.parent / text)
        return _read(argument, [f"{name}={text}" for name, text in texts.items()], place)
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
    if argument.is_repeated:
        return _read(argument, text.split(), place)
    return _read(argument, [text], place)[0]


def _read(argument: Argument, texts: Sequence[str], place: str) -> tuple[Any, ...]:
    assert argument.value is not None
    try:
        return tuple(map(argument.value.read, texts))
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"{place}: {error}") from None
