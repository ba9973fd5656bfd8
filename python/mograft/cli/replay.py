"""``mograft graft --from``: a graft made again from its provenance, and edited."""

import shlex
from dataclasses import replace
from pathlib import Path

from mograft._util.runs import find_runs
from mograft.cli.constraints import read_segment_constraints
from mograft.cli.files import check_writable, library_folder
from mograft.cli.graft_files import graft_files
from mograft.cli.output import print_remark
from mograft.cli.syntax.arguments import UsageError, arguments_of
from mograft.cli.syntax.frames import SegmentValue
from mograft.cli.syntax.graft_options import GraftOptions
from mograft.errors import join_names
from mograft.io.bvh.decimals import check_digits
from mograft.library.library import Library
from mograft.provenance.graft_edit import edit
from mograft.provenance.graft_files import MOTION_SUFFIXES
from mograft.provenance.graft_record import GraftRecord, read_record
from mograft.provenance.record_library import find_whole_library
from mograft.provenance.replay import replay
from mograft.synthesis.graft_result import Graft

_EDITS = ("take", "ban", "keep", "reroll")
_OUTPUTS = ("output", "report", "measure", "digits", "json", "force", "quiet", "verbose")
_ALLOWED = (*_EDITS, *_OUTPUTS, "files", "from_")
"""Arguments that may be given with ``--from``; the provenance sets all others."""

_MAX_CHANGES = 20
"""Replaced donors that are printed."""

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
    digits = options.digits if options.given("digits") else _recorded_digits(record)
    folder = library_folder(options.files)
    library = None if folder is None else Library.open(folder)
    sources = options.files if library is None else ()
    if not is_edit(options):
        return replay(source, library, sources=sources), path, digits
    if library is None:
        library = find_whole_library(record, sources)
    return _edit(replay(source, library, sources=sources), options), path, digits


def _recorded_digits(record: GraftRecord) -> int | None:
    """Return ``digits`` of a provenance, or None: older documents do not have this key."""
    digits = record.document.get("digits")
    try:
        return None if digits is None else check_digits(digits)
    except ValueError as error:
        raise record.error(f"damaged: {error}") from None


def _edit(graft: Graft, options: GraftOptions) -> Graft:
    """Return a graft with the edits that the options describe."""
    rate = graft.base.rate
    edited = edit(
        graft,
        *read_segment_constraints(options, rate),
        reroll=[_reroll_segment(value, rate) for value in options.reroll],
        seed=options.seed,
    )
    print_remark("\n".join(_describe_changes(graft, edited)))
    commands = (*graft.request.edit_commands, shlex.join(options.words))
    return replace(edited, request=replace(edited.request, edit_commands=commands))


def _reroll_segment(value: SegmentValue, rate: float) -> int | tuple[int, int]:
    span = value.resolve_span(rate)
    if span is not None:
        return span
    assert value.number is not None
    return value.number


def _describe_changes(graft: Graft, edited: Graft) -> list[str]:
    """Return a line for each replaced donor, and a line with the ranges of changed frames."""
    lines = []
    for group in graft.alternatives:
        pairs = zip(graft.substitutions, edited.substitutions, strict=True)
        numbered = enumerate(pair for pair in pairs if pair[0].group == group)
        lines += [
            f"segment {number}, frames {old.start}-{old.stop}, {group}: "
            f"{new.clip} {new.donor_start}-{new.donor_stop} instead of "
            f"{old.clip} {old.donor_start}-{old.donor_stop}"
            for number, (old, new) in numbered
            if old.donor != new.donor
        ]
    if len(lines) > _MAX_CHANGES:
        lines = [*lines[:_MAX_CHANGES], f"and {len(lines) - _MAX_CHANGES} more segments"]
    is_new = (graft.motion.rotations != edited.motion.rotations).any(axis=(1, 2))
    is_new |= (graft.motion.positions != edited.motion.positions).any(axis=(1, 2))
    ranges = [f"{start}-{stop - 1}" for start, stop in find_runs(is_new).tolist()]
    return [*lines, f"new frames: {join_names(ranges) or 'none'}; all others are unchanged"]
