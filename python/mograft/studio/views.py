"""What the page shows, as JSON: the state of a session and the encodings of figures."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mograft.body.groups import PRESETS
from mograft.config import variety_of_scale
from mograft.errors import DAMAGE, FormatError
from mograft.library.library import Library
from mograft.library.origin import hash_poses
from mograft.motion.motion import Motion
from mograft.provenance.document import violation_record
from mograft.studio.desk import Desk, find_clip
from mograft.studio.notes import captured_warnings
from mograft.studio.project import ProjectMotion, Record
from mograft.viewing.character import read_character
from mograft.viewing.encoding import encode_change, encode_figure, encode_window
from mograft.viewing.figure import Figure
from mograft.viewing.scene import clip_figure, graft_figure, motion_figure

Json = dict[str, Any]
_MAX_WINDOW = 4000  # frames
_MESHES = (".glb", ".gltf", ".fbx")


def state(desk: Desk) -> Json:
    """Return the state of a session; the caller holds its lock."""
    opened, project, file = desk.opened, desk.project, desk.file
    library = opened.library
    past, future = desk.history.past, desk.history.future
    return {
        "revision": desk.revision,
        "name": "" if file is None else file.name,
        "file": None if file is None else str(file.path),
        "folder": str(desk.folder),
        "undo": past[-1][0] if past else None,
        "redo": future[0][0] if future else None,
        "sources": list(opened.sources),
        "clips": list(opened.clips),
        "skeleton": {"joints": _joints(library)},
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
        "options": _options(desk),
        "motions": [_motion(desk, own) for own in project.motions],
        "jobs": desk.jobs,
    }


def _joints(library: Library | None) -> list[Json]:
    if library is None:
        return []
    pairs = zip(library.skeleton.names, library.skeleton.parents.tolist(), strict=True)
    return [{"name": name, "parent": parent} for name, parent in pairs]


def _groups(library: Library | None) -> Json:
    if library is None:
        return {"base": "", "names": [], "joints": {}}
    names = library.skeleton.names
    joints = {own: [names[j] for j in library.joints(own)] for own in library.groups.names}
    return {"base": library.groups.base, "names": list(joints), "joints": joints}


def _options(desk: Desk) -> Json:
    config, library = dict(desk.project.config), desk.opened.library
    known = config.get("sigma_scale", 0.75 if library is None else library.config.sigma_scale)
    variety = round(min(max(variety_of_scale(known), 0.0), 1.0), 3)
    return {"variety": variety, **config}


def _motion(desk: Desk, own: ProjectMotion) -> Json:
    record = desk.workshop.summaries[own.record]
    measures = desk.workshop.measures.get(own.record, {})
    kept = [each for each in desk.project.motions if each.is_kept and each.id != own.id]
    angles = [desk.workshop.angle(own.record, each.record) for each in kept]
    known = [float(np.degrees(angle)) for angle in angles if angle is not None]
    remarks = [*map(str, record["remarks"])]
    if record["violations"]:
        unlock = "unlock parts, " if own.locks else ""
        remarks.append(
            "no parts of the clips fit all of this. Move the obstacle or target, allow a larger "
            f"error, {unlock}use “Choose again” with more variety, or open more clips"
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
        "apart": round(min(known), 2) if known else None,
        "isLoop": measures.get("isLoop", False),
        "isComposed": record["scenario"] is not None,
        "locks": [lock._asdict() for lock in own.locks],
        "constraints": [
            {"number": number, "record": each, "shape": measures.get("shapes", {}).get(number)}
            for number, each in enumerate(record["constraints"])
            if each.get("weight") != 0
        ],
        "violations": [_violation(each, record["groups"]) for each in record["violations"]],
        "remarks": remarks,
    }


def _violation(record: Record, groups: Mapping[str, Sequence[str]]) -> Json:
    """Return a violation; its group is that of its joint, if it has one."""
    first, last = record["frames"]
    joint = record["joint"]
    return {
        "group": next((name for name, joints in groups.items() if joint in joints), None),
        "number": record["number"],
        "first": first,
        "last": last,
        "joint": joint,
        "text": record["message"],
    }


def preview(desk: Desk, key: str) -> Json:
    """Return the result of an action that shows a preview of a motion."""
    name, graft = desk.previews[key]
    groups = _groups(graft.library)["joints"]
    known = graft.request.constraints
    found = [_violation(violation_record(own, known), groups) for own in graft.violations]
    return {
        "revision": desk.revision,
        "motions": [key],
        "message": "",
        "hash": name,
        "violations": found,
    }


def figure(desk: Desk, kind: str, name: str, since: str | None) -> Json:
    """Return the encoding of a figure."""
    if kind == "clip":
        library = desk.ready_library()
        find_clip(library, "name", name)
        shown = clip_figure(library, name)
        key = hashlib.sha256(library.groups.to_toml().encode()).hexdigest()[:8]
        return _encoded(desk, shown, f"clip-{key}-{hash_poses(shown.motion)[:32]}")
    if kind not in ("motion", "base"):
        raise ValueError(f"`kind` must be motion, base or clip, got {kind!r}")
    own = desk.project.motion(name)
    key, graft = desk.previews.get(own.id) or (own.record, desk.workshop.graft(own.record))
    if kind == "base":
        library, base = graft.library, graft.base
        is_clip = not graft.scenario
        shown = clip_figure(library, base.name) if is_clip else motion_figure(base, library)
        return _encoded(desk, shown, f"base-{key}")
    old = None if since is None else desk.workshop.find(since)
    shown = graft_figure(graft)
    if old is not None:
        patch = encode_change(old.motion, shown, is_mesh=_is_worn(desk, shown.motion))
        if patch is not None:
            return {**patch, "hash": key}
    return _encoded(desk, shown, key)


def _encoded(desk: Desk, shown: Figure, key: str) -> Json:
    is_mesh = _is_worn(desk, shown.motion)
    encoded = encode_figure(shown, is_mesh=is_mesh)
    return {**encoded, "hash": key, "character": 0 if is_mesh else None}


def _is_worn(desk: Desk, motion: Motion) -> bool:
    """Return whether a motion is shown with the mesh of the figures."""
    mesh = _find_character(desk)
    return mesh is not None and mesh[0] == motion.skeleton.names


def character(desk: Desk) -> Json | None:
    """Return the mesh of the figures; None if there is none."""
    found = _find_character(desk)
    return None if found is None else found[1]


def _find_character(desk: Desk) -> tuple[tuple[str, ...], Json] | None:
    """Return the joints of the mesh of the figures, and the mesh."""
    library, given = desk.opened.library, desk.project.character
    if library is None or not library.entries:
        return None
    sources = [own.source_file for own in library.entries]
    files = [None if own is None else Path(own.path) for own in sources]
    found = (own for own in files if own is not None and own.suffix.lower() in _MESHES)
    path = Path(given) if given else next(found, None)
    if path is None:
        return None
    skeleton = library.clips[files.index(path)].skeleton if path in files else library.skeleton
    key = (path, path.stat().st_mtime_ns if path.exists() else 0, skeleton.names)
    if key not in desk.characters:
        mesh = None
        with captured_warnings() as notes:
            try:
                mesh = read_character(path, skeleton)
            except (FormatError, OSError, *DAMAGE) as error:
                desk.note(f"the figures are capsules, not the mesh of {path.name}: {error}")
        for note in notes:
            desk.note(note)
        desk.characters[key] = None if mesh is None else (skeleton.names, mesh)
    return desk.characters[key]


def window(desk: Desk, clip: str, first: int, last: int) -> Json:
    """Return the poses of a part of a clip, both frames included."""
    library = desk.ready_library()
    motion = library.clips[find_clip(library, "clip", clip)]
    if not 0 <= first <= last < motion.n_frames or last - first >= _MAX_WINDOW:
        raise ValueError(
            f"`first` and `last` must be within 0 to {motion.n_frames - 1}, at most {_MAX_WINDOW} "
            f"frames, got {first}-{last}"
        )
    return {"clip": clip, **encode_window(motion, first, last)}
