"""What the page shows, as JSON: the state of a session and the encodings of figures."""

from typing import TYPE_CHECKING, Any

from mograft.body.groups import PRESETS
from mograft.studio.project import ProjectMotion
from mograft.viewing.encoding import encode_figure
from mograft.viewing.scene import clip_figure, graft_figure

if TYPE_CHECKING:
    from mograft.studio.session import Session

Json = dict[str, Any]


def state(session: "Session") -> Json:
    """Return the state of a session; the caller holds its lock."""
    opened, project = session.opened, session.project
    library = opened.library
    joints, groups = [], {"base": "", "names": [], "joints": {}}
    if library is not None:
        names, parents = library.skeleton.names, library.skeleton.parents.tolist()
        joints = [{"name": own, "parent": at} for own, at in zip(names, parents, strict=True)]
        groups = {"base": library.groups.base, "names": list(library.groups.names)}
        members = {own: library.joints(own).tolist() for own in library.groups.names}
        groups["joints"] = {own: [names[j] for j in each] for own, each in members.items()}
    past, future = session.history.past, session.history.future
    return {
        "revision": session.revision,
        "name": "project",
        "file": None if session.file is None else str(session.file),
        "folder": str(session.folder),
        "undo": past[-1][0] if past else None,
        "redo": future[0][0] if future else None,
        "sources": list(opened.sources),
        "clips": list(opened.clips),
        "skeleton": {"joints": joints},
        "groups": {
            **groups,
            "presets": list(PRESETS),
            "preset": project.groups if project.groups in PRESETS else None,
        },
        "library": {
            "status": opened.status,
            "done": opened.done,
            "total": opened.total,
            "segments": 0 if library is None else len(library.segments),
            "message": opened.message,
        },
        "character": project.character,
        "options": {"distinct": project.distinct, **project.config},
        "motions": [_motion(session, own) for own in project.motions],
        "jobs": list(session.jobs.values()),
    }


def _motion(session: "Session", own: ProjectMotion) -> Json:
    record = session.workshop.records[own.record]
    measures = session.workshop.measures.get(own.record, {})
    return {
        "id": own.id,
        "name": record["name"],
        "base": record["base"],
        "seed": record["seed"],
        "mark": own.mark,
        "isKept": own.is_kept,
        "frames": record["frames"],
        "rate": 1.0 / record["frame_time"],
        "hash": own.record,
        "cost": measures.get("cost"),
        "new": measures.get("new"),
        "changed": measures.get("changed"),
        "apart": None,
        "isLoop": False,
        "locks": [lock._asdict() for lock in own.locks],
        "constraints": [
            {"number": number, "record": each}
            for number, each in enumerate(record["request"]["constraints"])
        ],
        "violations": [],
        "changes": [],
        "remarks": list(record["remarks"]),
    }


def figure(session: "Session", kind: str, name: str, since: str | None) -> Json:
    """Return the encoding of a figure."""
    if kind == "clip":
        library = session.opened.library
        if library is None or name not in library.names:
            raise ValueError(f"no clip {name!r}")
        shown = clip_figure(library, library.clips[library.names.index(name)])
        key = f"clip {name}"
    else:
        own = session.project.motion(name)
        shown, key = graft_figure(session.workshop.graft(own.record)), own.record
    return {**encode_figure(shown, is_mesh=False), "hash": key, "character": None}
