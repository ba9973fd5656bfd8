"""`Session`: an open project, its library and motions; what the server offers to the page."""

import os
import queue
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from mograft._util.cancel import CancelledError, cancellable
from mograft._util.documents import parse_document
from mograft._util.names import portable_stem
from mograft.config import Config
from mograft.errors import FormatError, MograftError, suggest_path
from mograft.io.formats import absolute_address, split_address
from mograft.library.discover import has_provenance, holds_graft
from mograft.library.library import Library
from mograft.library.origin import find_source_file, hash_poses
from mograft.motion.motion import Motion
from mograft.provenance.document import move_record
from mograft.provenance.graft_record import GraftRecord, read_record
from mograft.studio import actions, donors, export, sources, views
from mograft.studio.notes import captured_warnings
from mograft.studio.project import (
    FORMAT,
    History,
    Project,
    ProjectInput,
    ProjectMotion,
    Record,
    project_text,
    read_project,
    record_key,
)
from mograft.studio.project_file import ProjectFile
from mograft.studio.workshop import Workshop
from mograft.synthesis.graft_result import Graft

Json = dict[str, Any]
_MAX_EVENTS = 1000
_SUFFIX = ".project.json"


class StaleRevision(MograftError):
    """An action was chosen on a state that is not the present one."""


class Subscription(queue.Queue[Json]):
    """The events of a session, from the time of the subscription on."""

    def __init__(self, session: "Session") -> None:
        super().__init__()
        self._session = session

    def close(self) -> None:
        """Receive no more events."""
        self._session.unsubscribe(self)


class Session:
    """An open project. All methods can be called from any thread.

    Parameters
    ----------
    folder : Path
        The only folder in which files are written, apart from `project`.
    project : Path, optional
        The project file; it need not exist. Default: a file in `folder` with the name of the first
        input.

    Raises
    ------
    FormatError
        If the project is damaged.
    MograftError
        If another session has the project open.
    """

    def __init__(self, folder: Path, project: Path | None = None) -> None:
        self.folder = Path(folder).resolve()
        self.project, self.history, self.revision = Project(), History(), 0
        self.opened, self.jobs = sources.Opened(), dict[str, Json]()
        self.file: ProjectFile | None = None
        self.previews: dict[str, tuple[str, Graft]] = {}
        self.characters: dict[Any, Any] = {}  # encodings by file
        self._lock = threading.RLock()  # of the attributes
        self._action_lock = threading.RLock()  # one action at a time
        self._libraries: dict[Any, sources.Opened] = {}
        self._n_requested = self._ticket = 0  # the number of the last action, and of the present
        self._n_questions = 0  # of donors; only the last of several is answered
        self._subscriptions: list[Subscription] = []
        self._worker = ThreadPoolExecutor(1, "studio library")
        self._is_closed = False
        path = None if project is None else Path(project).resolve()
        self.workshop = Workshop(self.folder if path is None else path.parent)
        if path is not None:
            self._use_file(path)

    def close(self) -> None:
        """Save the project and end the threads."""
        self._is_closed = True
        self._worker.shutdown(cancel_futures=True)
        with self._lock:
            if self.file is not None:
                self._save()
                self.file.close()
                self.file = None

    def flush(self) -> None:
        """Wait until the library is built and the project is written."""
        self._worker.submit(lambda: None).result()
        if self.file is not None:
            self.file.flush()

    # Opening

    def open(self, paths: Sequence[Path | str]) -> None:
        """Add files, folders, a library or a graft to the project, or open a project.

        The library is built in a thread. Raise FileNotFoundError if a path does not exist.
        """
        with self._action_lock:
            added: list[ProjectInput] = []
            for path in map(str, paths):
                place = Path(split_address(path)[0])
                if not place.exists():
                    raise FileNotFoundError(f"{path} does not exist{suggest_path(place)}")
                kind = _kind_of(path)
                if kind == "project":
                    self._use_file(place.resolve())
                elif kind == "graft":
                    self._open_graft(path)
                else:
                    added.append(ProjectInput(path=absolute_address(path)))
            known = {own.path for own in self.project.inputs}
            added = [own for own in added if own.path not in known]
            if added:
                names = ", ".join(Path(own.path).name for own in added)
                old = self.project
                inputs = (*old.inputs, *added)
                self._set(replace(old, inputs=inputs), f"open {names}" if old.inputs else None)
            self._choose_file()

    def _use_file(self, path: Path) -> None:
        """Open a project file, or begin one that does not exist yet."""
        if self.file is not None and self.file.path == path:
            return
        file = ProjectFile(path, self.note)
        try:
            project, history, records = (
                read_project(path) if path.exists() else (Project(), History(), {})
            )
        except BaseException:
            file.close()
            raise
        with self._lock:
            old, self.file = self.file, file
            self.workshop.folder = path.parent
            self.workshop.add_records(records)
            self.history, self.previews = history, {}
        if old is not None:
            old.close()
        self._set(project, None)

    def _choose_file(self) -> None:
        """Begin a file with the name of the first input, or go on with that of the same inputs."""
        if self.file is not None or not self.project.inputs:
            return
        stem = portable_stem(Path(split_address(self.project.inputs[0].path)[0]).stem)
        paths = [own.path for own in self.project.inputs]
        for number in count(1):
            name = f"{stem}{_SUFFIX}" if number == 1 else f"{stem} ({number}){_SUFFIX}"
            path = self.folder / name
            try:
                is_new = not path.exists()
                known = [] if is_new else [own.path for own in read_project(path)[0].inputs]
                if not is_new and known == paths and not self.project.motions:
                    self._use_file(path)
                    self.note(f"{name} is continued")
                    return
                if is_new:
                    self.file = ProjectFile(path, self.note)
                    self._save()
                    return
            except (MograftError, OSError) as error:
                if not path.exists():
                    self.note(f"the project is not saved: {error}")
                    return

    def _open_graft(self, path: str) -> None:
        """Add a graft, with its inputs and options if the project has none."""
        record = read_record(path)
        document = move_record(dict(record.document), record.folder, self.workshop.folder)
        key, text = record_key(document)
        self.workshop.records[key], self.workshop.texts[key] = document, text
        project = self.project
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
        self._set(project, f"open {record.name}")

    def _update_library(self) -> None:
        """Build the library of the present project, if it is another one."""
        with self._lock:
            key = sources.library_key(self.project)
            if key == self.opened.key or self._is_closed:
                return
            known = self._libraries.get(key)
            if known is not None:
                self._show_library(known)
                return
            self.opened = replace(self.opened, key=key, status="building", done=0, total=0)
        self._worker.submit(self._build, self.project, key)

    def _build(self, project: Project, key: tuple[Any, ...]) -> None:
        def is_old() -> bool:
            return key != self.opened.key or self._is_closed

        def progress(text: str, done: int, total: int) -> None:
            if is_old():
                raise _NotWantedError
            self.opened = replace(self.opened, done=done, total=total)
            event = {"kind": "progress", "id": "library", "text": text}
            self.emit({**event, "done": done, "total": total})

        try:
            if is_old():
                return
            opened = sources.build(project, progress)
            self._finish(opened, is_old)
        except _NotWantedError:
            return
        except Exception as error:  # it is shown; the session goes on
            self._finish(sources.Opened(key, status="failed", message=str(error)), is_old)

    def _finish(self, opened: sources.Opened, is_old: Callable[[], bool]) -> None:
        """Show a library; then find the faults of its clips, and build motions again."""
        with self._lock:
            if is_old():
                return
            while len(self._libraries) > 3:
                del self._libraries[next(iter(self._libraries))]
            if opened.library is not None:
                self._libraries[opened.key] = opened
            inputs = tuple(
                replace(own, sha256=opened.hashes.get(own.path, own.sha256))
                for own in self.project.inputs
            )
            self.project = replace(self.project, inputs=inputs)
            self._show_library(opened)
        self.notify()
        for own in self.project.motions:
            if is_old():
                return
            self._restore(own)
        opened = sources.with_faults(opened, should_stop=is_old)
        with self._lock:
            if is_old():
                return
            self._libraries[opened.key] = self.opened = opened
        self.notify()

    def _restore(self, own: ProjectMotion) -> None:
        try:
            if self.workshop.find(own.record) is None:
                self.workshop.graft(own.record)
                self.notify()
        except (MograftError, OSError, ValueError) as error:
            self.note(f"{self.name_of(own)}: {error}")

    def _show_library(self, opened: sources.Opened) -> None:
        self.opened = opened
        if opened.library is not None:
            self.workshop.set_library(opened.library)

    # Events

    def subscribe(self) -> Subscription:
        """Return a queue of the events from now on."""
        own = Subscription(self)
        with self._lock:
            self._subscriptions.append(own)
        return own

    def unsubscribe(self, own: Subscription) -> None:
        """Send no more events to a subscription."""
        with self._lock:
            if own in self._subscriptions:
                self._subscriptions.remove(own)

    def emit(self, event: Json) -> None:
        """Send an event to all subscriptions."""
        with self._lock:
            for own in self._subscriptions:
                if own.qsize() < _MAX_EVENTS:
                    own.put(event)

    def note(self, text: str) -> None:
        """Send a text for the person."""
        self.emit({"kind": "note", "text": text})

    def notify(self) -> None:
        """Send that the state has changed."""
        with self._lock:
            self.revision += 1
            self.emit({"kind": "state", "revision": self.revision})

    @contextmanager
    def job(self, text: str, total: int) -> Iterator[Callable[[], None]]:
        """Show a job while it runs; the block calls the function for each item that is done."""
        own: Json = {"id": text, "text": text, "done": 0, "total": total}

        def advance() -> None:
            own["done"] += 1
            self.emit({"kind": "progress", **own})

        with self._lock:
            self.jobs[text] = own
        self.notify()
        try:
            yield advance
        finally:
            with self._lock:
                self.jobs.pop(text, None)

    # Actions

    def do(self, action: Mapping[str, Any], revision: int | None = None) -> Json:
        """Do an action on the state of a revision; see `mograft.studio.actions`.

        Also ``undo`` and ``redo``. Raise StaleRevision if `revision` is not the present one, which
        is not compared for previews, and ValueError if the action is not possible.
        """
        is_preview = action.get("preview") is True
        with self._lock:
            self._n_requested += 1
            ticket = self._n_requested
        with self._action_lock:
            self._ticket = ticket
            if is_preview and self.is_superseded():
                return self._superseded()
            if not is_preview and revision is not None and revision != self.revision:
                raise StaleRevision(f"expected revision {self.revision}, got {revision}")
            old, step = self.project, action.get("action")
            if step in ("undo", "redo"):
                message = self._step(step)
                project = self.project
            else:
                try:
                    with captured_warnings() as warned:
                        project, text = actions.run(self, action)
                except CancelledError:
                    return self._superseded()
                for own in warned:
                    self.note(own)
                if is_preview:
                    return views.preview(self, str(action["id"]))
                self._set(project, text, old)
                message = text or ""
            changed = [own.id for own in project.motions if own not in old.motions]
            return {"revision": self.revision, "motions": changed, "message": message}

    def is_superseded(self) -> bool:
        """Return whether a later action waits for the present one."""
        return self._n_requested != self._ticket

    def _superseded(self) -> Json:
        return {"revision": self.revision, "motions": [], "message": "superseded"}

    def _step(self, step: str) -> str:
        with self._lock:
            move = self.history.undo if step == "undo" else self.history.redo
            self.history, project, text = move(self.project)
            self._set(project, None)
        return f"{step} {text}"

    def show(self, project: Project) -> None:
        """Show a project that an action has not finished."""
        with self._lock:
            self.project = project
        self.notify()

    def preview(self, key: str, graft: Graft) -> None:
        """Show another version of a motion until the next action."""
        name = f"preview-{hash_poses(graft.motion)[:32]}"
        self.workshop.keep(name, graft)
        with self._lock:
            self.previews[key] = (name, graft)

    def _set(self, project: Project, text: str | None, old: Project | None = None) -> None:
        """Set the present project; `text` is the step from `old`, None for none."""
        with self._lock:
            old = self.project if old is None else old
            if text is not None and project != old:
                self.history = self.history.push(text, old)
            self.project = project
            self.previews.clear()
            self._save()
            self._update_library()
        self.notify()

    def _save(self) -> None:
        """Write the present project to its file, in the thread of the file."""
        if self.file is None:
            return
        project, history, folder = self.project, self.history, self.file.path.parent
        texts = self.workshop.texts
        self.file.save(lambda: project_text(project, history, texts, folder))

    # Questions of actions

    def ready_library(self) -> Library:
        """Return the library of new motions; raise ValueError if it is not built."""
        library = self.opened.library
        if library is None or self.opened.status != "ready":
            why = self.opened.message or f"its state is {self.opened.status}"
            raise ValueError(f"the library is not ready: {why}")
        return library

    @property
    def is_stored_library(self) -> bool:
        """Whether the input is the folder of a library."""
        return any(sources.is_library(own.path) for own in self.project.inputs)

    def name_of(self, own: ProjectMotion) -> str:
        """Return the name of a motion."""
        return str(self.workshop.records[own.record]["name"])

    def source_names(self) -> list[str]:
        """Return the inputs as paths relative to the folder of records."""
        if self.is_stored_library:
            return []
        folder = self.workshop.folder
        return [Path(os.path.relpath(own.path, folder)).as_posix() for own in self.project.inputs]

    def decode_motion(self, record: Record) -> Motion:
        """Return the motion of a `Character` in a constraint, which names a clip of the library."""
        library = self.ready_library()
        name = record.get("name") if isinstance(record, dict) else None
        if name not in library.names:
            raise ValueError(f"`motion` must name a clip of the library, got {name!r}")
        motion = library.clips[library.names.index(name)]
        if find_source_file(motion) is None:
            raise ValueError(f"`motion` must be a clip as its file has it; {name} was converted")
        return motion

    # Views

    def state(self) -> Json:
        """Return everything that the page shows, apart from poses."""
        with self._lock:
            return views.state(self)

    def figure(self, kind: str, name: str, since: str | None = None) -> Json:
        """Return the encoding of a motion, of the base of a motion, or of a clip.

        `kind` is "motion", "base" or "clip". With the hash of an earlier version as `since`, only
        the frames that differ are returned if possible, under "patch".
        """
        return views.figure(self, kind, name, since)

    def character(self) -> Json | None:
        """Return the mesh of the figures; None if there is none."""
        return views.character(self)

    def donors(self, question: Mapping[str, Any]) -> Json:
        """Return the ranked donors of a range; see `mograft.studio.donors`.

        The result has ``"superseded": true`` if a later question came during the search.
        """
        with self._lock:
            self._n_questions += 1
            ticket = self._n_questions
        try:
            with cancellable(lambda: self._n_questions != ticket):
                return donors.find(self, question)
        except CancelledError:
            return {"donors": [], "total": 0, "isSegment": False, "superseded": True}

    def window(self, clip: str, first: int, last: int) -> Json:
        """Return the poses of a part of a clip."""
        return views.window(self, clip, first, last)

    def export(self, request: Mapping[str, Any]) -> Json:
        """Write motions to files; see `mograft.studio.export`."""
        return export.run(self, request)


class _NotWantedError(Exception):
    """The library that is built is not that of the present project."""


def _kind_of(path: str) -> str:
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
