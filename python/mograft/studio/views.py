"""What the page shows, as JSON: the state of a session and the encodings of figures."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mograft.body.groups import PRESETS
from mograft.config import variety_of_scale
from mograft.library.library import Library
from mograft.studio.project import ProjectMotion, Record
from mograft.synthesis.graft_result import Graft
from mograft.viewing.character import find_characters
from mograft.viewing.encoding import encode_change, encode_figure, encode_window
from mograft.viewing.scene import clip_figure, graft_figure, motion_figure

if TYPE_CHECKING:
    from mograft.studio.session import Session

Json = dict[str, Any]
_MAX_WINDOW = 4000  # frames


def state(session: "Session") -> Json:
    """Return the state of a session; the caller holds its lock."""
    opened, project, file = session.opened, session.project, session.file
    library = opened.library
    past, future = session.history.past, session.history.future
    return {
        "revision": session.revision,
        "name": ""
        if file is None
        else file.path.name.removesuffix(".json").removesuffix(".project"),
        "file": None if file is None else str(file.path),
        "folder": str(session.folder),
        "undo": past[-1][0] if past else None,
        "redo": future[0][0] if future else None,
        "sources": list(opened.sources),
        "clips": list(opened.clips),
        **_skeleton(library),
        "groups": {
            **_groups(library),
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
        "options": _options(session),
        "motions": [_motion(session, own) for own in project.motions],
        "jobs": list(session.jobs.values()),
    }


def _skeleton(library: Library | None) -> Json:
    joints = []
    if library is not None:
        pairs = zip(library.skeleton.names, library.skeleton.parents.tolist(), strict=True)
        joints = [{"name": name, "parent": parent} for name, parent in pairs]
    return {"skeleton": {"joints": joints}}


def _groups(library: Library | None) -> Json:
    if library is None:
        return {"base": "", "names": [], "joints": {}}
    names = library.skeleton.names
    joints = {own: [names[j] for j in library.joints(own)] for own in library.groups.names}
    return {"base": library.groups.base, "names": list(joints), "joints": joints}


def _options(session: "Session") -> Json:
    config, library = dict(session.project.config), session.opened.library
    known = config.get("sigma_scale", 0.75 if library is None else library.config.sigma_scale)
    variety = round(min(max(variety_of_scale(known), 0.0), 1.0), 3)
    return {"distinct": session.project.distinct, "variety": variety, **config}


def _motion(session: "Session", own: ProjectMotion) -> Json:
    record = session.workshop.records[own.record]
    measures = session.workshop.measures.get(own.record, {})
    kept = [each for each in session.project.motions if each.is_kept and each.id != own.id]
    angles = [session.workshop.angle(own.record, each.record) for each in kept]
    known = [float(np.degrees(angle)) for angle in angles if angle is not None]
    n_locked = len(own.locks)
    remarks = [*map(str, record["remarks"])]
    if record["violations"]:
        unlock = f"unlock some of the {n_locked} locked ranges, " if n_locked else ""
        remarks.append(
            "no donor satisfies the constraints: move the obstacle or target, allow a larger "
            f"tolerance, {unlock}raise the variety or add clips"
        )
    return {
        "id": own.id,
        "name": record["name"],
        "base": record["base"],
        "seed": record["seed"],
        "mark": own.mark,
        "isKept": own.is_kept,
        "frames": record["frames"],
        "rate": round(1.0 / record["frame_time"], 6),
        "hash": own.record,
        "cost": measures.get("cost"),
        "new": measures.get("new"),
        "changed": measures.get("changed"),
        "apart": round(min(known), 2) if known else None,
        "isLoop": measures.get("isLoop", False),
        "isReady": bool(measures),
        "isComposed": record["scenario"] is not None,
        "locks": [lock._asdict() for lock in own.locks],
        "constraints": [
            {"number": number, "record": each, "shape": measures.get("shapes", {}).get(number)}
            for number, each in enumerate(record["request"]["constraints"])
            if each.get("weight") != 0
        ],
        "violations": [_violation(each) for each in record["violations"]],
        "changes": [_change(each) for each in record["changes"]],
        "remarks": remarks,
    }


def _violation(record: Record) -> Json:
    first, last = record["frames"]
    return {
        "group": None,
        "number": record["number"],
        "first": first,
        "last": last,
        "joint": record["joint"],
        "text": record["message"],
    }


def _change(record: Record) -> str:
    (first, last), (start, stop) = record["frames"], record["clip_frames"]
    part = record["part"] or record["group"]
    return f"{part}, frames {first}-{last}: {record['clip']} {start}-{stop}"


def preview(session: "Session", key: str) -> Json:
    """Return the result of an action that shows a preview of a motion."""
    name, graft = session.previews[key]
    violations = [
        {
            "group": None,
            "number": None,
            "first": own.frames[0],
            "last": own.frames[1],
            "joint": own.joint,
            "text": own.message,
        }
        for own in graft.violations
    ]
    return {
        "revision": session.revision,
        "motions": [key],
        "message": "",
        "hash": name,
        "violations": violations,
    }


def figure(session: "Session", kind: str, name: str, since: str | None) -> Json:
    """Return the encoding of a figure."""
    if kind == "clip":
        library = session.ready_library()
        if name not in library.names:
            raise ValueError(f"`name` must be that of a clip, got {name!r}")
        shown = clip_figure(library, library.clips[library.names.index(name)])
        return _encoded(session, shown, f"clip-{name}-{shown.motion.n_frames}")
    if kind not in ("motion", "base"):
        raise ValueError(f"`kind` must be motion, base or clip, got {kind!r}")
    own = session.project.motion(name)
    key, graft = session.previews.get(own.id) or (own.record, session.workshop.graft(own.record))
    if kind == "base":
        if not graft.scenario:
            return figure(session, "clip", graft.base.name, since)
        return _encoded(session, motion_figure(graft.base, graft.library), f"base-{key}")
    old = None if since is None else session.workshop.find(since)
    patch = None if old is None else _patch(session, old, graft)
    if patch is not None:
        return {**patch, "hash": key}
    return _encoded(session, graft_figure(graft), key)


def _encoded(session: "Session", shown: Any, key: str) -> Json:  # noqa: ANN401 - a Figure
    mesh = _find_character(session)
    is_worn = mesh is not None and mesh[0] == shown.motion.skeleton.names
    encoded = encode_figure(shown, is_mesh=is_worn)
    return {**encoded, "hash": key, "character": 0 if is_worn else None}


def _patch(session: "Session", old: Graft, new: Graft) -> Json | None:
    mesh = _find_character(session)
    is_worn = mesh is not None and mesh[0] == new.motion.skeleton.names
    return encode_change(old.motion, graft_figure(new), is_mesh=is_worn)


def character(session: "Session") -> Json | None:
    """Return the mesh of the figures; None if there is none."""
    found = _find_character(session)
    return None if found is None else found[1]


def _find_character(session: "Session") -> tuple[tuple[str, ...], Json] | None:
    """Return the joints of the mesh of the figures, and the mesh."""
    library, given = session.opened.library, session.project.character
    if library is None or not library.entries:
        return None
    files = [own.source_file for own in library.entries]
    paths = [Path(own.path) for own in files if own is not None]
    path = Path(given) if given else next((own for own in paths if own.suffix in _MESHES), None)
    key = None if path is None else (path, path.stat().st_mtime_ns if path.exists() else 0)
    if key is None:
        return None
    if key not in session.characters:
        skeleton = library.skeleton
        clips = zip(files, range(len(files)), strict=True)
        own = [index for file, index in clips if file is not None and Path(file.path) == path]
        if own:
            skeleton = library.clips[own[0]].skeleton
        found, _, notes = find_characters([(path, skeleton)], None)
        session.characters[key] = (skeleton.names, found[0]) if found else None
        for note in notes:
            session.note(note)
    result: tuple[tuple[str, ...], Json] | None = session.characters[key]
    return result


_MESHES = (".glb", ".gltf")


def window(session: "Session", clip: str, first: int, last: int) -> Json:
    """Return the poses of a part of a clip, both frames included."""
    library = session.ready_library()
    if clip not in library.names:
        raise ValueError(f"`clip` must be that of a clip, got {clip!r}")
    motion = library.clips[library.names.index(clip)]
    if not 0 <= first <= last < motion.n_frames or last - first >= _MAX_WINDOW:
        raise ValueError(
            f"`first` and `last` must be within 0 to {motion.n_frames - 1}, at most {_MAX_WINDOW} "
            f"frames, got {first}-{last}"
        )
    return {"clip": clip, **encode_window(motion, first, last)}
