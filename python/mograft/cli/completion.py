"""``mograft completion``: shell completion of commands, options and file names."""

import argparse

from mograft.cli.arguments import Command, positional
from mograft.cli.parser import build_parsers

_SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    try:
        import shtab
    except ImportError as error:
        raise ModuleNotFoundError(
            "completion needs shtab: pip install 'mograft[completion]'", name="shtab"
        ) from error
    parsers = build_parsers(options.commands, path_completion=shtab.FILE)
    print(shtab.complete(parsers[()], options.shell))
    return 0


COMMAND = Command(
    name="completion",
    help="print a script for shell completion of commands, options and files",
    description="Print a completion script for a shell. bash: eval "
    '"$(mograft completion bash)" in ~/.bashrc; zsh: save it as _mograft in a folder of $fpath; '
    "fish: save it as ~/.config/fish/completions/mograft.fish. Needs the extra completion.",
    run=run,
    arguments=(positional("shell", choices=_SHELLS, help="shell for which the script is written"),),
)
