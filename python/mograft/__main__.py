"""The program ``mograft``, also as ``python -m mograft``: the command line with its signals."""

import _signal  # type: ignore[import-not-found]  # a module in C without stubs
import os
import sys

# `signal` imports `enum`, which takes milliseconds in which a signal would end the process in
# another way. A worker process imports this module, too, and must print nothing.
if "multiprocessing" not in sys.modules:
    for number, line in ((_signal.SIGINT, b"interrupted\n"), (_signal.SIGTERM, b"terminated\n")):
        if _signal.getsignal(number) in (_signal.SIG_DFL, _signal.default_int_handler):
            _signal.signal(number, lambda n, _, line=line: (os.write(2, line), os._exit(128 + n)))

from mograft._util.signals import end_on_signals, ignore_signals


def main() -> int:
    """Run the command of ``sys.argv`` and return the exit code; signals end the process."""
    end_on_signals()
    # Imported now: a signal during these imports must not print a traceback.
    from mograft.cli import main as run_command

    try:
        return run_command()
    finally:
        ignore_signals()


if __name__ == "__main__":
    sys.exit(main())
