"""`Desk`: the present project of a session, with what is open and who listens.

Actions and views use it; `mograft.studio.session.Session` is the whole.
"""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from mograft.errors import suggest_name
from mograft.library.files.storage import is_library
from mograft.library.library import Library
from mograft.library.origin import find_source_file, hash_poses
from mograft.motion.motion import Motion
from mograft.studio import sources
from mograft.studio.project import History, Project, ProjectMotion, Record, project_text
from mograft.studio.project_file import ProjectFile
from mograft.studio.workshop import Workshop
from mograft.synthesis.graft_result import Graft

Json = dict[str, Any]


class Desk:
    """The open project with its steps of undo. All methods can be called from any thread."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder).resolve()
        self.project, self.history = Project(), History()
        self.revision = self.project_revision = 0  # of the state, and of its last other project
        self.opened, self.jobs = sources.Opened(), list[Json]()  # at most one job, of the action
        self.file: ProjectFile | None = None
        self.workshop = Workshop(self.folder)
        self.previews: dict[str, tuple[str, Graft]] = {}
        self.characters: dict[Any, tuple[tuple[str, ...], Json] | None] = {}  # meshes by file
        self.update_library: Callable[[], None]  # build that of the project, if it is another one
        self.lock = threading.RLock()  # of the attributes
        self.action_lock = threading.RLock()  # one action at a time
        self.n_requested = self.ticket = 0  # the number of the last action, and of the present
        self._listeners: list[Callable[[Json], object]] = []

    # Events

    def subscribe(self, listener: Callable[[Json], object]) -> None:
        """Call a function with each event from now on, in the threads that report events."""
        self._listeners.append(listener)

    def emit(self, event: Json) -> None:
        """Send an event to all subscriptions."""
        for listener in self._listeners:
            listener(event)

    def note(self, text: str) -> None:
        """Send a text for the person."""
        self.emit({"kind": "note", "text": text})

    def notify(self, *, is_project: bool = False) -> None:
        """Send that the state has changed, and whether the project has."""
        with self.lock:
            self.revision += 1
            if is_project:
                self.project_revision = self.revision
            self.emit({"kind": "state", "revision": self.revision})

    @contextmanager
    def job(self, text: str, total: int) -> Iterator[Callable[[], None]]:
        """Show a job while it runs; the block calls the function for each item that is done."""
        own: Json = {"id": text, "text": text, "done": 0, "total": total}

        def advance() -> None:
            own["done"] += 1
            self.emit({"kind": "progress", **own})

        self.jobs = [own]
        self.notify()
        try:
            yield advance
        finally:
            self.jobs = []
            self.notify()

    # The project

    def set(self, project: Project, text: str | None, old: Project | None = None) -> None:
        """Set the present project; `text` is the step from `old`, None for none."""
        with self.lock:
            old = self.project if old is None else old
            if text is not None and project != old:
                self.history = self.history.push(text, old)
            self.project = project
            self.previews.clear()
            self.update_library()
            self.add_hashes()
            self.save()
            self.notify(is_project=True)

    def add_hashes(self) -> None:
        """Add the SHA-256 of inputs that were read since the project was made."""
        known, project = self.opened.hashes, self.project
        inputs = tuple(replace(own, sha256=known.get(own.path)) for own in project.inputs)
        if all(own.sha256 for own in inputs):
            self.project = replace(project, inputs=inputs)

    def save(self) -> None:
        """Write the present project to its file, in the thread of the file."""
        if self.file is None:
            return
        project, history, folder = self.project, self.history, self.file.path.parent
        keys = {own.record for each in (project, *history.projects) for own in each.motions}
        self.workshop.keep_only(keys)
        texts = dict(self.workshop.texts)
        self.file.save(lambda: project_text(project, history, texts, folder))

    def show(self, project: Project) -> None:
        """Show a project that an action has not finished."""
        with self.lock:
            self.project = project
            self.notify(is_project=True)

    def preview(self, key: str, graft: Graft) -> None:
        """Show another version of a motion until the next action."""
        name = f"preview-{hash_poses(graft.motion)[:32]}"
        self.workshop.keep(name, graft)
        with self.lock:
            self.previews[key] = (name, graft)

    def is_superseded(self) -> bool:
        """Return whether a later action waits for the present one."""
        return self.n_requested != self.ticket

    # What actions need

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
        return any(is_library(own.path) for own in self.project.inputs)

    def name_of(self, own: ProjectMotion) -> str:
        """Return the name of a motion."""
        return str(self.workshop.summaries[own.record]["name"])

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
        motion = library.clips[find_clip(library, "motion", name)]
        if find_source_file(motion) is None:
            raise ValueError(f"`motion` must be a clip as its file has it; {name} was converted")
        return motion


def find_clip(library: Library, field: str, name: object) -> int:
    """Return the index of a clip; raise ValueError, which names the field, if there is none."""
    if name not in library.names:
        hint = suggest_name(name, library.names)
        raise ValueError(f"`{field}` must be a clip of the library, got {name!r}{hint}")
    return library.names.index(str(name))
