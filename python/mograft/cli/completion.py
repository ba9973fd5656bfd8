"""``mograft completion``: have a shell complete commands, options and files."""

import argparse
from typing import Any

SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")
_PATHS = {"base", "file", "files", "groups", "library", "output", "tags"}


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    completion = commands.add_parser(
        "completion",
        help="a script that has the shell complete commands, options and files",
        description='Print a script for the shell to read. bash: eval "$(mograft completion '
        'bash)" in ~/.bashrc; zsh: save it as _mograft in a folder of $fpath; fish: save it as '
        "~/.config/fish/completions/mograft.fish. Needs the extra completion.",
    )
    completion.add_argument("shell", choices=SHELLS)
    completion.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    try:
        import shtab
    except ImportError as error:
        raise ModuleNotFoundError(
            "completion needs shtab: pip install 'mograft[completion]'", name="shtab"
        ) from error
    from mograft.cli import _parser

    parser = _parser()
    _name_files(parser, shtab.FILE)
    print(shtab.complete(parser, options.shell))
    return 0


def _name_files(parser: argparse.ArgumentParser, files: object) -> None:
    """Tell which arguments are paths."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _name_files(command, files)
        elif action.dest in _PATHS and action.choices is None:
            action.complete = files  # type: ignore[attr-defined] # read by shtab
