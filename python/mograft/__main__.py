"""The program ``mograft``, also as ``python -m mograft``: the command line with its signals."""

import _signal  # type: ignore[import-not-found]  # a module in C without stubs
import os
import sys

# `signal` imports `enum`, which takes milliseconds in which Ctrl-C would print a traceback.
if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, lambda *_: os._exit(130))

from mograft._util.signals import end_on_signals


def main() -> int:
    """Run the command of ``sys.argv`` and return the exit code; signals end the process."""
    end_on_signals()
    # Imported now: a signal during these imports must not print a traceback.
    from mograft.cli import main as run_command

    return run_command()


if __name__ == "__main__":
    sys.exit(main())
