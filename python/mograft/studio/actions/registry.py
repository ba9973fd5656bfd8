"""The actions of a person on a project.

Each is a function of the `Desk`, the fields of the action and the motion that it changes, if any.
It returns the new project, motion or graft, and the text of the step in the history.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mograft._util.arrays import BoolArray
from mograft.body.groups import PRESETS, JointGroups
from mograft.errors import suggest_name
from mograft.io.formats import split_address
from mograft.io.gltf.document import read_gltf_file
from mograft.studio.actions import editing, making
from mograft.studio.actions.editing import EDITS
from mograft.studio.actions.fields import Fields
from mograft.studio.desk import Desk
from mograft.studio.project import MARKS, Lock, Project, ProjectMotion
from mograft.synthesis.graft_result import Graft

Outcome = tuple[Project, str]

_MAX_NAME = 200


def run_action(desk: Desk, action: Mapping[str, Any]) -> Outcome:
    """Return the project after an action, and the text of the step.

    A preview of an edit is shown, but is no step and is not saved.
    """
    name, fields = str(action.get("action")), Fields(action)
    if name in _ACTIONS:
        return _ACTIONS[name](desk, fields)
    if name not in (*_CHANGES, *EDITS):
        hint = suggest_name(name, [*_ACTIONS, *_CHANGES, *EDITS])
        raise ValueError(f"unknown `action` {action.get('action')!r}{hint}")
    own = desk.project.motion(fields.values.get("id"))
    if name in _CHANGES:
        changed, text = _CHANGES[name](desk, fields, own)
        return desk.project.with_motion(changed), text
    graft, text = EDITS[name](desk, fields, own, desk.workshop.editable(own.record))
    if fields.flag("preview"):
        desk.preview(own.id, graft)
        return desk.project, text
    key = desk.workshop.add(graft, desk.source_names)
    return desk.project.with_motion(replace(own, record=key)), text


def _set_groups(desk: Desk, fields: Fields) -> Outcome:
    if desk.is_stored_library:
        raise ValueError("the groups of a stored library are fixed: index its files again")
    text = fields.choice("preset", PRESETS) if fields.has("preset") else fields.text("toml") + "\n"
    library = desk.opened.library
    groups = JointGroups.from_toml(text) if text not in PRESETS else None
    if library is not None:
        groups = groups or JointGroups.preset(text, library.skeleton)
        groups.resolve(library.skeleton)
    return replace(desk.project, groups=text), f"groups {text if text in PRESETS else 'by hand'}"


def _set_character(desk: Desk, fields: Fields) -> Outcome:
    path = fields.optional_text("path")
    if path is not None:
        place = (desk.folder / path).resolve()
        inputs = [Path(split_address(own.path)[0]) for own in desk.project.inputs]
        roots = [desk.folder, *inputs, *(own.parent for own in inputs)]
        if not any(place == root or place.is_relative_to(root) for root in roots):
            raise ValueError(f"`path` must be in {desk.folder} or beside an input, got {path}")
        read_gltf_file(place)  # raises an error if it is no glTF file
        path = str(place)
    text = "no character" if path is None else f"character {Path(path).name}"
    return replace(desk.project, character=path), text


def _remove(desk: Desk, fields: Fields) -> Outcome:
    removed = [desk.project.motion(own) for own in fields.items("ids", str)]
    if not removed:
        raise ValueError("`ids` must have at least one motion, got none")
    kept = tuple(own for own in desk.project.motions if own not in removed)
    text = f"remove {', '.join(map(desk.name_of, removed))}"
    return replace(desk.project, motions=kept), text


def _mark(desk: Desk, fields: Fields, own: ProjectMotion) -> tuple[ProjectMotion, str]:
    mark = fields.choice("mark", MARKS) if fields.has("mark") else None
    text = {"star": "favourite", "reject": "reject", None: "unmark"}[mark]
    return replace(own, mark=mark), f"{text} {desk.name_of(own)}"


def _keep(desk: Desk, fields: Fields, own: ProjectMotion) -> tuple[ProjectMotion, str]:
    is_kept = fields.flag("isKept")
    text = f"{'keep' if is_kept else 'do not keep'} {desk.name_of(own)} for export"
    return replace(own, is_kept=is_kept), text


def _rename(desk: Desk, fields: Fields, own: ProjectMotion) -> tuple[ProjectMotion, str]:
    name = fields.text("name").strip()
    if not 0 < len(name) <= _MAX_NAME or not name.isprintable():
        raise ValueError(f"`name` must have 1 to {_MAX_NAME} printable characters, got {name!r}")
    others = [desk.name_of(each) for each in desk.project.motions if each.id != own.id]
    if name in others:
        raise ValueError(f"`name` must differ from those of other motions, got {name!r}")
    text = f"rename {desk.name_of(own)} to {name}"
    return replace(own, record=desk.workshop.rename(own.record, name)), text


def _lock(desk: Desk, fields: Fields, own: ProjectMotion) -> tuple[ProjectMotion, str]:
    group, frames = fields.text("group"), fields.frames()
    graft = desk.workshop.graft(own.record)
    is_locked = editing.is_locked(graft, group, own.locks) | editing.select(graft, group, frames)
    others = (lock for lock in own.locks if lock.group != group)
    locks = (*others, *_locks(graft, group, is_locked))
    return replace(own, locks=locks), f"lock {editing.where(group, *frames)}"


def _unlock(desk: Desk, fields: Fields, own: ProjectMotion) -> tuple[ProjectMotion, str]:
    group, frames = fields.optional_text("group"), fields.frames()
    graft = desk.workshop.graft(own.record)
    locks: list[Lock] = []
    for name in dict.fromkeys(lock.group for lock in own.locks):
        is_locked = editing.is_locked(graft, name, own.locks)
        if group in (None, name):
            is_locked &= ~editing.select(graft, name, frames)
        locks += _locks(graft, name, is_locked)
    return replace(own, locks=tuple(locks)), f"unlock {editing.where(group, *frames)}"


def _locks(graft: Graft, group: str, is_locked: BoolArray) -> list[Lock]:
    return [Lock(group, *frames) for frames in editing.ranges_of(graft, group, is_locked)]


_ACTIONS: dict[str, Callable[[Desk, Fields], Outcome]] = {
    "set_groups": _set_groups,
    "set_character": _set_character,
    "make": making.make,
    "scenario": making.compose,
    "more_like": making.more_like,
    "remove": _remove,
}
_CHANGES: dict[str, Callable[[Desk, Fields, ProjectMotion], tuple[ProjectMotion, str]]] = {
    "mark": _mark,
    "keep": _keep,
    "rename": _rename,
    "lock": _lock,
    "unlock": _unlock,
}
"""Actions that change what the project has of a motion; `EDITS` change the motion itself."""
