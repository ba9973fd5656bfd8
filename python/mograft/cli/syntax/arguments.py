"""Declarations of commands and their arguments.

The parser, the settings that the configuration file and the environment may hold, and shell
completion are derived from these declarations.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from mograft.cli.syntax.values import one_of


@dataclass(frozen=True, kw_only=True)
class Argument:
    """One positional argument or option."""

    flags: tuple[str, ...]  # The longest one last; the name of a positional argument.
    keywords: dict[str, Any]  # Keyword arguments of `argparse.ArgumentParser.add_argument`.
    is_setting: bool = False  # Whether the configuration file and the environment may set it.
    is_path: bool = False  # Whether the shell completes the value as a file name.

    @property
    def name(self) -> str:
        """Name of the argument: its longest flag without the dashes, such as ``"sigma-scale"``."""
        return self.flags[-1].lstrip("-")

    @property
    def dest(self) -> str:
        """Attribute of the parsed options that holds the value, such as ``"sigma_scale"``."""
        return self.name.replace("-", "_")

    @property
    def is_switch(self) -> bool:
        """Whether the option takes no value."""
        return self.keywords.get("action") in ("store_true", argparse.BooleanOptionalAction)

    @property
    def all_flags(self) -> tuple[str, ...]:
        """All flags, with ``--no-NAME`` if the option has this opposite."""
        if self.keywords.get("action") is not argparse.BooleanOptionalAction:
            return self.flags
        return (*self.flags, f"--no-{self.name}")

    @property
    def default(self) -> Any:  # noqa: ANN401 - the type of the option's value
        """Value if the option is not given."""
        return self.keywords.get("default", False if self.is_switch else None)


@dataclass(frozen=True)
class ArgumentGroup:
    """A group of command-line options.

    ``--help`` shows a group with a title as a section of its own. If a group has no title, the
    user must give exactly one of its options.
    """

    arguments: tuple[Argument, ...]
    title: str | None = None
    description: str | None = None


@dataclass(frozen=True)
class Command:
    """A command such as ``mograft graft``, or a subcommand such as ``mograft lib verify``.

    ``mograft NAME`` calls ``run(options)`` in the module ``mograft.cli.actions.NAME``. ``mograft
    NAME ACTION`` calls ``run_ACTION(options)`` in the same module. Both return the exit code.
    """

    name: str
    help: str  # One line for the list of commands.
    arguments: tuple[Argument | ArgumentGroup, ...] = ()  # In the order of ``--help``.
    description: str | None = None  # Paragraph above the arguments in ``--help``.
    actions: tuple["Command", ...] = ()  # Its subcommands, such as ``mograft lib verify``.
    has_settings: bool = True  # Whether the settings are read before it runs.

    def settings(self) -> Iterator[Argument]:
        """Iterate over the options that the configuration file and the environment may set."""
        for item in self.arguments:
            members = (item,) if isinstance(item, Argument) else item.arguments
            yield from (argument for argument in members if argument.is_setting)


def command(
    name: str,
    help: str,  # noqa: A002 - as add_parser
    *arguments: Argument | ArgumentGroup,
    **fields: Any,  # noqa: ANN401 - those of `Command`
) -> Command:
    """Return a `Command` with these arguments; `fields` sets its remaining fields."""
    return Command(name, help, arguments, **fields)


def exclusive(*arguments: Argument) -> ArgumentGroup:
    """Return a group of options of which the user must give exactly one."""
    return ArgumentGroup(arguments)


def positional(name: str, help: str, *, is_path: bool = False, **keywords: Any) -> Argument:  # noqa: A002, ANN401 - as add_argument
    """Return the declaration of a positional argument.

    `is_path` makes the shell complete the value as a file name. `keywords` are passed to
    `argparse.ArgumentParser.add_argument`.
    """
    if "choices" in keywords:
        keywords["type"] = one_of(keywords["choices"])
    return Argument(flags=(name,), keywords={"help": help, **keywords}, is_path=is_path)


def option(
    usage: str,
    help: str,  # noqa: A002 - as add_argument
    convert: Callable[[str], Any] = str,
    default: object = None,
    *,
    is_path: bool = False,
    **keywords: Any,  # noqa: ANN401 - as add_argument
) -> Argument:
    """Return the declaration of an option that takes one value.

    `usage` holds the flags and may end with the placeholder that ``--help`` shows for the value,
    as in ``"-j --jobs N"``. `convert` parses the text of the value. `is_path` makes the shell
    complete the value as a file name. `keywords` are passed to
    `argparse.ArgumentParser.add_argument`.
    """
    words = usage.split()
    flags = tuple(word for word in words if word.startswith("-"))
    if len(flags) < len(words):
        keywords["metavar"] = words[-1]
    if "choices" in keywords:
        convert = one_of(keywords["choices"])
    keywords |= {"help": help, "type": convert, "default": default}
    return Argument(flags=flags, keywords=keywords, is_path=is_path)


def setting(*values: Any, **keywords: Any) -> Argument:  # noqa: ANN401 - those of `option`
    """Return an option that the configuration file and the environment may also set.

    The arguments are those of `option`.
    """
    return replace(option(*values, **keywords), is_setting=True)


def switch(flag: str, help: str) -> Argument:  # noqa: A002 - as add_argument
    """Return the declaration of an option that takes no value."""
    return Argument(flags=(flag,), keywords={"action": "store_true", "help": help})


def setting_switch(flag: str, help: str) -> Argument:  # noqa: A002 - as add_argument
    """Return the declaration of an option that takes no value.

    The configuration file and the environment may also set it.
    """
    return replace(switch(flag, help), is_setting=True)


def setting_flag(flag: str, help: str) -> Argument:  # noqa: A002 - as add_argument
    """Return an option ``--NAME`` with its opposite ``--no-NAME``; its default is None.

    The configuration file and the environment may also set it.
    """
    keywords = {"action": argparse.BooleanOptionalAction, "help": help}
    return Argument(flags=(flag,), keywords=keywords, is_setting=True)


def repeated_option(usage: str, help: str, convert: Callable[[str], Any] = str) -> Argument:  # noqa: A002
    """Return an option that may be given several times; its value is the list of all values.

    The arguments are those of `option`.
    """
    return option(usage, help, convert, [], action="append")
