"""The command line: a thin layer over the public functions.

Results go to stdout, progress and remarks to stderr. Exit codes: 0 done, 1 failed at run
time, 2 usage, 3 invalid BVH file or damaged library, 4 no donors satisfy the constraints, 130
interrupted.
"""

import argparse
import os
import sys
import warnings
from collections.abc import Sequence

from mograft import __version__
from mograft.cli import (
    candidates,
    check,
    completion,
    config,
    demo,
    doctor,
    evaluate,
    export,
    graft,
    groups,
    index,
    info,
    lib,
    plot,
    view,
)
from mograft.cli._common import say
from mograft.cli._settings import command_parsers, parse, settable
from mograft.errors import BvhError, MograftError

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name. Default: those of the process.

    Returns
    -------
    int
        The exit code.
    """
    options = parse(_parser(), arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *_, **__: say(f"warning: {message}")
        try:
            code: int = options.run(options)
            sys.stdout.flush()
        except BvhError as error:
            say(f"error: {error}")
            code = 3
        except BrokenPipeError:
            # Whoever read the output, as `head`, has had enough: that is no error to tell. The
            # interpreter would complain once more at its end, when it flushes.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        except (MograftError, MemoryError, ModuleNotFoundError, OSError, ValueError) as error:
            say(f"error: {_in_words(error)}")
            code = 1
        except KeyboardInterrupt:
            say("interrupted")
            code = 130
    return code


def _in_words(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mograft",
        description="Make new, natural motions out of captured ones by grafting body parts.",
    )
    parser.add_argument("--version", action="version", version=f"mograft {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    everything = (
        demo,
        info,
        check,
        groups,
        index,
        lib,
        candidates,
        graft,
        view,
        plot,
        export,
        evaluate,
        doctor,
        config,
        completion,
    )
    for command in everything:
        command.add(commands)
    for name, own in command_parsers(parser).items():
        own.set_defaults(command=name)
    return parser


def command_names() -> dict[str, set[str]]:
    """Return the commands with the names of their settings."""
    everything = command_parsers(_parser())
    return {name: {a.dest for a in settable(own)} for name, own in everything.items()}
