"""The command line: a thin layer over the public functions.

Results go to stdout, progress and remarks to stderr. Exit codes: 0 done, 1 failed at run
time, 2 usage, 3 invalid BVH file or damaged library, 4 no donor sequence satisfies the
constraints, 130 interrupted.
"""

import os
import sys
import warnings
from collections.abc import Sequence

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
from mograft.cli.output import print_remark
from mograft.cli.parser import parse
from mograft.errors import BvhError, MograftError

__all__ = ["COMMANDS", "main"]

COMMANDS = (
    demo.COMMAND,
    info.COMMAND,
    check.COMMAND,
    groups.COMMAND,
    index.COMMAND,
    lib.COMMAND,
    candidates.COMMAND,
    graft.COMMAND,
    view.COMMAND,
    plot.COMMAND,
    export.COMMAND,
    evaluate.COMMAND,
    doctor.COMMAND,
    config.COMMAND,
    completion.COMMAND,
)
"""All commands, in the order of ``mograft --help``."""


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
    options = parse(COMMANDS, arguments)
    # NumPy reads these when it is imported. The matrices are small, so BLAS threads of this
    # process and of its workers would mostly wait for each other.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *_, **__: print_remark(f"warning: {message}")
        try:
            code: int = options.run(options)
            sys.stdout.flush()
        except BvhError as error:
            print_remark(f"error: {error}")
            code = 3
        except BrokenPipeError:
            # The reader, such as `head`, has closed the pipe, which needs no message. The
            # interpreter flushes stdout once more when it ends; that must not fail again.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        except (MograftError, MemoryError, ModuleNotFoundError, OSError, ValueError) as error:
            print_remark(f"error: {_message(error)}")
            code = 1
        except KeyboardInterrupt:
            print_remark("interrupted")
            code = 130
    return code


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)
