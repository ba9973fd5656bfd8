"""`Project`: the inputs, options and motions of a session, as one value and as a JSON file."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, TypeAlias, get_args, get_origin

from mograft._util.documents import parse_document
from mograft.body.groups import PRESETS, JointGroups
from mograft.config import Config
from mograft.errors import DAMAGE, FormatError
from mograft.provenance.document import SCHEMA, move_record

FORMAT = "mograft.project/1"
MARKS = ("star", "reject")
MAX_STEPS = 200
"""Greatest number of steps that can be undone."""

Record = dict[str, Any]


class Lock(NamedTuple):
    """A range of frames in which a group keeps its donors; both frames are included."""

    group: str
    first: int
    last: int

    @property
    def frames(self) -> tuple[int, int]:
        """The first and the last frame."""
        return self.first, self.last


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
        return json.dumps(asdict(self))


Step: TypeAlias = tuple[str, Project]
"""The text of a step, and the project at its other end."""


@dataclass(frozen=True)
class History:
    """The projects before and after the present one, each with the step between them."""

    past: tuple[Step, ...] = ()  # oldest first
    future: tuple[Step, ...] = ()  # next first

    def push(self, text: str, old: Project) -> "History":
        """Return the history after a step, which starts at `old`."""
        return History((*self.past, (text, old))[-MAX_STEPS:])

    def move(self, direction: str, present: Project) -> tuple["History", Project, str]:
        """Return the history, project and text of the step that is undone or done again.

        `direction` is "undo" or "redo". Raise ValueError if there is no such step.
        """
        if not (self.past if direction == "undo" else self.future):
            raise ValueError(f"nothing to {direction}")
        if direction == "undo":
            text, project = self.past[-1]
            return History(self.past[:-1], ((text, present), *self.future)), project, text
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
    listed = {
        name: "[" + ",\n".join(f"[{json.dumps(text)}, {own.text}]" for text, own in steps) + "]"
        for name, steps in vars(history).items()
    }
    head = f'{{"format": "{FORMAT}",\n"folder": {json.dumps(str(folder))},\n'
    return (
        f'{head}"project": {project.text},\n"past": {listed["past"]},\n'
        f'"future": {listed["future"]},\n"records": {{{records}}}}}\n'
    )


def read_project(path: Path) -> tuple[Project, History, dict[str, Record]]:
    """Return the project in a file, its history, and the records of grafts by their keys.

    Raise FormatError, which names the file and the key, if it is not a project or is damaged, and
    OSError if it cannot be read.
    """
    try:
        document = parse_document(path.read_bytes())
    except ValueError as error:
        raise FormatError(f"expected JSON: {error}", path) from None
    return _Reader(path).read(document)


class _Reader:
    """Reads the document of a project; errors name the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.new = self.old = path.parent.resolve()  # the folder, and the one where it was saved
        self.records: dict[str, Record] = {}

    def fail(self, place: str, message: str) -> FormatError:
        return FormatError(message, self.path, place)

    def read(self, document: Any) -> tuple[Project, History, dict[str, Record]]:  # noqa: ANN401
        found = document.get("format") if isinstance(document, dict) else None
        if found != FORMAT:
            raise self.fail("format", f"expected {FORMAT}, got {found!r}")
        records = self.get(document, "records", dict)
        self.old = Path(self.get(document, "folder", str))
        for key, record in records.items():
            schema = record.get("schema") if isinstance(record, dict) else None
            if schema != SCHEMA:
                raise self.fail(f"records.{key}", f"`schema` must be {SCHEMA}, got {schema!r}")
            self.records[key] = self.moved_record(record)
        past = self.get(document, "past", list)[-MAX_STEPS:]  # each step is large
        past, future = (
            self.decode(own, tuple[Step, ...], name)
            for name, own in (("past", past), ("future", self.get(document, "future", list)))
        )
        return self.get(document, "project", Project), History(past, future), self.records

    def moved_record(self, record: Record) -> Record:
        """Return a record whose files that are not below the present folder are found, too."""
        files = [own for own in record.get("clips", ()) if isinstance(own, dict)]
        is_below = all((self.new / str(own.get("file"))).exists() for own in files)
        if self.old == self.new or is_below:
            return record
        return move_record(record, self.old, self.new)

    def moved(self, path: str) -> str:
        """Return a path below the saved folder as one below the present folder, if it is there."""
        own = Path(path)
        if self.old == self.new or not own.is_relative_to(self.old):
            return path
        below = self.new / own.relative_to(self.old)
        return str(below if below.exists() or not own.exists() else own)

    def get(self, document: Any, key: str, kind: Any, above: str = "") -> Any:  # noqa: ANN401
        """Return the value of a key, as an object of the type of a field."""
        if not isinstance(document, dict) or not (key in document or isinstance(kind, UnionType)):
            raise self.fail(f"{above}{key}", "is missing")
        return self.decode(document.get(key), kind, f"{above}{key}")

    def decode(self, value: Any, kind: Any, place: str) -> Any:  # noqa: ANN401
        """Return a value of JSON as an object of a class of projects, or of a simple type."""
        if kind is Lock:
            return self.checked(Lock(*self.decode(value, tuple[str, int, int], place)), place)
        if kind in (ProjectInput, ProjectMotion, Project):
            given = {
                own.name: self.get(value, own.name, own.type, f"{place}.") for own in fields(kind)
            }
            return self.checked(kind(**given), place)
        if get_origin(kind) is tuple:
            items, kinds = self.decode(value, list, place), get_args(kind)
            if kinds[-1] is ...:
                kinds = kinds[:1] * len(items)
            if len(items) != len(kinds):
                raise self.fail(place, f"expected {len(kinds)} items, got {len(items)}")
            pairs = enumerate(zip(items, kinds, strict=True))
            return tuple(self.decode(own, each, f"{place}[{n}]") for n, (own, each) in pairs)
        accepted = {float: int | float, Mapping[str, Any]: dict}.get(kind, kind)
        if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
            name = getattr(accepted, "__name__", str(accepted))
            raise self.fail(place, f"expected {name}, got {type(value).__name__}")
        return value

    def checked(self, own: Any, place: str) -> Any:  # noqa: ANN401
        """Return an object with paths of present files; raise FormatError if it is impossible."""
        if isinstance(own, Lock) and not 0 <= own.first <= own.last:
            raise self.fail(place, f"expected a first and a last frame, got {own.frames}")
        if isinstance(own, ProjectInput):
            return replace(own, path=self.moved(own.path))
        if isinstance(own, ProjectMotion):
            if own.record not in self.records:
                raise self.fail(f"{place}.record", f"{own.record!r} is not in `records`")
            if own.mark not in (None, *MARKS):
                raise self.fail(f"{place}.mark", f"expected null, star or reject, got {own.mark!r}")
        if isinstance(own, Project):
            if len({each.id for each in own.motions}) < len(own.motions):
                raise self.fail(f"{place}.motions", "expected a different `id` of each motion")
            for name, computed in (("config", "full_config"), ("groups", "joint_groups")):
                try:
                    getattr(own, computed)
                except DAMAGE as error:
                    raise self.fail(f"{place}.{name}", str(error)) from None
            if own.character is not None:
                return replace(own, character=self.moved(own.character))
        return own
