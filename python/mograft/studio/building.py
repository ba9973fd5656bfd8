"""The library of a session, which a thread builds."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from mograft.errors import MograftError
from mograft.studio import sources
from mograft.studio.desk import Desk
from mograft.studio.project import Project, ProjectMotion

_MAX_LIBRARIES = 4


class LibraryBuilder:
    """Builds the library of the present project of a desk, and keeps those of earlier ones."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._known: dict[tuple[Any, ...], sources.Opened] = {}
        self._worker = ThreadPoolExecutor(1, "studio library")
        self._is_closed = False

    def update(self) -> None:
        """Build the library of the present project, if it is another one."""
        desk = self._desk
        with desk.lock:
            key = sources.library_key(desk.project)
            if key == desk.opened.key or self._is_closed:
                return
            if key in self._known:
                self._show(self._known[key])
                return
            desk.opened = replace(desk.opened, key=key, status="building", done=0, total=0)
        self._worker.submit(self._build, desk.project, key)

    def flush(self) -> None:
        """Wait until the library is built."""
        self._worker.submit(lambda: None).result()

    def close(self) -> None:
        """End the thread."""
        self._is_closed = True
        self._worker.shutdown(cancel_futures=True)

    def _build(self, project: Project, key: tuple[Any, ...]) -> None:
        desk = self._desk

        def is_old() -> bool:
            return key != desk.opened.key or self._is_closed

        def progress(text: str, done: int, total: int) -> None:
            with desk.lock:
                if is_old():
                    raise _NotWantedError
                desk.opened = replace(desk.opened, done=done, total=total)
            event = {"kind": "progress", "id": "library", "text": text}
            desk.emit({**event, "done": done, "total": total})

        try:
            if not is_old():
                self._finish(sources.build(project, progress), is_old)
        except _NotWantedError:
            return
        except Exception as error:  # it is shown; the session goes on
            self._finish(sources.Opened(key, status="failed", message=str(error)), is_old)

    def _finish(self, opened: sources.Opened, is_old: Callable[[], bool]) -> None:
        """Show a library; then find the faults of its clips, and build motions again."""
        desk = self._desk
        with desk.lock:
            if is_old():
                return
            while len(self._known) >= _MAX_LIBRARIES:
                del self._known[next(iter(self._known))]
            if opened.library is not None:
                self._known[opened.key] = opened
            self._show(opened)
            desk.add_hashes()
            desk.save()
        desk.notify()
        for own in desk.project.motions:
            if is_old():
                return
            self._restore(own)
        opened = sources.with_faults(opened, should_stop=is_old)
        with desk.lock:
            if is_old():
                return
            self._known[opened.key] = desk.opened = opened
        desk.notify()

    def _restore(self, own: ProjectMotion) -> None:
        """Build a motion of a project that was opened."""
        desk = self._desk
        try:
            if desk.workshop.find(own.record) is None:
                desk.workshop.graft(own.record)
                desk.notify()
        except (MograftError, OSError, ValueError) as error:
            desk.note(f"{desk.name_of(own)}: {error}")

    def _show(self, opened: sources.Opened) -> None:
        self._desk.opened = opened
        if opened.library is not None:
            self._desk.workshop.set_library(opened.library)


class _NotWantedError(Exception):
    """The library that is built is not that of the present project."""
