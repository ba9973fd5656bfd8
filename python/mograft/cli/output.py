"""Results on stdout; progress, remarks and errors on stderr.

Names of files and clips may contain terminal commands: control characters are escaped.
"""

import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from contextvars import ContextVar
from typing import IO, Any

from mograft.cli.syntax.arguments import Options
from mograft.cli.syntax.options import ResultOptions


def print_result(
    options: ResultOptions, schema: str, document: dict[str, Any], lines: Iterable[object]
) -> None:
    """Print the result of a command: `document` if ``--json`` is given, otherwise `lines`.

    The printed document has the additional entry ``"schema": "mograft.SCHEMA"``. `schema` ends with
    its version, such as ``info/1``.
    """
    if options.json:
        print(json.dumps({"schema": f"mograft.{schema}", **document}, indent=1))
    else:
        for line in lines:
            print(line)


_OPTIONS_OF_NAMES = {
    **{name: (name.lower(),) for name in ("Avoid", "Face", "Reach")},
    "KeepOriginal": ("keep",),
    "base": ("base", "clip", "query"),
    "group": ("group", "part"),
    "clips": ("among", "only_from", "not_from"),
    "frame_rates": ("true_rate",),
    "tags": ("tags", "only_tagged", "not_tagged"),
}
"""The options from which a parameter or constraint may come, if they have another name."""


def with_flags(text: str, options: Options, *, is_advice: bool = False) -> str:
    """Return a text in which options replace names of parameters.

    For example, ``--swap`` replaces `` `swap` `` if this option is set or in advice, and
    ``--set self_repair=false`` replaces `` `self_repair=False` ``.
    """

    def flag(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name == "groups":
            from mograft.library.files.storage import is_library  # takes long to import

            files = getattr(options, "files", ())
            is_fixed = not hasattr(options, name) or any(map(is_library, files))
            words = f"--groups {value}"
            return f"a library made by mograft index FILE -o LIB {words}" if is_fixed else words
        is_option = hasattr(options, name)
        return f"--{name} {value}" if is_option else f"--set {name}={value.lower()}"

    text = re.sub(r"`(\w+)=([^`]+)`", flag, text)
    for name, kind in (("take", "Use"), ("ban", "Ban")):
        text = re.sub(rf"`(\w+)` of {kind}\b", rf"\1 of --{name}", text)
    set_options = {name for name, value in vars(options).items() if value or is_advice}
    for name in set_options | _OPTIONS_OF_NAMES.keys():
        origins = [own for own in _OPTIONS_OF_NAMES.get(name, (name,)) if own in set_options]
        flags = " or ".join(f"--{own.replace('_', '-')}" for own in origins)
        flags = flags.replace("--query", "CLIP|FILE")  # the only one that is positional
        text = text.replace(f"`{name}`", flags or f"`{name}`")
    return text


_is_quiet: ContextVar[bool] = ContextVar("is_quiet", default=False)


def set_quiet(is_quiet: bool) -> None:  # noqa: FBT001 - the only argument
    """Set whether `print_remark` and `show_progress` print nothing, as with ``--quiet``."""
    _is_quiet.set(is_quiet)


def print_remark(text: str, *, is_result: bool = False) -> None:
    """Print a line on stderr, unless ``--quiet`` is given and it is not a result."""
    if is_result or not _is_quiet.get():
        # One write: an interrupt between two would leave the line without its end.
        sys.stderr.write(f"{text}\n")


def print_error(text: str, details: Iterable[str] = ()) -> None:
    """Print an error on stderr, after one line for each of its `details`."""
    print(*details, f"error: {text}", sep="\n", file=sys.stderr)


@contextmanager
def show_progress() -> Iterator[Callable[[str, int, int], None] | None]:
    """Yield a callback that prints progress on stderr, or None.

    The callback is None if stderr is not a terminal, or if ``--quiet`` is given.
    """
    if _is_quiet.get() or not sys.stderr.isatty():
        yield None
        return

    def show(stage: str, done: int, total: int) -> None:
        write_control(f"\r\033[K{stage} {done}/{total}")

    try:
        yield show
    finally:
        write_control("\r\033[K")


_ESCAPES = {
    code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\n\t"
}


class EscapingStream:
    r"""A text stream that writes control characters as ``\x1b``, except line ends and tabs."""

    def __init__(self, stream: IO[str]) -> None:
        self.unescaped = stream

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any attribute of the stream
        return getattr(self.unescaped, name)

    def write(self, text: str) -> int:
        """Write a text and return its length."""
        self.unescaped.write(text.translate(_ESCAPES))
        return len(text)


@contextmanager
def escape_output() -> Iterator[None]:
    """Escape control characters in all output to stdout and stderr within the ``with`` block."""
    out, err = EscapingStream(sys.stdout), EscapingStream(sys.stderr)
    with redirect_stdout(out), redirect_stderr(err):
        yield


def write_control(text: str) -> None:
    """Write a text to stderr without escaping its control characters."""
    stream = getattr(sys.stderr, "unescaped", sys.stderr)
    stream.write(text)
    stream.flush()
