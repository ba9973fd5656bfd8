"""``mograft completion``: shell completion of commands, options and file names."""

import argparse

from mograft.cli.syntax.parser import build_parsers


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    try:
        import shtab
    except ImportError as error:
        raise ImportError("completion needs shtab: pip install 'mograft[completion]'") from error
    parsers = build_parsers(options.commands, path_completion=shtab.FILE)
    print(shtab.complete(parsers[()], options.shell))
    return 0
