"""Declarations of commands and their arguments.

Each command is declared once, as a `Command`. The parser, the settings that the configuration
file and the environment may hold, and shell completion are derived from that declaration.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

__all__ = [
    "Argument",
    "ArgumentGroup",
    "Command",
    "ExclusiveArguments",
    "option",
    "positional",
    "repeated_option",
    "switch",
]


@dataclass(frozen=True, kw_only=True)
class Argument:
    """One positional argument or option.

    Attributes
    ----------
    flags : tuple of str
        The flags of an option, the longest one last; the name of a positional argument.
    keywords : dict
        Keyword arguments of `argparse.ArgumentParser.add_argument`.
    is_setting : bool
        Whether the configuration file and the environment may set the option.
    is_path : bool
        Whether the shell completes the value as a file name.
    """

    flags: tuple[str, ...]
    keywords: dict[str, Any]
    is_setting: bool = False
    is_path: bool = False

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
class ExclusiveArguments:
    """Options of which exactly one is required."""

    arguments: tuple[Argument, ...]


@dataclass(frozen=True)
class ArgumentGroup:
    """Options that ``--help`` lists under a title of their own."""

    title: str
    description: str
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command, or one action of a command.

    Attributes
    ----------
    name : str
        The word that selects it.
    help : str
        One line for the list of commands.
    run : callable, optional
        Function of the parsed options that returns the exit code. Default: the command has
        actions.
    arguments : tuple
        Its arguments, in the order of ``--help``.
    description : str, optional
        Paragraph above the arguments in ``--help``.
    actions : tuple of Command
        The commands below it, as ``mograft lib verify``.
    has_settings : bool
        Whether the configuration file and the environment are read before it runs.
    """

    name: str
    help: str
    run: Callable[[argparse.Namespace], int] | None = None
    arguments: tuple[Argument | ArgumentGroup | ExclusiveArguments, ...] = ()
    description: str | None = None
    actions: tuple["Command", ...] = ()
    has_settings: bool = True

    def settings(self) -> Iterator[Argument]:
        """Iterate over the options that the configuration file may set."""
        for item in self.arguments:
            members = (item,) if isinstance(item, Argument) else item.arguments
            yield from (argument for argument in members if argument.is_setting)


def positional(name: str, *, is_path: bool = False, **keywords: Any) -> Argument:  # noqa: ANN401
    """Return a positional argument; `keywords` are those of `add_argument`."""
    return Argument(flags=(name,), keywords=keywords, is_path=is_path)


def option(
    *flags: str,
    is_setting: bool = True,
    is_path: bool = False,
    **keywords: Any,  # noqa: ANN401 - as add_argument
) -> Argument:
    """Return an option that takes one value; `keywords` are those of `add_argument`."""
    return Argument(flags=flags, keywords=keywords, is_setting=is_setting, is_path=is_path)


def switch(*flags: str, help: str, is_setting: bool = True) -> Argument:  # noqa: A002
    """Return an option that takes no value."""
    return Argument(
        flags=flags, keywords={"action": "store_true", "help": help}, is_setting=is_setting
    )


def repeated_option(*flags: str, **keywords: Any) -> Argument:  # noqa: ANN401 - as add_argument
    """Return an option that may be given several times; its value is a list."""
    return Argument(flags=flags, keywords={"action": "append", "default": [], **keywords})
