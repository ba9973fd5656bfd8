"""The argparse parsers, built from the declarations of the commands."""

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from mograft import __version__
from mograft.cli.settings import Setting, find_settings
from mograft.cli.syntax.arguments import (
    EXPERT_SECTIONS,
    SECTIONS,
    Argument,
    Command,
    Options,
    UsageError,
)
from mograft.errors import suggest_name

_GENERAL_FLAGS = ("--help", "--help-all")
_GENERAL = ("quiet", "verbose", "json")
"""Options that ``--help`` shows if it would leave out nothing else."""


class _Parser(argparse.ArgumentParser):
    """A parser that prints each error as two lines: the usage, then the error."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and an error, and end the program with exit code 2."""
        usage = " ".join(self.format_usage().split())
        help_words = self.prog if self.prog in usage else "mograft"
        print(f"{usage} (see {help_words} --help)\nerror: {message}", file=sys.stderr)
        raise SystemExit(2)


def _formatter(prog: str) -> argparse.HelpFormatter:
    return argparse.HelpFormatter(prog, max_help_position=28)


class _ShortHelp(argparse.Action):
    """Print the help without the options and details of ``--help-all``."""

    texts: dict[argparse.Action, str]  # The help text of each action that has details.

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        for action, text in self.texts.items():
            action.help = text
        parser.print_help()
        parser.exit()


def build_parsers(
    commands: Sequence[Command], *, is_completion: bool = False
) -> dict[tuple[str, ...], argparse.ArgumentParser]:
    """Return the argparse parsers of the program, of its commands and of their subcommands.

    The keys are the words of a command, such as ``("lib", "verify")``, and ``()`` for the program.
    With `is_completion` they have the attributes that shtab reads.
    """
    root = _Parser(
        prog="mograft",
        usage="mograft COMMAND [options]",
        description="Create natural motions from captured ones by exchanging body parts.",
    )
    root.add_argument("--version", action="version", version=f"mograft {__version__}")
    parsers: dict[tuple[str, ...], argparse.ArgumentParser] = {(): root}

    def add(
        parent: argparse.ArgumentParser, members: Sequence[Command], path: tuple[str, ...]
    ) -> None:
        kind = "action" if path else "command"
        subparsers = parent.add_subparsers(
            title=f"{kind}s", prog=parent.prog, required=True, metavar=kind.upper()
        )
        for command in members:
            words = (*path, command.name)
            parser: Any = subparsers.add_parser(
                command.name,
                prog=f"mograft {' '.join(words)}",
                usage=f"mograft {' '.join(words)} {_summarize(command)}",
                help=command.help,
                description=None if command.actions else command.options.__doc__,
                add_help=bool(command.actions),
                formatter_class=_formatter,
            )
            parsers[words] = parser
            if command.actions:
                add(parser, command.actions, words)
            else:
                parser.set_defaults(command=command, parser=parser)
                _add_arguments(parser, command, is_completion=is_completion)

    add(root, commands, ())
    return parsers


def _add_arguments(parser: Any, command: Command, *, is_completion: bool) -> None:  # noqa: ANN401 - argparse or shtab
    arguments = list(command.arguments())
    short_texts: dict[argparse.Action, str] = {}
    for section in SECTIONS:
        members = [argument for argument in arguments if argument.section == section]
        if members:
            group = parser.add_argument_group(section)
        for argument in members:
            action = group.add_argument(*argument.flags, **_keywords(argument))
            if argument.is_expert or section in EXPERT_SECTIONS:
                short_texts[action] = argparse.SUPPRESS
            elif argument.details:
                short_texts[action] = argument.help
            if is_completion and argument.value is not None:
                _add_completion(action, argument)
    if all(action.dest in _GENERAL for action in short_texts):
        short_texts.clear()
    # The last group is that of --quiet, which every command has.
    short = group.add_argument("-h", "--help", action=_ShortHelp, nargs=0, help="show this text")
    short.texts = short_texts
    if short_texts:
        group.add_argument("--help-all", action="help", help="show all options, with details")


def _keywords(argument: Argument) -> dict[str, Any]:
    """Return the keyword arguments of ``add_argument``."""
    text = f"{argument.help}; {argument.details}" if argument.details else argument.help
    keywords: dict[str, Any] = {"help": text.replace("%", "%%")}
    if argument.value is None:
        return keywords | {"action": "store_true", "dest": argument.dest}
    keywords |= {"type": argument.value.convert, "metavar": argument.value.placeholder}
    if argument.is_positional:
        return keywords | {"nargs": argument.count}
    if argument.is_repeated:
        return keywords | {"action": "append", "dest": argument.dest}
    default, required = argument.default, argument.is_required
    return keywords | {"default": default, "required": required, "dest": argument.dest}


def _add_completion(action: Any, argument: Argument) -> None:  # noqa: ANN401 - shtab adds attributes
    assert argument.value is not None
    if argument.value.is_path:
        import shtab

        action.complete = shtab.FILE
    if argument.value.choices:
        action.choices = argument.value.choices
    if argument.dest == "set":
        from mograft.config_text import field_choices

        action.choices = field_choices()


def _summarize(command: Command) -> str:
    """Return the positional arguments and the required options of a command, as one line."""
    if command.actions:
        return "ACTION [options]"
    shown = (a.usage for a in command.arguments() if a.is_positional or a.is_required)
    return " ".join([*shown, "[options]"])


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
    flags = [f"--{own.name}" for own in command.arguments() if not own.is_positional]
    flags += _GENERAL_FLAGS
    for word in words[len(path) :]:
        name = word.partition("=")[0]
        if word == "--":
            return
        if name.startswith("--") and not any(flag.startswith(name) for flag in flags):
            hint = suggest_name(name, flags, prefix="--", cutoff=0.7)
            parsers[path].error(f"{' '.join(path)} has no option {name}{hint}")


def parse(
    commands: Sequence[Command], arguments: Sequence[str] | None = None
) -> tuple[Command, Options, argparse.ArgumentParser]:
    """Parse the words `arguments` of a command line (default: ``sys.argv[1:]``).

    Return the command, its options, and the parser that reports its usage errors. Options that are
    not given take their values from environment variables, otherwise from the configuration file,
    otherwise from their defaults.
    """
    parsers = build_parsers(commands)
    words = sys.argv[1:] if arguments is None else arguments
    _check_names(parsers, commands, words)
    found = vars(parsers[()].parse_args(words))
    command: Command = found["command"]
    parser: argparse.ArgumentParser = found["parser"]
    settings: dict[str, Setting] = {}
    more: dict[str, Any] = {}
    if any(command.settings()):
        try:
            settings = find_settings(command, commands)
        except (OSError, UsageError, ValueError) as error:
            parser.error(str(error))
        if "set" in settings:
            more["configured"] = settings.pop("set").value
        # argparse leaves a default that is no string as it is: an option that still holds its
        # `Setting` after parsing is absent from the command line.
        parser.set_defaults(**settings)
        found = vars(parsers[()].parse_args(words))
    values: dict[str, Any] = {}
    origins: dict[str, str] = {}
    for argument in command.arguments():
        value, name = found[argument.dest], argument.dest
        if name in settings and value is settings[name]:
            value, origins[name] = settings[name].value, settings[name].origin
        values[name] = tuple(value or ()) if argument.is_repeated else value
    values |= {"words": ("mograft", *words), "origins": origins, **more}
    options = command.options(**values)
    return command, options, parser
