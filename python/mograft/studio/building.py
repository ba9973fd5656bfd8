"""The library of a session, which a thread builds."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from mograft._util.containers import SizedCache
from mograft.errors import MograftError
from mograft.studio import sources
from mograft.studio.desk import Desk
from mograft.studio.project import Project, ProjectMotion

_MAX_LIBRARIES = 4


class LibraryBuilder:
    """Builds the library of the present project of a desk, and keeps those of earlier ones."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._known = SizedCache[tuple[Any, ...], sources.Opened](_MAX_LIBRARIES)
        self._worker = ThreadPoolExecutor(1, "studio library")
        self._is_closed = False

    def update(self) -> None:
        """Build the library of the present project, if it is another one."""
        desk = self._desk
        with desk.lock:
            key = sources.library_key(desk.project)
            if key == desk.opened.key or self._is_closed:
                return
            desk.opened = replace(desk.opened, key=key, status="building", done=0, total=0)
            known = self._known.get(key)
            if known is not None:
                self._show(known)
        self._worker.submit(self._build, desk.project, key, known)

    def flush(self) -> None:
        """Wait until the library is built."""
        self._worker.submit(lambda: None).result()

    def close(self) -> None:
        """End the thread."""
        self._is_closed = True
        self._worker.shutdown(cancel_futures=True)

    def _is_old(self, key: tuple[Any, ...]) -> bool:
        return key != self._desk.opened.key or self._is_closed

    def _build(self, project: Project, key: tuple[Any, ...], opened: sources.Opened | None) -> None:
        """Build a library that is not known, then its motions, and find the faults of its clips."""
        desk = self._desk

        def progress(text: str, done: int, total: int) -> None:
            with desk.lock:
                if self._is_old(key):
                    raise _NotWantedError
                desk.opened = replace(desk.opened, done=done, total=total)
            event = {"kind": "progress", "id": "library", "text": text}
            desk.emit({**event, "done": done, "total": total})

        if self._is_old(key):
            return
        if opened is None:
            try:
                opened = sources.build(project, progress)
            except _NotWantedError:
                return
            except Exception as error:  # it is shown; the session goes on
                opened = sources.Opened(key, status="failed", message=str(error))
            with desk.lock:
                if not self._show(opened):
                    return
                desk.add_hashes()
                desk.save()
            desk.notify()
        for own in desk.project.motions:
            if self._is_old(key):
                return
            self._restore(own)
        found = sources.with_faults(opened, should_stop=lambda: self._is_old(key))
        if self._show(found):
            desk.notify()

    def _show(self, opened: sources.Opened) -> bool:
        """Show and keep a library; return False if it is not that of the present project."""
        desk = self._desk
        with desk.lock:
            if self._is_old(opened.key):
                return False
            desk.opened = opened
            if opened.library is not None:
                self._known.put(opened.key, opened, 1)
                desk.workshop.set_library(opened.library)
        return True

    def _restore(self, own: ProjectMotion) -> None:
        """Build a motion of a project that was opened."""
        desk = self._desk
        try:
            if desk.workshop.find(own.record) is None:
                desk.workshop.graft(own.record)
                desk.notify()
        except (MograftError, OSError, ValueError) as error:
            desk.note(f"{desk.name_of(own)}: {error}")


class _NotWantedError(Exception):
    """The library that is built is not that of the present project."""
