"""`Session`: an open project, its library and motions; what the server offers to the page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mograft._util.cancel import CancelledError, cancellable
from mograft.errors import MograftError
from mograft.studio import donors, export, views
from mograft.studio.actions.registry import run_action
from mograft.studio.building import LibraryBuilder
from mograft.studio.desk import Desk
from mograft.studio.notes import captured_warnings
from mograft.studio.opening import open_paths, use_file

Json = dict[str, Any]


class StaleRevision(MograftError):
    """An action was chosen on a state that is not the present one."""


class Session(Desk):
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
        super().__init__(folder)
        self._builder = LibraryBuilder(self)
        self.update_library = self._builder.update
        self._n_questions = 0  # of donors; only the last of several is answered
        if project is not None:
            use_file(self, Path(project).resolve())

    def close(self) -> None:
        """Save the project and end the threads."""
        self._builder.close()
        with self.lock:
            self.save()
            file, self.file = self.file, None
        if file is not None:
            file.close()  # its thread may need the lock to report something

    def flush(self) -> None:
        """Wait until the library is built and the project is written."""
        self._builder.flush()
        if self.file is not None:
            self.file.flush()

    def open(self, paths: Sequence[Path | str]) -> None:
        """Add files, folders, a library or a graft to the project, or open a project.

        The library is built in a thread.
        """
        with self.action_lock:
            open_paths(self, paths)

    def do(self, action: Mapping[str, Any], revision: int | None = None) -> Json:
        """Do an action on the state of a revision; see `mograft.studio.actions.registry`.

        Also ``undo`` and ``redo``. Raise StaleRevision if the project has changed since `revision`,
        which is not compared for previews, and ValueError if the action is not possible.
        """
        is_preview = action.get("preview") is True
        with self.lock:
            self.n_requested += 1
            ticket = self.n_requested
        with self.action_lock:
            self.ticket = ticket
            if is_preview and self.is_superseded():
                return self._reply([], "superseded")
            newest, oldest = self.revision, self.project_revision
            if not is_preview and revision is not None and not oldest <= revision <= newest:
                raise StaleRevision(f"expected revision {newest}, got {revision}")
            old = self.project
            if action.get("action") in ("undo", "redo"):
                message = self._move(str(action["action"]))
            else:
                try:
                    message = self._run(action)
                except CancelledError:
                    return self._reply([], "superseded")
                except BaseException:
                    if self.project is not old:
                        self.show(old)  # without the motions that were shown already
                    raise
            if is_preview:
                return views.preview(self, str(action["id"]))
            changed = [own.id for own in self.project.motions if own not in old.motions]
            return self._reply(changed, message)

    def _run(self, action: Mapping[str, Any]) -> str:
        old = self.project
        with captured_warnings() as warned:
            project, text = run_action(self, action)
        for own in warned:
            self.note(own)
        if action.get("preview") is not True:
            self.set(project, text, old)
        return text

    def _move(self, direction: str) -> str:
        with self.lock:
            self.history, project, text = self.history.move(direction, self.project)
            self.set(project, None)
        return f"{direction} {text}"

    def _reply(self, motions: list[str], message: str) -> Json:
        return {"revision": self.revision, "motions": motions, "message": message}

    def state(self) -> Json:
        """Return everything that the page shows, apart from poses."""
        with self.lock:
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
        with self.lock:
            self._n_questions += 1
            ticket = self._n_questions
        try:
            with cancellable(lambda: self._n_questions != ticket):
                return donors.find(self, question)
        except CancelledError:
            return {"donors": [], "total": 0, "superseded": True}

    def window(self, clip: str, first: int, last: int) -> Json:
        """Return the poses of a part of a clip."""
        return views.window(self, clip, first, last)

    def export(self, request: Mapping[str, Any]) -> Json:
        """Write motions to files; see `mograft.studio.export`."""
        return export.run(self, request)
