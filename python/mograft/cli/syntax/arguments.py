"""Declarations of commands, and of their options as fields of frozen dataclasses.

The parser, the settings that the configuration file and the environment may hold, and shell
completion are derived from these declarations. A command receives an instance of its dataclass.
"""

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from inspect import get_annotations
from typing import Any, ClassVar, Literal, cast, dataclass_transform, get_args, get_origin

from mograft.cli.syntax.converters import Value, choice

EXPERT_SECTIONS = ("donors", "scenario")
"""Headings of options that only ``--help-all`` shows."""

_MOST_USED = ("input", "what to keep", "what to change", "how different", "where the hands go")
SECTIONS = (*_MOST_USED, *EXPERT_SECTIONS, "options", "output", "general")
"""Headings of ``--help``, in their order."""


class UsageError(Exception):
    """Options that are invalid or contradict each other: the command ends with exit code 2."""


@dataclass(frozen=True, kw_only=True)
class Argument:
    """How the command line, the configuration file and the environment give a field a value."""

    dest: str  # The name of the field.
    section: str  # Heading in ``--help``.
    value: Value | None  # None for an option that takes no value.
    is_repeated: bool  # Whether the value is a tuple of all values that are given.
    help: str
    default: Any
    details: str = ""  # Continues the help text in ``--help-all``.
    short: str | None = None  # A second flag, such as ``-n``.
    count: str | None = None  # ``nargs`` of a positional argument.
    is_positional: bool = False
    is_required: bool = False
    implied: str | None = None  # The value of an option that is given without one.
    alternative: str | None = None  # An option that may be given instead of a required one.
    is_expert: bool = False  # Whether only ``--help-all`` shows it.
    is_setting: bool = False  # Whether the configuration file and the environment may set it.

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


def option(help: str, **more: Any) -> Any:  # noqa: A002, ANN401 - as add_argument
    """Return a field for an option; `more` has fields of `Argument`.

    Its type has a `Value`, or is bool for an option that takes no value. An option with the type
    ``tuple[...]`` may be given several times.
    """
    return field(metadata={"help": help, **more})


def setting(help: str, **more: Any) -> Any:  # noqa: A002, ANN401 - those of `option`
    """Return an option that the configuration file and the environment may also set."""
    return option(help, is_setting=True, **more)


def positional(help: str, count: str | None = None) -> Any:  # noqa: A002, ANN401 - as `option`
    """Return a field for a positional argument; `count` is ``nargs`` of ``add_argument``."""
    return option(help, count=count, is_positional=True)


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(option, setting, positional)
)
class _Declaration:
    """Base class that makes its subclasses frozen dataclasses.

    The argument `section` of a subclass is the heading in ``--help`` of the options that it
    declares.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    section: ClassVar[str]

    def __init_subclass__(cls, section: str = "options") -> None:
        cls.section = section
        dataclass(frozen=True, kw_only=True)(cls)


class Options(_Declaration, section="general"):
    """The options of a command, and how they were given; base class of all options."""

    quiet: bool = option("print only results and errors", short="-q", is_expert=True)
    verbose: bool = option("also print details that require no action", short="-v", is_expert=True)
    words: tuple[str, ...]  # The command line.
    origins: Mapping[str, str]
    """The file or the environment variable of each field that a setting gives a value."""

    def given(self, *names: str) -> list[str]:
        """Return those of `names` that are options given on the command line.

        The default of each option in `names` must be None, False or empty.
        """
        return [name for name in names if name not in self.origins and getattr(self, name, None)]

    def changed(self) -> dict[str, str]:
        """Return the options that the command line changes, as names for the user by field."""
        own = [a for a in arguments_of(type(self)) if a.dest not in self.origins]
        return {a.dest: a.name for a in own if getattr(self, a.dest) not in (a.default, None)}


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

    def arguments(self) -> list[Argument]:
        """Return the arguments of the command."""
        return arguments_of(self.options)

    def settings(self) -> list[Argument]:
        """Return the options that the configuration file and the environment may set."""
        return [argument for argument in self.arguments() if argument.is_setting]


def arguments_of(options: type[Options]) -> list[Argument]:
    """Return the arguments that the fields of options declare, positional ones first."""
    found, classes = [], cast(Any, options.__mro__)
    for own in fields(options):
        if "help" in own.metadata:
            value, is_repeated = _find_value(own.type), get_origin(own.type) is tuple
            # The heading is that of the class that declares the option.
            section = next(c.section for c in classes if own.name in get_annotations(c))
            given = {
                "section": "input" if "count" in own.metadata else section,
                "is_expert": section in EXPERT_SECTIONS,
                "default": () if is_repeated else False if value is None else None,
                **own.metadata,
            }
            found.append(Argument(dest=own.name, value=value, is_repeated=is_repeated, **given))
    # An argument of several words takes all that follow.
    return sorted(found, key=lambda a: (not a.is_positional, a.is_positional and a.is_repeated))


def _find_value(kind: Any) -> Value | None:  # noqa: ANN401 - any annotation
    """Return the `Value` of an annotation such as ``Annotated[int, Value()] | None``, or None."""
    if get_origin(kind) is Literal:
        return choice(*get_args(kind))
    inner = getattr(kind, "__metadata__", None) or map(_find_value, get_args(kind))
    return next(filter(None, inner), None)
