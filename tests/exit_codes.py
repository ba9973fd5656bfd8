"""Exit codes of the command line."""

from mograft.cli import main


def exit_code(words):
    """Return the exit code of ``mograft``, also of mistakes in the command line."""
    try:
        return main(words)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 1
