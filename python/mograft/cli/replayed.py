"""``mograft graft --from``: a graft made again from its provenance, and edited."""

import argparse
import shlex
from dataclasses import replace
from pathlib import Path

from mograft.cli.arguments import Argument
from mograft.cli.constraints import read_segment_constraints
from mograft.cli.files import check_writable, library_folder
from mograft.library.library import Library
from mograft.synthesis.graft_files import GRAFT_ENDINGS
from mograft.synthesis.graft_record import read_record
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.record_library import find_whole_library
from mograft.synthesis.replay import replay

_EDITS = ("take", "ban", "keep", "reroll")
_ALLOWED = (*_EDITS, "files", "from", "output", "report", "measure", "json", "force")
"""Arguments that may be given with ``--from``; the provenance sets all others."""

_ALLOWED_WITH_EDITS = (*_ALLOWED, "seed", "best_effort")


def is_edit(options: argparse.Namespace) -> bool:
    """Return whether options change segments of the graft of ``--from``."""
    return any(getattr(options, name) for name in _EDITS)


def check_replay_options(options: argparse.Namespace) -> None:
    """End with a usage error if an option is given that the provenance of ``--from`` sets."""
    allowed = _ALLOWED_WITH_EDITS if is_edit(options) else _ALLOWED
    for item in options.command.arguments:
        for argument in (item,) if isinstance(item, Argument) else item.arguments:
            name = argument.dest
            is_set = getattr(options, name) not in (argument.default, None)
            if is_set and name not in options.origins and name not in allowed:
                options.usage_error(f"{argument.flags[-1]} cannot be combined with --from")


def replay_graft(options: argparse.Namespace) -> tuple[Graft, Path]:
    """Return the graft of ``--from`` with the edits, and the path to write it to."""
    check_replay_options(options)
    source = Path(getattr(options, "from"))
    record = read_record(source)
    path: Path = options.output
    if path.suffix.lower() != ".bvh":
        path = path / f"{record.name}.bvh"
    check_writable([path.with_suffix(ending) for ending in GRAFT_ENDINGS], force=options.force)
    folder = library_folder(options)
    library = None if folder is None else Library.open(folder)
    sources = options.files if library is None else ()
    if not is_edit(options):
        return replay(source, library, sources=sources), path
    if library is None:
        library = find_whole_library(record, sources)
    return _edit(replay(source, library, sources=sources), options), path


def _edit(graft: Graft, options: argparse.Namespace) -> Graft:
    """Return a graft with the edits that the options describe."""
    rate = graft.base.rate
    edited = graft.replace(
        *read_segment_constraints(options, rate),
        reroll=[value.segment(rate) for value in options.reroll],
        seed=options.seed or None,  # 0 if the option is not given
    )
    commands = (*graft.request.edit_commands, shlex.join(options.words))
    return replace(edited, request=replace(edited.request, edit_commands=commands))
