"""``mograft graft --from``: a graft made again from its provenance."""

import argparse
from pathlib import Path

from mograft.cli.arguments import Argument
from mograft.cli.files import check_writable, library_folder
from mograft.library.library import Library
from mograft.synthesis.graft_files import GRAFT_ENDINGS
from mograft.synthesis.graft_record import read_record
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.replay import replay

_OUTPUT_OPTIONS = ("files", "from", "output", "report", "measure", "json", "force")
"""Arguments that may be given with ``--from``; the provenance sets all others."""


def check_replay_options(options: argparse.Namespace) -> None:
    """End with a usage error if an option is given that the provenance of ``--from`` sets."""
    for item in options.command.arguments:
        for argument in (item,) if isinstance(item, Argument) else item.arguments:
            name = argument.dest
            is_set = getattr(options, name) not in (argument.default, None)
            if is_set and name not in options.origins and name not in _OUTPUT_OPTIONS:
                options.usage_error(f"{argument.flags[-1]} cannot be combined with --from")


def replay_graft(options: argparse.Namespace) -> tuple[Graft, Path]:
    """Return the graft of ``--from``, and the path to write it to."""
    check_replay_options(options)
    source = Path(getattr(options, "from"))
    path: Path = options.output
    if path.suffix.lower() != ".bvh":
        path = path / f"{read_record(source).name}.bvh"
    check_writable([path.with_suffix(ending) for ending in GRAFT_ENDINGS], force=options.force)
    folder = library_folder(options)
    library = None if folder is None else Library.open(folder)
    sources = options.files if library is None else ()
    return replay(source, library, sources=sources), path
