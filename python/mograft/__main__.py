"""The program ``mograft``, also as ``python -m mograft``: the command line with its signals."""

import sys

from mograft._util.signals import end_on_signals


def main() -> int:
    """Run the command of ``sys.argv`` and return the exit code; signals end the process."""
    end_on_signals()
    # Imported now: a signal during these imports must not print a traceback.
    from mograft.cli import main as run_command

    return run_command()


if __name__ == "__main__":
    sys.exit(main())
