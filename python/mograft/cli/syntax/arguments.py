"""Declarations of commands, and of their options as fields of frozen dataclasses.

The parser, the settings that the configuration file and the environment may hold, and shell
completion are derived from these declarations. A command receives an instance of its dataclass.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any

from mograft.cli.syntax.values import one_of

SECTIONS = (
    "input",
    "what to keep",
    "what to change",
    "how different",
    "where the hands go",
    "donors",
    "scenario",
    "options",
    "output",
    "general",
)
"""Headings of ``--help``, in their order."""
INPUT, KEEP, CHANGE, DIFFERENT, PLACE, DONORS, SCENARIO, OPTIONS, OUTPUT, GENERAL = SECTIONS
EXPERT_SECTIONS = (DONORS, SCENARIO)
"""Headings of options that only ``--help-all`` shows."""


class UsageError(Exception):
    """Options that are invalid or contradict each other: the command ends with exit code 2."""


@dataclass(frozen=True, kw_only=True)
class Argument:
    """How the command line, the configuration file and the environment give a field a value."""

    keywords: Mapping[str, Any]  # Keyword arguments of `argparse.ArgumentParser.add_argument`.
    dest: str = ""  # The name of the field.
    short: str | None = None  # A second flag, such as ``-n``.
    section: str = OPTIONS  # Heading in ``--help``.
    details: str = ""  # Continues the help text in ``--help-all``.
    is_expert: bool = False  # Whether only ``--help-all`` shows it, as all of `EXPERT_SECTIONS`.
    is_positional: bool = False
    is_setting: bool = False  # Whether the configuration file and the environment may set it.
    is_path: bool = False  # Whether the shell completes the value as a file name.
    default: Any = None

    @property
    def name(self) -> str:
        """Name for the user: that of the field with dashes, such as ``"max-stretch"``."""
        return self.dest.rstrip("_").replace("_", "-")

    @property
    def flags(self) -> tuple[str, ...]:
        """The flags, the long one last; for a positional argument its name."""
        if self.is_positional:
            return (self.dest,)
        return (*((self.short,) if self.short else ()), f"--{self.name}")

    @property
    def is_switch(self) -> bool:
        """Whether the option takes no value."""
        return self.keywords.get("action") == "store_true"

    @property
    def is_repeated(self) -> bool:
        """Whether the value is a tuple of all values that are given."""
        return self.keywords.get("action") == "append" or self.keywords.get("nargs") not in (
            None,
            "?",
        )

    @property
    def placeholder(self) -> str:
        """What stands for the value in help texts."""
        return str(self.keywords.get("metavar") or self.name.upper())


def option(
    help: str,  # noqa: A002 - as add_argument
    convert: Callable[[str], Any] = str,
    default: object = None,
    *,
    details: str = "",
    section: str = OPTIONS,
    short: str | None = None,
    is_expert: bool = False,
    is_setting: bool = False,
    is_path: bool = False,
    **keywords: Any,  # noqa: ANN401 - as add_argument
) -> Any:  # noqa: ANN401 - the type of the field
    """Return a field for an option with one value, or for several with ``action="append"``.

    `convert` parses the text of a value. `details` continues the text `help` in ``--help-all``.
    The other arguments are fields of `Argument` and `keywords` of ``add_argument``.
    """
    if "choices" in keywords:
        convert = one_of(keywords["choices"])
    keywords |= {"help": help, "type": convert}
    if keywords.get("action") == "append":
        default = ()
    return _field(
        default=default,
        keywords=keywords,
        details=details,
        section=section,
        short=short,
        is_expert=is_expert,
        is_setting=is_setting,
        is_path=is_path,
    )


def setting(*values: Any, **keywords: Any) -> Any:  # noqa: ANN401 - those of `option`
    """Return an option that the configuration file and the environment may also set."""
    return option(*values, is_setting=True, **keywords)


def repeated(*values: Any, **keywords: Any) -> Any:  # noqa: ANN401 - those of `option`
    """Return an option that may be given several times; its value is the tuple of all values."""
    return option(*values, action="append", **keywords)


def switch(help: str, *, is_setting: bool = False, **more: Any) -> Any:  # noqa: A002, ANN401
    """Return a field for an option that takes no value; `more` has fields of `Argument`."""
    keywords = {"action": "store_true", "help": help}
    return _field(default=False, keywords=keywords, is_setting=is_setting, **more)


def positional(help: str, *, is_path: bool = False, **keywords: Any) -> Any:  # noqa: A002, ANN401
    """Return a field for a positional argument; `keywords` are those of ``add_argument``."""
    if "choices" in keywords:
        keywords["type"] = one_of(keywords["choices"])
    keywords["help"] = help
    return _field(default=MISSING, keywords=keywords, is_path=is_path, is_positional=True)


def _field(*, default: Any, **values: Any) -> Any:  # noqa: ANN401
    argument = Argument(default=None if default is MISSING else default, **values)
    return field(default=default, metadata={"argument": argument})


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a command, and how they were given; base class of all options."""

    quiet: bool = switch(
        "print only results and errors", short="-q", section=GENERAL, is_expert=True
    )
    verbose: bool = switch(
        "also print details that require no action",
        short="-v",
        section=GENERAL,
        is_expert=True,
    )
    words: tuple[str, ...] = ()  # The command line.
    origins: Mapping[str, str] = field(default_factory=dict)
    """The file or the environment variable of each field that a setting gives a value."""

    def given(self, *names: str) -> list[str]:
        """Return those of `names` that are options given on the command line.

        The default of each option in `names` must be None, False or empty.
        """
        return [name for name in names if name not in self.origins and getattr(self, name)]


@dataclass(frozen=True)
class Command:
    """A command such as ``mograft graft``, or a subcommand such as ``mograft lib verify``."""

    name: str
    help: str  # One line for the list of commands.
    options: type[Options] = Options
    run: str = ""  # ``MODULE:FUNCTION`` in `mograft.cli.actions`; it returns the exit code.
    description: str | None = None  # Paragraph above the arguments in ``--help``.
    actions: tuple["Command", ...] = ()  # Its subcommands, such as ``mograft lib verify``.

    def arguments(self) -> Iterator[Argument]:
        """Iterate over the arguments of the command."""
        return arguments_of(self.options)

    def settings(self) -> Iterator[Argument]:
        """Iterate over the options that the configuration file and the environment may set."""
        return (argument for argument in self.arguments() if argument.is_setting)


def arguments_of(options: Options | type[Options]) -> Iterator[Argument]:
    """Iterate over the arguments that the fields of options declare."""
    for own in fields(options):
        if "argument" in own.metadata:
            yield replace(own.metadata["argument"], dest=own.name)
