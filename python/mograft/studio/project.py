"""`Project`: the inputs, options and motions of a session, as one value and as a JSON file."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from mograft._util.documents import parse_document
from mograft.body.groups import PRESETS, JointGroups
from mograft.config import Config
from mograft.errors import DAMAGE, FormatError
from mograft.provenance.document import SCHEMA, move_record

FORMAT = "mograft.project/1"
MARKS = (None, "star", "reject")
MAX_STEPS = 200
"""Greatest number of steps that can be undone."""

Record = dict[str, Any]
R = TypeVar("R")


class Lock(NamedTuple):
    """A range of frames in which a group keeps its donors; both frames are included."""

    group: str
    first: int
    last: int


@dataclass(frozen=True, kw_only=True)
class ProjectInput:
    """A file or folder of motions, or a library."""

    path: str  # absolute
    sha256: str | None = None  # of the motions in it; None before they are read


@dataclass(frozen=True, kw_only=True)
class ProjectMotion:
    """A motion that was made."""

    id: str
    record: str  # the key of its provenance record
    mark: str | None = None
    is_kept: bool = False
    locks: tuple[Lock, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Project:
    """Everything that a person chose. Records are shared between the steps of a `History`."""

    inputs: tuple[ProjectInput, ...] = ()
    groups: str = "lower_upper"  # the name of a preset, or TOML
    config: Mapping[str, Any] = field(default_factory=dict)  # fields that differ from the defaults
    distinct: float = 0.0  # smallest angle between motions that are made together, degrees
    character: str | None = None  # absolute path of a file with a mesh
    motions: tuple[ProjectMotion, ...] = ()
    n_made: int = 0  # motions ever made; the next id follows

    def motion(self, key: object) -> ProjectMotion:
        """Return the motion with an id; raise ValueError if there is none."""
        for own in self.motions:
            if own.id == key:
                return own
        raise ValueError(f"`id` must be that of a motion of the project, got {key!r}")

    def with_motion(self, changed: ProjectMotion) -> "Project":
        """Return the project with another version of a motion."""
        motions = (changed if own.id == changed.id else own for own in self.motions)
        return replace(self, motions=tuple(motions))

    @property
    def full_config(self) -> Config:
        """The configuration of new motions."""
        return Config.from_dict(dict(self.config))

    @property
    def joint_groups(self) -> JointGroups | str:
        """The groups of new motions, as an argument of `Library.build`."""
        if self.groups in PRESETS:
            return self.groups
        return JointGroups.from_toml(f"{self.groups}\n")  # with a line break it is no path

    @cached_property
    def text(self) -> str:
        """The project as JSON, by which projects are compared."""
        own = {name: value for name, value in vars(self).items() if name != "text"}
        own["inputs"] = [vars(each) for each in self.inputs]
        own["motions"] = [vars(each) for each in self.motions]
        return json.dumps(own)


@dataclass(frozen=True)
class History:
    """The projects before and after the present one, each with the step between them."""

    past: tuple[tuple[str, Project], ...] = ()  # oldest first
    future: tuple[tuple[str, Project], ...] = ()  # next first

    def push(self, text: str, old: Project) -> "History":
        """Return the history after a step, which starts at `old`."""
        return History((*self.past, (text, old))[-MAX_STEPS:])

    def undo(self, present: Project) -> tuple["History", Project, str]:
        """Return the history, project and text of the step that is undone."""
        if not self.past:
            raise ValueError("nothing to undo")
        text, project = self.past[-1]
        return History(self.past[:-1], ((text, present), *self.future)), project, text

    def redo(self, present: Project) -> tuple["History", Project, str]:
        """Return the history, project and text of the step that is done again."""
        if not self.future:
            raise ValueError("nothing to redo")
        text, project = self.future[0]
        return History((*self.past, (text, present)), self.future[1:]), project, text

    @property
    def projects(self) -> list[Project]:
        """All projects before and after the present one."""
        return [project for _, project in (*self.past, *self.future)]


def record_key(record: Record) -> tuple[str, str]:
    """Return the key of a provenance record, and its text."""
    text = json.dumps(record)
    return hashlib.sha256(text.encode()).hexdigest()[:32], text


def project_text(project: Project, history: History, texts: Mapping[str, str], folder: Path) -> str:
    """Return the text of a project file in a folder.

    `texts` has the JSON of each record by its key. Its paths are relative to `folder`.
    """
    projects = [project, *history.projects]
    used = dict.fromkeys(own.record for each in projects for own in each.motions)
    records = ",\n".join(f'"{key}": {texts[key]}' for key in used)
    steps = {
        name: [[text, own.text] for text, own in steps] for name, steps in vars(history).items()
    }
    listed = {
        name: "[" + ",\n".join(f"[{json.dumps(text)}, {own}]" for text, own in pairs) + "]"
        for name, pairs in steps.items()
    }
    head = f'{{"format": "{FORMAT}",\n"folder": {json.dumps(str(folder))},\n'
    return (
        f'{head}"project": {project.text},\n"past": {listed["past"]},\n'
        f'"future": {listed["future"]},\n"records": {{{records}}}}}\n'
    )


def read_project(path: Path) -> tuple[Project, History, dict[str, Record]]:
    """Read a project file: the project, its history and the records by key.

    Raise FormatError, which names the file and the key, if it is not a project or is damaged, and
    OSError if it cannot be read.
    """
    try:
        document = parse_document(path.read_bytes())
    except ValueError as error:
        raise FormatError(f"expected JSON: {error}", path) from None
    return _Reader(path).read(document)


@dataclass(frozen=True)
class _Reader:
    """Reads the document of a project; errors name the file and the key."""

    path: Path

    def fail(self, place: str, message: str) -> FormatError:
        return FormatError(message, self.path, place)

    def read(self, document: Any) -> tuple[Project, History, dict[str, Record]]:  # noqa: ANN401
        found = document.get("format") if isinstance(document, dict) else None
        if found != FORMAT:
            raise self.fail("format", f"expected {FORMAT}, got {found!r}")
        records = self.get(document, "records", dict, "records")
        for key, record in records.items():
            schema = record.get("schema") if isinstance(record, dict) else None
            if schema != SCHEMA:
                raise self.fail(f"records.{key}", f"`schema` must be {SCHEMA}, got {schema!r}")
        # The folder of the project has been moved: paths of its files move with it.
        old, new = Path(self.get(document, "folder", str, "folder")), self.path.parent.resolve()
        project = self.project(self.get(document, "project", dict, "project"), records, "project")
        steps = {
            name: self.steps(self.get(document, name, list, name), records, name)
            for name in ("past", "future")
        }
        if old != new:
            return self.moved(project, History(**steps), records, old, new)
        return project, History(**steps), records

    def moved(
        self, project: Project, history: History, records: dict[str, Record], old: Path, new: Path
    ) -> tuple[Project, History, dict[str, Record]]:
        """Return a project that was saved in the folder `old` as one in the folder `new`.

        Files below the old folder are searched for at the same place below the new one.
        """

        def move(path: str) -> str:
            own = Path(path)
            below = new / own.relative_to(old) if own.is_relative_to(old) else own
            return str(below if below.exists() or not own.exists() else own)

        def move_project(own: Project) -> Project:
            inputs = tuple(replace(each, path=move(each.path)) for each in own.inputs)
            character = None if own.character is None else move(own.character)
            return replace(own, inputs=inputs, character=character)

        moved: dict[str, Record] = {}
        for key, record in records.items():
            files = [own for own in record.get("clips", ()) if isinstance(own, dict)]
            is_below = all((new / str(own.get("file"))).exists() for own in files)
            moved[key] = record if is_below else move_record(record, old, new)
        steps = {
            name: tuple((text, move_project(own)) for text, own in pairs)
            for name, pairs in vars(history).items()
        }
        return move_project(project), History(**steps), moved

    def get(self, document: Any, key: str, kind: type[R], place: str) -> R:  # noqa: ANN401
        if not isinstance(document, dict) or key not in document:
            raise self.fail(place, "is missing")
        value = document[key]
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise self.fail(place, f"expected {kind.__name__}, got {type(value).__name__}")
        return value

    def steps(
        self, steps: list[Any], records: Mapping[str, Record], place: str
    ) -> tuple[tuple[str, Project], ...]:
        found = []
        for number, step in enumerate(steps[-MAX_STEPS:] if place == "past" else steps):
            at = f"{place}[{number}]"
            if not isinstance(step, list) or len(step) != 2 or not isinstance(step[0], str):
                raise self.fail(at, "expected the text of a step and a project")
            found.append((step[0], self.project(step[1], records, at)))
        return tuple(found)

    def project(self, own: Any, records: Mapping[str, Record], at: str) -> Project:  # noqa: ANN401
        def optional(item: Any, key: str, place: str) -> str | None:  # noqa: ANN401
            return None if item.get(key) is None else self.get(item, key, str, f"{place}.{key}")

        inputs, motions = [], []
        for number, item in enumerate(self.get(own, "inputs", list, f"{at}.inputs")):
            place = f"{at}.inputs[{number}]"
            path = self.get(item, "path", str, f"{place}.path")
            inputs.append(ProjectInput(path=path, sha256=optional(item, "sha256", place)))
        for number, item in enumerate(self.get(own, "motions", list, f"{at}.motions")):
            motions.append(self.motion(item, records, f"{at}.motions[{number}]"))
        if len({each.id for each in motions}) < len(motions):
            raise self.fail(f"{at}.motions", "expected a different `id` of each motion")
        distinct = own.get("distinct")
        if isinstance(distinct, bool) or not isinstance(distinct, int | float):
            raise self.fail(f"{at}.distinct", f"expected a number, got {distinct!r}")
        project = Project(
            inputs=tuple(inputs),
            groups=self.get(own, "groups", str, f"{at}.groups"),
            config=self.get(own, "config", dict, f"{at}.config"),
            distinct=distinct,
            character=optional(own, "character", at),
            motions=tuple(motions),
            n_made=self.get(own, "n_made", int, f"{at}.n_made"),
        )
        self.check(f"{at}.config", lambda: project.full_config)
        self.check(f"{at}.groups", lambda: project.joint_groups)
        return project

    def check(self, place: str, compute: Callable[[], object]) -> None:
        try:
            compute()
        except DAMAGE as error:
            raise self.fail(place, str(error)) from None

    def motion(self, own: Any, records: Mapping[str, Record], at: str) -> ProjectMotion:  # noqa: ANN401
        record = self.get(own, "record", str, f"{at}.record")
        if record not in records:
            raise self.fail(f"{at}.record", f"{record!r} is not in `records`")
        mark = own.get("mark")
        if mark not in MARKS:
            raise self.fail(f"{at}.mark", f"expected null, star or reject, got {mark!r}")
        locks = []
        for number, lock in enumerate(self.get(own, "locks", list, f"{at}.locks")):
            kinds = [type(value) for value in lock] if isinstance(lock, list) else []
            if kinds != [str, int, int] or not 0 <= lock[1] <= lock[2]:
                place = f"{at}.locks[{number}]"
                raise self.fail(place, f"expected group, first and last frame, got {lock!r}")
            locks.append(Lock(*lock))
        return ProjectMotion(
            id=self.get(own, "id", str, f"{at}.id"),
            record=record,
            mark=mark,
            is_kept=self.get(own, "is_kept", bool, f"{at}.is_kept"),
            locks=tuple(locks),
        )
