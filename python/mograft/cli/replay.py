"""``mograft graft --from``: a graft made again from its provenance, and edited."""

import shlex
from dataclasses import replace
from pathlib import Path

from mograft.cli.constraints import read_segment_constraints
from mograft.cli.files import check_writable, library_folder
from mograft.cli.graft_files import graft_files
from mograft.cli.output import print_remark
from mograft.cli.syntax.arguments import UsageError, arguments_of
from mograft.cli.syntax.options import GraftOptions
from mograft.library.library import Library
from mograft.provenance.graft_edit import describe_changes, edit
from mograft.provenance.graft_record import find_whole_library, read_record
from mograft.provenance.replay import replay
from mograft.provenance.writing import MOTION_SUFFIXES
from mograft.synthesis.graft_result import Graft

_EDITS = ("take", "ban", "keep", "reroll")
_OUTPUTS = ("output", "report", "measure", "digits", "json", "force", "quiet", "verbose")
_ALLOWED = (*_EDITS, *_OUTPUTS, "files", "from_")
"""Arguments that may be given with ``--from``; the provenance sets all others."""

_ALLOWED_WITH_EDITS = (*_ALLOWED, "seed", "best_effort")


def is_edit(options: GraftOptions) -> bool:
    """Return whether options change segments of the graft of ``--from``."""
    return any(getattr(options, name) for name in _EDITS)


def check_replay_options(options: GraftOptions) -> None:
    """Raise a UsageError if the command line has an option that ``--from`` determines."""
    allowed = _ALLOWED_WITH_EDITS if is_edit(options) else _ALLOWED
    for argument in arguments_of(options):
        name = argument.dest
        is_set = getattr(options, name) not in (argument.default, None)
        if is_set and name not in options.origins and name not in allowed:
            raise UsageError(f"--{argument.name} cannot be combined with --from")


def replay_graft(options: GraftOptions) -> tuple[Graft, Path, int | None]:
    """Return the graft of ``--from`` with the edits, the path to write it to, and ``digits``."""
    check_replay_options(options)
    source = Path(options.from_ or "")
    record = read_record(source)
    path = options.output
    if path.suffix.lower() not in MOTION_SUFFIXES:
        path = path / f"{record.name}.bvh"
    check_writable(graft_files([path]), force=options.force)
    digits = options.digits if options.given("digits") else record.digits
    folder = library_folder(options.files)
    library = None if folder is None else Library.open(folder)
    sources = options.files if library is None else ()
    if not is_edit(options):
        return replay(source, library, sources=sources), path, digits
    if library is None:
        library = find_whole_library(record, sources)
    return _edit(replay(source, library, sources=sources), options), path, digits


def _edit(graft: Graft, options: GraftOptions) -> Graft:
    """Return a graft with the edits that the options describe."""
    rate = graft.base.rate
    edited = edit(
        graft,
        *read_segment_constraints(options, rate),
        reroll=[own.resolve_span(rate) or own.number or 0 for own in options.reroll],
        seed=options.seed,
    )
    print_remark("\n".join(describe_changes(graft, edited)))
    commands = (*graft.request.edit_commands, shlex.join(options.words))
    return replace(edited, request=replace(edited.request, edit_commands=commands))
