"""The argparse parsers, built from the declarations of the commands."""

import argparse
from collections.abc import Sequence

from mograft import __version__
from mograft.cli.arguments import ArgumentGroup, Command, ExclusiveArguments
from mograft.cli.settings import find_settings

__all__ = ["build_parsers", "parse"]

Parsers = dict[tuple[str, ...], argparse.ArgumentParser]


def build_parsers(commands: Sequence[Command], path_completion: object = None) -> Parsers:
    """Return the parsers of the program, its commands and their actions.

    Parameters
    ----------
    commands : sequence of Command
        The commands.
    path_completion : object, optional
        Value of the attribute ``complete`` of arguments that are paths, as shtab reads it.

    Returns
    -------
    dict of tuple of str to argparse.ArgumentParser
        By the words that select a command, as ``("lib", "verify")``; ``()`` is the program.
    """
    root = argparse.ArgumentParser(
        prog="mograft",
        description="Create natural motions from captured ones by exchanging body parts.",
    )
    root.add_argument("--version", action="version", version=f"mograft {__version__}")
    parsers: Parsers = {(): root}
    subparsers = root.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in commands:
        parser = subparsers.add_parser(
            command.name, help=command.help, description=command.description
        )
        parsers[command.name,] = parser
        _add_arguments(parser, command, path_completion)
        if command.actions:
            actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
        for action in command.actions:
            below = actions.add_parser(
                action.name, help=action.help, description=action.description
            )
            parsers[command.name, action.name] = below
            _add_arguments(below, action, path_completion)
            below.set_defaults(command=command)
    return parsers


def _add_arguments(
    parser: argparse.ArgumentParser, command: Command, path_completion: object
) -> None:
    for item in command.arguments:
        if isinstance(item, ArgumentGroup):
            group = parser.add_argument_group(item.title, item.description)
            members, add = item.arguments, group.add_argument
        elif isinstance(item, ExclusiveArguments):
            add = parser.add_mutually_exclusive_group(required=True).add_argument
            members = item.arguments
        else:
            members, add = (item,), parser.add_argument
        for argument in members:
            action = add(*argument.flags, **argument.keywords)
            if argument.is_path and path_completion is not None:
                action.complete = path_completion  # type: ignore[attr-defined] # shtab's interface
    parser.set_defaults(run=command.run, command=command, usage_error=parser.error)


def parse(
    commands: Sequence[Command], arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse a command line; options it omits come from the environment, then from the file.

    Parameters
    ----------
    commands : sequence of Command
        All commands.
    arguments : sequence of str, optional
        The words after the program's name. Default: those of the process.

    Returns
    -------
    argparse.Namespace
        The options, with ``commands`` as given and ``origins``: for each option that was set
        outside the command line, the file or variable that set it.
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
        # `Setting` after parsing was not given on the command line.
        parser.set_defaults(**settings)
        options = parsers[()].parse_args(arguments)
    options.commands = commands
    options.origins = {}
    for name, setting in settings.items():
        if getattr(options, name) is setting:
            setattr(options, name, setting.value)
            options.origins[name] = setting.origin
    return options
