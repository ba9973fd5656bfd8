"""The argparse parsers, built from the declarations of the commands."""

import argparse
from collections.abc import Sequence
from typing import Any

from mograft import __version__
from mograft.cli.arguments import Argument, ArgumentGroup, Command
from mograft.cli.settings import find_settings


def build_parsers(
    commands: Sequence[Command], path_completion: object = None
) -> dict[tuple[str, ...], argparse.ArgumentParser]:
    """Return the argparse parsers of the program, of its commands and of their subcommands.

    The keys are the words of a command, such as ``("lib", "verify")``, and ``()`` for the program.
    `path_completion` is assigned to the attribute ``complete`` of all arguments that are paths;
    shtab reads this attribute.
    """
    root = argparse.ArgumentParser(
        prog="mograft",
        description="Create natural motions from captured ones by exchanging body parts.",
    )
    root.add_argument("--version", action="version", version=f"mograft {__version__}")
    parsers: dict[tuple[str, ...], argparse.ArgumentParser] = {(): root}
    subparsers = root.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in commands:
        parser = _add_parser(subparsers, command, path_completion)
        parser.set_defaults(command=command, function="run")
        parsers[command.name,] = parser
        if command.actions:
            actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
        for action in command.actions:
            parser = _add_parser(actions, action, path_completion)
            parser.set_defaults(command=command, function=f"run_{action.name}")
            parsers[command.name, action.name] = parser
    return parsers


def _add_parser(
    subparsers: Any,  # noqa: ANN401 - argparse does not publish its type
    command: Command,
    path_completion: object,
) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        command.name, help=command.help, description=command.description
    )
    for item in command.arguments:
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


def parse(
    commands: Sequence[Command], arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse the words `arguments` of a command line (default: ``sys.argv[1:]``).

    Options that are not given take their values from environment variables, otherwise from the
    configuration file, otherwise from their defaults. The result has the additional attributes
    ``commands``, which is the argument, and ``origins``, which maps each option that the file or
    a variable set to the name of this file or variable.
    """
    parsers = build_parsers(commands)
    options = parsers[()].parse_args(arguments)
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
        options = parsers[()].parse_args(arguments)
    options.commands = commands
    options.origins = {}
    for name, setting in settings.items():
        if getattr(options, name) is setting:
            setattr(options, name, setting.value)
            options.origins[name] = setting.origin
    return options
