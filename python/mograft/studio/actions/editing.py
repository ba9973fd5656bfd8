"""Actions that change one motion: its donors in ranges of frames, and its constraints."""

from collections.abc import Sequence
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
from mograft.studio.desk import Desk
from mograft.studio.project import Lock, Project, ProjectMotion
from mograft.synthesis.graft_result import Graft

Ranges = list[tuple[str, Span]]


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


def check_range(graft: Graft, group: str, frames: Span) -> None:
    """Raise ValueError unless a range of frames of a group exists."""
    if not overlaps(base_segments(graft, group), frames).any():
        last = graft.motion.n_frames - 1
        raise ValueError(f"`first, last` must be within 0 to {last}, got {frames[0]}-{frames[1]}")


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


def _target(desk: Desk, fields: Fields) -> tuple[ProjectMotion, Graft]:
    own = desk.project.motion(fields.values.get("id"))
    return own, desk.workshop.editable(own.record)


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
        check_range(graft, name, frames)
        is_in_range = overlaps(base_segments(graft, name), frames)
        is_open = is_in_range & ~is_locked(graft, name, own.locks)
        found += [(name, each) for each in ranges_of(graft, name, is_open)]
    if not found:
        raise ValueError(f"{where(group, *frames)} is locked: unlock first")
    return found


def _revised(desk: Desk, own: ProjectMotion, graft: Graft) -> Project:
    """Return the project with another version of a motion."""
    key = desk.workshop.add(graft, desk.source_names)
    return desk.project.with_motion(replace(own, record=key))


def take(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Take a part of a clip; between any frames, if it or the range is no segment."""
    own, graft = _target(desk, fields)
    group, frames = fields.text("group"), fields.frames()
    clip, donor = fields.text("clip"), (fields.integer("from", -1), fields.integer("to", -1))
    _refuse_locked(own, graft, group, frames)
    library = graft.library
    if clip not in library.names:
        raise ValueError(f"`clip` must be a clip, got {clip!r}{suggest_name(clip, library.names)}")
    cut = library.segments[library.segments.of_clip(library.names.index(clip))]
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
    return _revised(desk, own, new), text


def ban(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Ban the present donors of a range."""
    own, graft = _target(desk, fields)
    ranges = _open_ranges(own, graft, fields)
    new = edit(graft, *(Ban(frames=frames, group=group) for group, frames in ranges))
    return _revised(desk, own, new), f"ban {_text(fields)}"


def restore(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Restore the captured motion of a range."""
    own, graft = _target(desk, fields)
    group, frames = fields.optional_text("group"), fields.frames()
    for name in graft.alternatives if group is None else [group]:
        check_range(graft, name, frames)
        _refuse_locked(own, graft, name, frames)
    new = edit(graft, KeepOriginal(frames=frames, group=group))
    return _revised(desk, own, new), f"restore captured {_text(fields)}"


def change_range(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Take the next best part in a range between any frames."""
    own, graft = _target(desk, fields)
    group, frames = fields.text("group"), fields.frames()
    _refuse_locked(own, graft, group, frames)
    new = change(graft, group, frames)
    return _revised(desk, own, new), f"change {new.changes[-1]}"


def regenerate_range(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Choose the donors of a range again."""
    own, graft = _target(desk, fields)
    ranges = _open_ranges(own, graft, fields)
    variety = fields.number("variety")
    if variety is not None:
        graft = _with_library(graft, desk.workshop.with_variety(graft.library, variety))
    new = regenerate(graft, ranges, graft.seed + len(graft.history) + 1)
    return _revised(desk, own, new), f"choose again {_text(fields)}"


def _with_library(graft: Graft, library: Library) -> Graft:
    original = None if graft.unchanged is None else _with_library(graft.unchanged, library)
    return replace(graft, library=library, unchanged=original)


def _text(fields: Fields) -> str:
    return where(fields.optional_text("group"), *fields.frames())


def add_constraint(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Add a constraint; segments that violate it get other donors."""
    own, graft = _target(desk, fields)
    added = _decode(desk, fields)
    new = _constrained(desk, own, graft, fields, [*graft.request.constraints, added])
    return _revised(desk, own, new), f"add {type(added).__name__}"


def set_constraint(desk: Desk, fields: Fields) -> tuple[Project, str | None]:
    """Replace a constraint; a preview is shown, but is no step and is not saved."""
    own, graft = _target(desk, fields)
    constraints, added = list(graft.request.constraints), _decode(desk, fields)
    constraints[_number(fields, graft)] = added
    new = _constrained(desk, own, graft, fields, constraints)
    if fields.flag("preview"):
        desk.preview(own.id, new)
        return desk.project, None
    return _revised(desk, own, new), f"move {type(added).__name__}"


def drop_constraint(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Remove a constraint; the donors stay."""
    own, graft = _target(desk, fields)
    constraints = list(graft.request.constraints)
    dropped = constraints.pop(_number(fields, graft))
    new = _constrained(desk, own, graft, fields, constraints)
    return _revised(desk, own, new), f"remove {type(dropped).__name__}"


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
