"""`Session`: an open project, its library and motions; what the server offers to the page."""

import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft.errors import MograftError
from mograft.studio import actions, sources, views
from mograft.studio.project import History, Project, ProjectInput
from mograft.studio.workshop import Workshop

Json = dict[str, Any]
_MAX_EVENTS = 1000


class StaleRevision(MograftError):  # noqa: N818 - it is no error of the session
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
    """An open project. All methods can be called from any thread."""

    def __init__(self, folder: Path, project: Path | None = None) -> None:
        self.folder = Path(folder).resolve()
        self.project, self.history, self.revision = Project(), History(), 0
        self.file = project
        self.workshop = Workshop(self.folder)
        self.opened = sources.Opened()
        self.jobs: dict[str, Json] = {}
        self._lock = threading.RLock()  # of the attributes
        self._actions = threading.RLock()  # one action at a time
        self._subscriptions: list[Subscription] = []

    def open(self, paths: Sequence[Path]) -> None:
        """Add files, folders or a library to the project, and build its library in a thread."""
        added = tuple(ProjectInput(path=str(Path(own).resolve())) for own in paths)
        with self._lock:
            known = {own.path for own in self.project.inputs}
            inputs = (*self.project.inputs, *(own for own in added if own.path not in known))
            self._set(replace(self.project, inputs=inputs), None)
        threading.Thread(target=self._build, daemon=True).start()

    def _build(self) -> None:
        try:
            opened = sources.build(self.project, self.opened, self._progress)
        except Exception as error:  # noqa: BLE001 - it is shown
            opened = replace(self.opened, status="failed", message=str(error))
        with self._lock:
            self.opened = opened
            if opened.library is not None:
                self.workshop.set_library(opened.library)
        self.notify()

    def _progress(self, text: str, done: int, total: int) -> None:
        with self._lock:
            self.opened = replace(self.opened, status="building", done=done, total=total)
        self.emit({"kind": "progress", "id": "library", "text": text, "done": done, "total": total})

    def close(self) -> None:
        """Save the project and end the threads."""

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

    def notify(self) -> None:
        """Send that the state has changed."""
        with self._lock:
            self.revision += 1
            self.emit({"kind": "state", "revision": self.revision})

    def _set(self, project: Project, text: str | None) -> None:
        """Set the present project; `text` is the step in the history, None for none."""
        with self._lock:
            if text is not None:
                self.history = self.history.push(text, self.project)
            self.project = project
        self.notify()

    def state(self) -> Json:
        """Return everything that the page shows, except poses."""
        with self._lock:
            return views.state(self)

    def do(self, action: Mapping[str, Any], revision: int | None = None) -> Json:
        """Do an action; see `mograft.studio.actions`."""
        with self._actions:
            if revision is not None and revision != self.revision:
                raise StaleRevision(f"expected the revision {self.revision}, got {revision}")
            old = self.project
            project, message = actions.run(self, action)
            changed = [own.id for own in project.motions if own not in old.motions]
            self._set(project, message)
            return {"revision": self.revision, "motions": changed, "message": message}

    def figure(self, kind: str, name: str, since: str | None = None) -> Json:
        """Return the encoding of a motion, of its base or of a clip."""
        return views.figure(self, kind, name, since)
