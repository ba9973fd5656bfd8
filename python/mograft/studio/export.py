"""Files of the motions of a project, in the formats that mograft writes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mograft._util.names import portable_stem, unique_names
from mograft.provenance.document import move_record
from mograft.provenance.replay import replay
from mograft.provenance.writing import MOTION_SUFFIXES, WRITERS, files_of_graft, write_graft
from mograft.studio.actions.fields import Fields
from mograft.studio.desk import Desk
from mograft.studio.project import read_project
from mograft.synthesis.graft_result import Graft

_TOGETHER = (".glb", ".npz")
"""Endings of the names of files that can have several motions."""


def run(desk: Desk, request: Mapping[str, Any]) -> dict[str, list[str]]:
    """Write motions below the folder of the session.

    ``ids`` are the motions, by default those that are kept; ``format`` is an ending such as bvh.
    With ``into``, all motions are in one .glb or .npz file: of glTF bases, in a copy of their file.
    Existing files are replaced only with ``force``.
    """
    fields = Fields(request)
    ending = f".{fields.choice('format', [own[1:] for own in WRITERS])}"
    folder = _folder(desk.folder, fields.text("folder", ""))
    if fields.has("ids"):
        motions = [desk.project.motion(own) for own in fields.items("ids", str)]
    else:
        motions = [own for own in desk.project.motions if own.is_kept]
    if not motions:
        raise ValueError("no motion is kept: keep one, or give `ids`")
    target = folder
    if fields.flag("into"):
        if ending not in _TOGETHER:
            raise ValueError(f"`into` requires glb or npz, got {ending[1:]}")
        name = "motions" if desk.file is None else desk.file.name
        target = folder / f"{portable_stem(name)}{ending}"
    grafts = [desk.workshop.graft(own.record) for own in motions]
    character = desk.project.character
    files = write_motions(
        grafts,
        target,
        ending,
        None if character is None else Path(character),
        force=fields.flag("force"),
    )
    return {"files": [own.relative_to(desk.folder).as_posix() for own in files]}


def _folder(root: Path, name: str) -> Path:
    """Return a folder below `root`; raise ValueError if it is elsewhere."""
    folder = (root / name).resolve()
    if not folder.is_relative_to(root) or any(part.startswith(".") for part in Path(name).parts):
        raise ValueError(f"`folder` must be below {root}, got {name!r}")
    return folder


def write_motions(
    grafts: Sequence[Graft],
    target: Path,
    ending: str,
    character: Path | None = None,
    *,
    force: bool = False,
) -> list[Path]:
    """Write grafts to a folder, or to a single .glb or .npz file; return the paths of the motions.

    `ending` is that of each file in a folder. .glb files have the mesh of `character`. Raise
    FileExistsError if a file exists and `force` is false; nothing is written then.
    """
    is_together = target.suffix.lower() in _TOGETHER
    ending = target.suffix.lower() if is_together else ending
    names = unique_names([portable_stem(own.motion.name) for own in grafts])
    paths = [target] if is_together else [target / f"{own}{ending}" for own in names]
    are_robots = all(own.motion.skeleton.hinges is not None for own in grafts)
    holds_graft = ending in MOTION_SUFFIXES and (ending != ".csv" or are_robots)
    for path in paths:
        for file in files_of_graft(path) if holds_graft else [path]:
            if file.exists() and not force:
                raise FileExistsError(f"{file} exists; replace it with --force (force)")
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    for number, path in enumerate(paths):
        own = list(grafts) if is_together else [grafts[number]]
        if holds_graft:
            write_graft(own if is_together else own[0], path, character=character)
        else:
            WRITERS[ending](own[0].motion, path)
    return paths


def replay_project(path: Path, *, all_motions: bool = False) -> tuple[list[Graft], Path | None]:
    """Return the kept motions of a project file, made again, and the file of its character.

    Raise FormatError if the file is damaged, ValueError if no motion is kept, ProvenanceError if an
    input is missing or has changed, and OSError if a file cannot be read.
    """
    project, _, records = read_project(path)
    motions = [own for own in project.motions if own.is_kept or all_motions]
    if not motions:
        raise ValueError(f"{path}: no motion is kept")
    folder = path.parent.resolve()
    grafts = [replay(move_record(records[own.record], folder, Path())) for own in motions]
    return grafts, None if project.character is None else Path(project.character)
