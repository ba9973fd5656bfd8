"""Declarations of commands, and of their options as fields of frozen dataclasses.

The parser, the settings that the configuration file and the environment may hold, and shell
completion are derived from these declarations. A command receives an instance of its dataclass.
"""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, ClassVar

from mograft.cli.syntax.values import TEXT, Value

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
EXPERT_SECTIONS = ("donors", "scenario")
"""Headings of options that only ``--help-all`` shows."""


class UsageError(Exception):
    """Options that are invalid or contradict each other: the command ends with exit code 2."""


@dataclass(frozen=True, kw_only=True)
class Argument:
    """How the command line, the configuration file and the environment give a field a value."""

    help: str
    value: Value | None  # None for an option that takes no value.
    default: Any
    details: str = ""  # Continues the help text in ``--help-all``.
    short: str | None = None  # A second flag, such as ``-n``.
    count: str | None = None  # ``nargs`` of a positional argument.
    is_positional: bool = False
    is_required: bool = False
    is_repeated: bool = False  # Whether the value is a tuple of all values that are given.
    is_expert: bool = False  # Whether only ``--help-all`` shows it, as all of `EXPERT_SECTIONS`.
    is_setting: bool = False  # Whether the configuration file and the environment may set it.
    dest: str = ""  # The name of the field.
    section: str = "options"  # Heading in ``--help``.

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
    def usage(self) -> str:
        """How the usage line shows a positional argument or a required option."""
        assert self.value is not None
        forms = {"+": "{} ...", "*": "[{} ...]", "?": "[{}]", None: "{}"}
        shown = forms[self.count].format(self.value.placeholder)
        return shown if self.is_positional else f"{self.flags[0]} {shown}"


def option(
    help: str,  # noqa: A002 - as add_argument
    value: Value | None = TEXT,
    default: object = None,
    **more: Any,  # noqa: ANN401 - fields of `Argument`
) -> Any:  # noqa: ANN401 - the type of the field
    """Return a field for an option; `more` has fields of `Argument`."""
    argument = Argument(help=help, value=value, default=default, **more)
    return field(default=default, metadata={"argument": argument})


def setting(*values: Any, **more: Any) -> Any:  # noqa: ANN401 - those of `option`
    """Return an option that the configuration file and the environment may also set."""
    return option(*values, is_setting=True, **more)


def repeated(help: str, value: Value, **more: Any) -> Any:  # noqa: A002, ANN401 - those of `option`
    """Return an option that may be given several times; its value is the tuple of all values."""
    return option(help, value, (), is_repeated=True, **more)


def switch(help: str, **more: Any) -> Any:  # noqa: A002, ANN401 - those of `option`
    """Return an option that takes no value."""
    return option(help, None, default=False, **more)


def positional(help: str, value: Value, count: str | None = None) -> Any:  # noqa: A002, ANN401
    """Return a field for a positional argument; `count` is ``nargs`` of ``add_argument``."""
    is_repeated = count in ("+", "*")
    own = {"count": count, "is_positional": True, "is_repeated": is_repeated}
    argument = Argument(help=help, value=value, default=None, **own)  # type: ignore[arg-type]
    return field(default=MISSING, metadata={"argument": argument})


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a command, and how they were given; base class of all options.

    The argument `section` of a subclass is the heading in ``--help`` of the options that it
    declares.
    """

    section: ClassVar[str] = "general"

    def __init_subclass__(cls, section: str = "options") -> None:
        cls.section = section

    quiet: bool = switch("print only results and errors", short="-q", is_expert=True)
    verbose: bool = switch("also print details that require no action", short="-v", is_expert=True)
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
    """A command such as ``mograft graft``, or a subcommand such as ``mograft lib verify``.

    The docstring of its options is its description.
    """

    name: str
    options: type[Options] = Options
    run: str = ""  # ``MODULE:FUNCTION`` in `mograft.cli.actions`; it returns the exit code.
    summary: str | None = None  # Its line in the list of commands, if it has subcommands.
    actions: tuple["Command", ...] = ()  # Its subcommands, such as ``mograft lib verify``.

    @property
    def help(self) -> str:
        """Its line in the list of commands."""
        first = (self.options.__doc__ or "").partition("\n")[0].rstrip(".")
        return self.summary or first[:1].lower() + first[1:]

    def arguments(self) -> Iterator[Argument]:
        """Iterate over the arguments of the command."""
        return arguments_of(self.options)

    def settings(self) -> Iterator[Argument]:
        """Iterate over the options that the configuration file and the environment may set."""
        return (argument for argument in self.arguments() if argument.is_setting)


def arguments_of(options: Options | type[Options]) -> Iterator[Argument]:
    """Iterate over the arguments that the fields of options declare, positional ones first."""
    classes: Any = (options if isinstance(options, type) else type(options)).__mro__
    found = []
    for own in fields(options):
        if "argument" in own.metadata:
            argument, section = own.metadata["argument"], "input"
            if not argument.is_positional:  # The class that declares the field has its default.
                section = next(c.section for c in classes if own.name in vars(c))
            found.append(replace(argument, dest=own.name, section=section))
    # An argument of several words takes all that follow.
    return iter(
        sorted(found, key=lambda a: (not a.is_positional, a.is_positional and a.is_repeated))
    )
