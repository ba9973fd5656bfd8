"""The argparse parsers, built from the declarations of the commands."""

import argparse
import sys
from collections.abc import Collection, Sequence
from typing import Any, NoReturn

from mograft import __version__
from mograft.cli.settings import find_settings
from mograft.cli.syntax.arguments import Argument, ArgumentGroup, Command
from mograft.errors import suggest_name

GENERAL_OPTIONS = (
    Argument(
        flags=("-q", "--quiet"),
        keywords={"action": "store_true", "help": "print only results and errors"},
    ),
    Argument(
        flags=("-v", "--verbose"),
        keywords={"action": "store_true", "help": "also print details that require no action"},
    ),
)
"""Options of every command."""


class _Parser(argparse.ArgumentParser):
    """A parser that prints each error as two lines: the usage, then the error."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and an error, and end the program with exit code 2."""
        usage = " ".join(self.format_usage().split())
        help_words = self.prog if self.prog in usage else "mograft"
        print(f"{usage} (see {help_words} --help)\nerror: {message}", file=sys.stderr)
        raise SystemExit(2)


def build_parsers(
    commands: Sequence[Command], path_completion: object = None
) -> dict[tuple[str, ...], argparse.ArgumentParser]:
    """Return the argparse parsers of the program, of its commands and of their subcommands.

    The keys are the words of a command, such as ``("lib", "verify")``, and ``()`` for the program.
    `path_completion` is assigned to the attribute ``complete`` of all arguments that are paths;
    shtab reads this attribute.
    """
    root = _Parser(
        prog="mograft",
        usage="mograft COMMAND [options]",
        description="Create natural motions from captured ones by exchanging body parts.",
    )
    root.add_argument("--version", action="version", version=f"mograft {__version__}")
    parsers: dict[tuple[str, ...], argparse.ArgumentParser] = {(): root}
    subparsers = root.add_subparsers(
        title="commands", prog="mograft", required=True, metavar="COMMAND"
    )
    for command in commands:
        parser = _add_parser(subparsers, command, f"mograft {command.name}", path_completion)
        parser.set_defaults(command=command, function="run")
        parsers[command.name,] = parser
        if command.actions:
            prog = parser.prog
            actions = parser.add_subparsers(
                title="actions", prog=prog, required=True, metavar="ACTION"
            )
        for action in command.actions:
            parser = _add_parser(actions, action, f"{prog} {action.name}", path_completion)
            parser.set_defaults(command=command, function=f"run_{action.name}")
            parsers[command.name, action.name] = parser
    return parsers


def _add_parser(
    subparsers: Any,  # noqa: ANN401 - argparse does not publish its type
    command: Command,
    name: str,
    path_completion: object,
) -> argparse.ArgumentParser:
    """Add the parser of a command; `name` is, for example, ``mograft config show``."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        command.name,
        usage=f"{name} {_summarize(command)}",
        help=command.help,
        description=command.description,
    )
    for item in (*command.arguments, *(() if command.actions else GENERAL_OPTIONS)):
        container: Any = parser
        if isinstance(item, ArgumentGroup) and item.title:
            container = parser.add_argument_group(item.title, item.description)
        elif isinstance(item, ArgumentGroup):
            container = parser.add_mutually_exclusive_group(required=True)
        members = (item,) if isinstance(item, Argument) else item.arguments
        for argument in members:
            action = container.add_argument(*argument.flags, **argument.keywords)
            if argument.is_path and path_completion is not None:
                action.complete = path_completion  # The interface of shtab.
    parser.set_defaults(usage_error=parser.error)
    return parser


def _summarize(command: Command) -> str:
    """Return the positional arguments and the required options of a command, as one line."""
    if command.actions:
        return "ACTION [options]"
    words = []
    for item in command.arguments:
        if isinstance(item, ArgumentGroup) and not item.title:
            words.append(f"({' | '.join(_show(own) for own in item.arguments)})")
        elif isinstance(item, Argument) and not item.flags[0].startswith("-"):
            shown = item.keywords.get("metavar") or item.name.upper()
            form = {"+": "{} ...", "*": "[{} ...]", "?": "[{}]"}
            words.append(form.get(item.keywords.get("nargs", ""), "{}").format(shown))
        elif isinstance(item, Argument) and item.keywords.get("required"):
            words.append(_show(item))
    return " ".join([*words, "[options]"])


def _show(option: Argument) -> str:
    """Return the first flag of an option with the placeholder of its value."""
    value = option.keywords.get("metavar") or option.name.upper()
    has_value = option.keywords.get("action") is None
    return f"{option.flags[0]} {value}" if has_value else option.flags[0]


def _check_names(
    parsers: dict[tuple[str, ...], argparse.ArgumentParser],
    commands: Sequence[Command],
    words: Sequence[str],
) -> None:
    """End with a usage error if a command or a long option in `words` does not exist.

    The message suggests the most similar name.
    """
    path: tuple[str, ...] = ()
    choices: Sequence[Command] = commands
    while choices and len(path) < len(words) and not words[len(path)].startswith("-"):
        word, names = words[len(path)], [command.name for command in choices]
        if word not in names:
            kind = "ACTION" if path else "COMMAND"
            hint = suggest_name(word, names)
            parsers[path].error(f"{kind} must be one of {', '.join(names)}; got {word!r}{hint}")
        command = choices[names.index(word)]
        path, choices = (*path, word), command.actions
    if not path or choices:
        return
    flags = [flag for flag in _all_flags(command) if flag.startswith("--")]
    for word in words[len(path) :]:
        name = word.partition("=")[0]
        if word == "--":
            return
        if name.startswith("--") and not any(flag.startswith(name) for flag in flags):
            hint = suggest_name(name, flags, prefix="--", cutoff=0.7)
            parsers[path].error(f"{' '.join(path)} has no option {name}{hint}")


def _all_flags(command: Command) -> Collection[str]:
    """Return the flags of all options of a command."""
    flags = ["--help"]
    for item in (*command.arguments, *GENERAL_OPTIONS):
        for argument in (item,) if isinstance(item, Argument) else item.arguments:
            flags += argument.all_flags
    return flags


def parse(
    commands: Sequence[Command], arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse the words `arguments` of a command line (default: ``sys.argv[1:]``).

    Options that are not given take their values from environment variables, otherwise from the
    configuration file, otherwise from their defaults. The result has three additional attributes.
    ``commands`` holds the argument `commands`. ``words`` holds the words of the command line.
    ``origins`` maps the options that a variable or the file sets to the name of that variable or
    file.
    """
    parsers = build_parsers(commands)
    words = sys.argv[1:] if arguments is None else arguments
    _check_names(parsers, commands, words)
    options = parsers[()].parse_args(words)
    command: Command = options.command
    settings = {}
    if command.has_settings:
        parser = parsers[command.name,]
        try:
            settings = find_settings(command, commands)
        except (OSError, ValueError) as error:
            parser.error(str(error))
        # argparse leaves a default that is no string as it is: an option that still holds its
        # `Setting` after parsing is absent from the command line.
        parser.set_defaults(**settings)
        options = parsers[()].parse_args(words)
    options.commands = commands
    options.words = ["mograft", *words]
    options.origins = {}
    for name, setting in settings.items():
        if getattr(options, name) is setting:
            setattr(options, name, setting.value)
            options.origins[name] = setting.origin
    return options
