"""Opening of files, folders, libraries, grafts and projects in a session."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

from mograft._util.documents import parse_document
from mograft._util.names import portable_stem
from mograft.config import Config
from mograft.errors import FormatError, MograftError, ProvenanceError
from mograft.io.formats import absolute_address, split_address
from mograft.library.discover import has_provenance, holds_graft
from mograft.provenance.document import move_record
from mograft.provenance.graft_record import GraftRecord, read_record
from mograft.studio.desk import Desk
from mograft.studio.project import (
    FORMAT,
    History,
    Project,
    ProjectInput,
    ProjectMotion,
    Record,
    read_project,
    record_key,
)
from mograft.studio.project_file import ProjectFile

_SUFFIX = ".project.json"


def open_paths(desk: Desk, paths: Sequence[Path | str]) -> None:
    """Add files, folders, a library or a graft to the project, or open a project.

    The library is built in a thread. The caller holds the lock of actions.
    """
    added: list[ProjectInput] = []
    for path in map(str, paths):
        kind = kind_of(path)
        if kind == "project":
            use_file(desk, Path(path).resolve())
        elif kind == "graft":
            _open_graft(desk, path)
        else:
            added.append(ProjectInput(path=absolute_address(path)))
    known = {own.path for own in desk.project.inputs}
    added = [own for own in added if own.path not in known]
    if added:
        names = ", ".join(Path(own.path).name for own in added)
        old = desk.project
        inputs = (*old.inputs, *added)
        desk.set(replace(old, inputs=inputs), f"open {names}" if old.inputs else None)
    _choose_file(desk)


def use_file(desk: Desk, path: Path) -> None:
    """Open a project file, or begin one that does not exist yet."""
    if desk.file is not None and desk.file.path == path:
        return
    file = ProjectFile(path, desk.note)
    try:
        project, history, records = (
            read_project(path) if path.exists() else (Project(), History(), {})
        )
        for key in dict.fromkeys(own.record for own in project.motions):
            _check_record(path, key, records[key])
    except BaseException:
        file.close()
        raise
    with desk.lock:
        old, desk.file = desk.file, file
        desk.workshop.folder = path.parent
        desk.workshop.add_records(records)
        desk.history, desk.previews = history, {}
    if old is not None:
        old.close()
    desk.set(project, None)


def _check_record(path: Path, key: str, record: Record) -> None:
    """Raise FormatError if a provenance record of a project is damaged."""
    try:
        read_record(record)
    except ProvenanceError as error:
        raise FormatError(str(error).removeprefix("document: "), path, f"records.{key}") from None


def _choose_file(desk: Desk) -> None:
    """Begin a file with the name of the first input, or go on with that of the same inputs."""
    if desk.file is not None or not desk.project.inputs:
        return
    stem = portable_stem(Path(split_address(desk.project.inputs[0].path)[0]).stem)
    paths = [own.path for own in desk.project.inputs]
    for number in count(1):
        name = f"{stem}{_SUFFIX}" if number == 1 else f"{stem} ({number}){_SUFFIX}"
        path = desk.folder / name
        try:
            if not path.exists():
                desk.file = ProjectFile(path, desk.note)
                desk.save()
                return
            known = [own.path for own in read_project(path)[0].inputs]
            if known == paths and not desk.project.motions:
                use_file(desk, path)
                desk.note(f"{name} is continued")
                return
        except (MograftError, OSError) as error:
            if not path.exists():
                desk.note(f"the project is not saved: {error}")
                return


def _open_graft(desk: Desk, path: str) -> None:
    """Add a graft, with its inputs and options if the project has none."""
    record = read_record(path)
    document = move_record(dict(record.document), record.folder, desk.workshop.folder)
    key = record_key(document)[0]
    desk.workshop.add_records({key: document})
    project = desk.project
    if not project.inputs:
        default = Config().as_dict()
        values = {k: own for k, own in record.config.as_dict().items() if own != default.get(k)}
        project = replace(
            project,
            inputs=tuple(ProjectInput(path=own) for own in _inputs_of(record)),
            groups=record.groups.to_toml(),
            config=values,
        )
    number = project.n_made + 1
    opened = ProjectMotion(id=f"m{number}", record=key, is_kept=True)
    project = replace(project, motions=(*project.motions, opened), n_made=number)
    desk.set(project, f"open {record.name}")


def kind_of(path: str) -> str:
    """Return whether a path is a project, a graft or an input."""
    file, clip = split_address(path)
    if clip is not None:
        return "graft" if Path(file).suffix != ".json" and holds_graft(path) else "input"
    if Path(file).suffix.lower() == ".json" and Path(file).is_file():
        try:
            document = parse_document(Path(file).read_bytes())
        except ValueError as error:
            raise FormatError(f"expected JSON: {error}", file) from None
        found = document.get("format") if isinstance(document, dict) else None
        return "project" if found == FORMAT else "graft"
    is_file = Path(file).is_file()
    return "graft" if is_file and has_provenance(Path(file)) else "input"


def _inputs_of(record: GraftRecord) -> list[str]:
    """Return the library, or the files, of which a graft was made."""
    if record.library.folder is not None:
        return [str(record.library.folder.resolve())]
    files = [own.file for own in record.clips if own.is_in_library and own.file is not None]
    found = [str((record.folder / own).resolve()) for own in dict.fromkeys(files)]
    given = [(record.folder / own).resolve() for own in record.sources]
    if given and all(own.exists() for own in given):
        return list(map(str, given))
    return found
