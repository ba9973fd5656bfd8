"""Actions that change one motion: its donors in ranges of frames, and its constraints."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray
from mograft._util.cancel import cancellable
from mograft._util.runs import find_runs
from mograft.errors import join_names, suggest_name
from mograft.library.library import Library
from mograft.motion.segments import Segments
from mograft.provenance.graft_change import change
from mograft.provenance.graft_edit import edit
from mograft.provenance.graft_revision import constrain, regenerate
from mograft.search.constraint_records import decode_constraint
from mograft.search.constraints import Constraint, Span, overlaps
from mograft.search.donor_constraints import Ban, KeepOriginal, Use
from mograft.studio.actions.fields import Fields
from mograft.studio.desk import Desk, find_clip
from mograft.studio.project import Lock, ProjectMotion
from mograft.synthesis.graft_result import Graft

Ranges = list[tuple[str, Span]]
Outcome = tuple[Graft, str]
Edit = Callable[[Desk, Fields, ProjectMotion, Graft], Outcome]
"""A function that returns another version of a motion, and the text of the step."""


def where(group: str | None, first: int, last: int) -> str:
    """Return the name of a range in texts."""
    return f"{group or 'all groups'}, frames {first}-{last}"


def base_segments(graft: Graft, group: str) -> Segments:
    """Return the base segments of a graft in its frames; raise ValueError for an unknown group."""
    own = [each for each in graft.substitutions if each.group == group]
    if not own:
        names = list(graft.alternatives)
        raise ValueError(
            f"`group` must be an exchanged group, one of {join_names(names)}; got "
            f"{group!r}{suggest_name(group, names)}"
        )
    return Segments(np.array([each.start for each in own]), np.array([each.stop for each in own]))


def select(graft: Graft, group: str, frames: Span) -> BoolArray:
    """Return which segments of a group are in a range; raise ValueError if none is."""
    selected = overlaps(base_segments(graft, group), frames)
    if not selected.any():
        last = graft.motion.n_frames - 1
        raise ValueError(f"`first, last` must be within 0 to {last}, got {frames[0]}-{frames[1]}")
    return selected


def is_locked(graft: Graft, group: str, locks: Sequence[Lock]) -> BoolArray:
    """Return which segments of a group are locked."""
    cut = base_segments(graft, group)
    selected = np.zeros(len(cut), bool)
    for lock in locks:
        if lock.group == group:
            selected |= overlaps(cut, lock.frames)
    return selected


def ranges_of(graft: Graft, group: str, is_selected: BoolArray) -> list[Span]:
    """Return the ranges of frames of the segments that are selected, one for each run of them."""
    cut, runs = base_segments(graft, group), find_runs(is_selected).tolist()
    return [(int(cut.start[start]), int(cut.stop[stop - 1])) for start, stop in runs]


def _refuse_locked(own: ProjectMotion, graft: Graft, group: str, frames: Span) -> None:
    """Raise ValueError if a locked segment is in a range; `group` may also be a body part."""
    for name in [group] if group in graft.alternatives else graft.alternatives:
        selected = overlaps(base_segments(graft, name), frames)
        if (selected & is_locked(graft, name, own.locks)).any():
            raise ValueError(f"{where(group, *frames)} is locked: unlock first")


def _open_ranges(own: ProjectMotion, graft: Graft, fields: Fields) -> Ranges:
    """Return the ranges of an action that are not locked; raise ValueError if there is none."""
    group, frames, found = fields.optional_text("group"), fields.frames(), Ranges()
    for name in graft.alternatives if group is None else [group]:
        is_open = select(graft, name, frames) & ~is_locked(graft, name, own.locks)
        found += [(name, each) for each in ranges_of(graft, name, is_open)]
    if not found:
        raise ValueError(f"{where(group, *frames)} is locked: unlock first")
    return found


def _take(_: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Take a part of a clip; between any frames, if it or the range is no segment."""
    group, frames = fields.text("group"), fields.frames()
    clip, donor = fields.text("clip"), (fields.integer("from", -1), fields.integer("to", -1))
    _refuse_locked(own, graft, group, frames)
    library = graft.library
    cut = library.segments[library.segments.of_clip(find_clip(library, "clip", clip))]
    are_segments = group in graft.alternatives and all(
        ((own.start == first) & (own.stop == last)).any()
        for own, (first, last) in ((cut, donor), (base_segments(graft, group), frames))
    )
    reference = (clip, *donor)
    if are_segments:
        new = edit(graft, Use(frames=frames, donor=reference, group=group))
    else:
        new = change(graft, group, frames, reference)
    text = f"{where(group, *frames)}: use {clip} {donor[0]}-{donor[1]}"
    return new, text


def _ban(_: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Ban the present donors of a range."""
    ranges = _open_ranges(own, graft, fields)
    new = edit(graft, *(Ban(frames=frames, group=group) for group, frames in ranges))
    return new, f"ban {_text(fields)}"


def _restore(_: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Restore the captured motion of a range."""
    group, frames = fields.optional_text("group"), fields.frames()
    for name in graft.alternatives if group is None else [group]:
        select(graft, name, frames)
        _refuse_locked(own, graft, name, frames)
    new = edit(graft, KeepOriginal(frames=frames, group=group))
    return new, f"restore captured {_text(fields)}"


def _change_range(_: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Take the next best part in a range between any frames."""
    group, frames = fields.text("group"), fields.frames()
    _refuse_locked(own, graft, group, frames)
    new = change(graft, group, frames)
    return new, f"change {new.changes[-1]}"


def _regenerate_range(desk: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Choose the donors of a range again."""
    ranges = _open_ranges(own, graft, fields)
    library = desk.workshop.with_variety(graft.library, fields.number("variety"))
    graft = _with_library(graft, library)
    new = regenerate(graft, ranges, graft.seed + len(graft.history) + 1)
    return new, f"choose again {_text(fields)}"


def _with_library(graft: Graft, library: Library) -> Graft:
    original = None if graft.unchanged is None else _with_library(graft.unchanged, library)
    return replace(graft, library=library, unchanged=original)


def _text(fields: Fields) -> str:
    return where(fields.optional_text("group"), *fields.frames())


def _add_constraint(desk: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Add a constraint; segments that violate it get other donors."""
    added = _decode(desk, fields)
    new = _constrained(desk, own, graft, fields, [*graft.request.constraints, added])
    return new, f"add {type(added).__name__}"


def _set_constraint(desk: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Replace a constraint."""
    constraints, added = list(graft.request.constraints), _decode(desk, fields)
    constraints[_number(fields, graft)] = added
    new = _constrained(desk, own, graft, fields, constraints)
    return new, f"move {type(added).__name__}"


def _drop_constraint(desk: Desk, fields: Fields, own: ProjectMotion, graft: Graft) -> Outcome:
    """Remove a constraint; the donors stay."""
    constraints = list(graft.request.constraints)
    dropped = constraints.pop(_number(fields, graft))
    new = _constrained(desk, own, graft, fields, constraints)
    return new, f"remove {type(dropped).__name__}"


def _constrained(
    desk: Desk, own: ProjectMotion, graft: Graft, fields: Fields, constraints: list[Constraint]
) -> Graft:
    locked = [(lock.group, lock.frames) for lock in own.locks]
    if not fields.flag("preview"):
        return constrain(graft, constraints, locked=locked)
    with cancellable(desk.is_superseded):
        return constrain(graft, constraints, locked=locked, is_quick=True)


def _decode(desk: Desk, fields: Fields) -> Constraint:
    record = fields.values.get("constraint")
    if not isinstance(record, dict):
        raise ValueError(f"`constraint` must be an object, got {record!r}")
    return decode_constraint(record, desk.decode_motion)


def _number(fields: Fields, graft: Graft) -> int:
    n = len(graft.request.constraints)
    if not n:
        raise ValueError("the motion has no constraints")
    return fields.integer("number", -1, 0, n - 1)


EDITS: dict[str, Edit] = {
    "take": _take,
    "ban": _ban,
    "restore": _restore,
    "change": _change_range,
    "regenerate": _regenerate_range,
    "add_constraint": _add_constraint,
    "set_constraint": _set_constraint,
    "drop_constraint": _drop_constraint,
}
