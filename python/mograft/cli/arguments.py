"""Declarations of commands and their arguments.

The parser, the settings that the configuration file and the environment may hold, and shell
completion are derived from these declarations.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Argument:
    """One positional argument or option."""

    flags: tuple[str, ...]  # The longest one last; the name of a positional argument.
    keywords: dict[str, Any]  # Keyword arguments of `argparse.ArgumentParser.add_argument`.
    is_setting: bool = False  # Whether the configuration file and the environment may set it.
    is_path: bool = False  # Whether the shell completes the value as a file name.

    @property
    def name(self) -> str:
        """Name of the setting: the longest flag without dashes, ``"sigma-scale"``."""
        return self.flags[-1].lstrip("-")

    @property
    def dest(self) -> str:
        """Name of the attribute that holds the value, ``"sigma_scale"``."""
        return self.name.replace("-", "_")

    @property
    def is_switch(self) -> bool:
        """Whether the option takes no value."""
        return self.keywords.get("action") == "store_true"

    @property
    def default(self) -> Any:  # noqa: ANN401 - the type of the option's value
        """Value if the option is not given."""
        return self.keywords.get("default", False if self.is_switch else None)


@dataclass(frozen=True)
class ArgumentGroup:
    """Options that belong together.

    With a title, ``--help`` lists them under it; without, exactly one of them is required.
    """

    arguments: tuple[Argument, ...]
    title: str | None = None
    description: str | None = None


@dataclass(frozen=True)
class Command:
    """One command, or one action of a command.

    Function ``run`` of module ``mograft.cli.NAME`` takes the parsed options and returns the exit
    code; for an action it is ``run_ACTION`` of the module of its command.
    """

    name: str
    help: str  # One line for the list of commands.
    arguments: tuple[Argument | ArgumentGroup, ...] = ()  # In the order of ``--help``.
    description: str | None = None  # Paragraph above the arguments in ``--help``.
    actions: tuple["Command", ...] = ()  # Its subcommands, such as ``mograft lib verify``.
    has_settings: bool = True  # Whether the settings are read before it runs.

    def settings(self) -> Iterator[Argument]:
        """Iterate over the options that the configuration file may set."""
        for item in self.arguments:
            members = (item,) if isinstance(item, Argument) else item.arguments
            yield from (argument for argument in members if argument.is_setting)


def command(
    name: str,
    help: str,  # noqa: A002 - as add_parser
    *arguments: Argument | ArgumentGroup,
    **fields: Any,  # noqa: ANN401 - those of `Command`
) -> Command:
    """Return a command; `fields` are the other fields of `Command`."""
    return Command(name, help, arguments, **fields)


def exclusive(*arguments: Argument) -> ArgumentGroup:
    """Return options of which exactly one is required."""
    return ArgumentGroup(arguments)


def positional(name: str, help: str, *, is_path: bool = False, **keywords: Any) -> Argument:  # noqa: A002, ANN401 - as add_argument
    """Return a positional argument; `keywords` are those of `add_argument`."""
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
    """Return an option that takes one value; `keywords` are those of `add_argument`.

    `usage` holds the flags, and the placeholder of the value in ``--help`` if it is not the name
    of the option: ``"-j --jobs N"``. `convert` is the ``type`` of `add_argument`.
    """
    words = usage.split()
    flags = tuple(word for word in words if word.startswith("-"))
    if len(flags) < len(words):
        keywords["metavar"] = words[-1]
    keywords |= {"help": help, "type": convert, "default": default}
    return Argument(flags=flags, keywords=keywords, is_path=is_path)


def setting(*values: Any, **keywords: Any) -> Argument:  # noqa: ANN401 - those of `option`
    """Return an `option` that the configuration file and the environment may also set."""
    return replace(option(*values, **keywords), is_setting=True)


def switch(flag: str, help: str) -> Argument:  # noqa: A002 - as add_argument
    """Return an option that takes no value."""
    return Argument(flags=(flag,), keywords={"action": "store_true", "help": help})


def setting_switch(flag: str, help: str) -> Argument:  # noqa: A002 - as add_argument
    """Return a `switch` that the configuration file and the environment may also set."""
    return replace(switch(flag, help), is_setting=True)


def repeated_option(usage: str, help: str, convert: Callable[[str], Any] = str) -> Argument:  # noqa: A002
    """Return an option that may be given several times; its value is a list."""
    return option(usage, help, convert, [], action="append")
