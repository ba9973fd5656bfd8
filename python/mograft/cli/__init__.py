"""The command line: a thin layer over the public functions.

Results go to stdout, progress and remarks to stderr. Exit codes: 0 done, 1 failed at run
time, 2 usage, 3 invalid motion file or damaged library, 4 no donor sequence satisfies the
constraints, 130 interrupted. `mograft.__main__` handles signals of the program.
"""

import argparse
import importlib
import os
import sys
import warnings
from collections.abc import Sequence

from mograft.cli.output import print_error, print_remark, set_quiet
from mograft.cli.syntax.command_table import COMMANDS
from mograft.cli.syntax.parser import parse
from mograft.cli.terminal import escape_output
from mograft.errors import FormatError, MograftError, ProvenanceError

__all__ = ["COMMANDS", "main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command in `arguments` (default: ``sys.argv[1:]``) and return the exit code."""
    with escape_output():
        return _run(parse(COMMANDS, arguments))


def _run(options: argparse.Namespace) -> int:
    """Run a command and return the exit code."""
    # NumPy reads these when it is imported. The matrices are small, so BLAS threads of this
    # process and of its workers would mostly wait for each other.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    set_quiet(options.quiet)
    shown: set[str] = set()

    def show_once(message: Warning | str, *_: object, **__: object) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            print_remark(f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("always")
        # What an interrupted command leaves open is closed with the process.
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.showwarning = show_once
        try:
            # Only the module of this command is imported: `mograft --help` needs no NumPy.
            module = importlib.import_module(f"mograft.cli.actions.{options.command.name}")
            if "numpy" in sys.modules:
                _allocate_blas_buffer()
            code: int = getattr(module, options.function)(options)
            sys.stdout.flush()
        except (FormatError, ProvenanceError) as error:
            print_error(str(error))
            code = 3
        except BrokenPipeError:
            # The reader, such as `head`, has closed the pipe, which needs no message. The
            # interpreter flushes stdout once more when it ends; that must not fail again.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        except (ImportError, MemoryError, MograftError, OSError, ValueError) as error:
            text = str(error)
            if isinstance(error, OSError) and error.filename and error.strerror:
                text = f"{error.filename}: {error.strerror}"
            elif isinstance(error, MemoryError):
                text = f"out of memory: {text}" if text else "out of memory"
            print_error(text)
            code = 1
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            code = 130
    return code


def _allocate_blas_buffer() -> None:
    """Make OpenBLAS allocate its work memory, 32 MB of address space, before the command runs.

    Otherwise OpenBLAS allocates it at the first call that needs it. It ends the process if the
    command has used up the memory by then.
    """
    import numpy as np

    np.linalg.inv(np.eye(4))
