"""The command line: a thin layer over the public functions.

Results go to stdout, progress and remarks to stderr. Exit codes: 0 done, 1 failed at run
time, 2 usage, 3 invalid motion file or damaged library, 4 no donor sequence satisfies the
constraints, 130 interrupted. `mograft.__main__` handles signals of the program.
"""

import errno
import importlib
import os
import sys
import warnings
from collections.abc import Sequence

from mograft import FormatError, MograftError, ProvenanceError
from mograft.cli.output import escape_output, print_error, print_remark, set_quiet, with_flags
from mograft.cli.syntax.arguments import Command, Options, UsageError
from mograft.cli.syntax.parser import parse
from mograft.errors import suggest_path

__all__ = ["main"]

_BEYOND_RANGE = (
    "the input has numbers that are too large, so that the result may be wrong: find them with "
    "mograft lib verify LIBRARY or mograft check FILE"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command in `arguments` (default: ``sys.argv[1:]``) and return the exit code."""
    # NumPy reads these when it is imported. The matrices are small, so BLAS threads of this
    # process and of its workers would mostly wait for each other.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    shown: set[str] = set()

    def show_once(message: Warning | str, *_: object, **__: object) -> None:
        # NumPy's warnings tell a user nothing; sound motions cause none.
        text = _BEYOND_RANGE if isinstance(message, RuntimeWarning) else str(message)
        if text not in shown:
            shown.add(text)
            print_remark(f"warning: {with_flags(text, options)}")

    with escape_output(), warnings.catch_warnings():
        command, options, parser = parse(arguments)
        set_quiet(options.quiet)
        warnings.simplefilter("always")
        # What an interrupted command leaves open is closed with the process.
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.showwarning = show_once
        try:
            return _run(command, options)
        except UsageError as error:
            parser.error(str(error))


def _run(command: Command, options: Options) -> int:
    """Run a command; print its error and return the exit code."""
    module, _, function = command.run.partition(":")
    try:
        # Only the module of this command is imported: `mograft --help` needs no NumPy.
        run = getattr(importlib.import_module(f"mograft.cli.actions.{module}"), function)
        if numpy := sys.modules.get("numpy"):
            # OpenBLAS allocates its work memory now: it ends the process if that fails later.
            numpy.linalg.inv(numpy.eye(4))
        code: int = run(options)
        sys.stdout.flush()
    except (FormatError, ProvenanceError) as error:
        print_error(str(error))
        return 3
    except BrokenPipeError:
        # The reader, such as `head`, has closed the pipe, which needs no message. The
        # interpreter flushes stdout once more when it ends; that must not fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (ImportError, MemoryError, MograftError, OSError, ValueError) as error:
        text = str(error)
        if isinstance(error, OSError) and error.filename and error.strerror:
            name = os.fsdecode(error.filename)
            text = f"{name}: {error.strerror}"
            if error.errno == errno.ENOENT:
                text += suggest_path(name)
            elif error.strerror == os.strerror(errno.EISDIR):  # of a file that is read
                from mograft.cli.files import describe_folder  # takes long to import

                text = f"{name} {describe_folder(name)}"
        elif isinstance(error, MemoryError):
            text = f"out of memory: {text}" if text else "out of memory"
        elif type(error) is ValueError:
            text = with_flags(text, options)
        print_error(text)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return code
