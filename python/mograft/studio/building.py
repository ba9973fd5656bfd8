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
            known = self._known.get(key)
            if known is None:
                desk.opened = replace(desk.opened, key=key, status="building", done=0, total=0)
            else:
                self._show(known)
        self._worker.submit(self._build, desk.project, key, known)

    def flush(self) -> None:
        """Wait until the library is built."""
        self._worker.submit(lambda: None).result()

    def close(self) -> None:
        """End the thread."""
        self._is_closed = True
        self._worker.shutdown(cancel_futures=True)

    def _build(self, project: Project, key: tuple[Any, ...], known: sources.Opened | None) -> None:
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

        if is_old():
            return
        opened = known
        if opened is None:
            try:
                opened = sources.build(project, progress)
            except _NotWantedError:
                return
            except Exception as error:  # it is shown; the session goes on
                opened = sources.Opened(key, status="failed", message=str(error))
            self._add(opened, is_old)
        self._complete(opened, is_old)

    def _add(self, opened: sources.Opened, is_old: Callable[[], bool]) -> None:
        """Show a library that was built, and keep it."""
        desk = self._desk
        with desk.lock:
            if is_old():
                return
            if opened.library is not None:
                while len(self._known) >= _MAX_LIBRARIES:
                    del self._known[next(iter(self._known))]
                self._known[opened.key] = opened
            self._show(opened)
            desk.add_hashes()
            desk.save()
        desk.notify()

    def _complete(self, opened: sources.Opened, is_old: Callable[[], bool]) -> None:
        """Build motions again, and find the faults of the clips of the library that is shown."""
        desk = self._desk
        for own in desk.project.motions:
            if is_old():
                return
            self._restore(own)
        opened = sources.with_faults(opened, should_stop=is_old)
        with desk.lock:
            if is_old():
                return
            desk.opened = opened
            if opened.library is not None:
                self._known[opened.key] = opened
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
