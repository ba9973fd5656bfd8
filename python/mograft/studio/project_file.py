"""The file of a project: who may write it, and how it is saved after every action."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from itertools import count
from pathlib import Path

from mograft._util.atomic import exclusive_lock, write_text
from mograft.errors import MograftError


class ProjectFile:
    """A project file, which is locked until `close`, and a thread that writes it.

    Raises MograftError if another session has the file open.
    """

    def __init__(self, path: Path, report: Callable[[str], None]) -> None:
        self.path, self._report = path, report
        self._lock_path = path.with_name(f".{path.name}.lock")
        self._stack = ExitStack()
        try:
            self._stack.enter_context(exclusive_lock(self._lock_path))
        except BlockingIOError:
            raise MograftError(f"{path} is open in another session") from None
        self._written = _state(path)
        self._text: Callable[[], str] | None = None
        self._worker = ThreadPoolExecutor(1, "studio saving")

    @property
    def name(self) -> str:
        """The name of the project."""
        return self.path.name.removesuffix(".json").removesuffix(".project")

    def save(self, text: Callable[[], str]) -> None:
        """Write the result of `text` soon; a newer text replaces one that waits."""
        self._text = text
        with suppress(RuntimeError):  # closed
            self._worker.submit(self._write_latest, text)

    def flush(self) -> None:
        """Wait until everything is written."""
        self._worker.submit(lambda: None).result()

    def close(self) -> None:
        """Write what waits, and unlock the file."""
        self._worker.shutdown()
        with suppress(OSError):
            self._lock_path.unlink()
        self._stack.close()

    def _write_latest(self, text: Callable[[], str]) -> None:
        if text is not self._text:  # a newer one waits
            return
        try:
            self._write(text())
        except Exception as error:  # the session goes on
            self._report(f"the project is not saved: {error}")

    def _write(self, text: str) -> None:
        """Write the file; beside it, if another program has changed it since it was written."""
        if _state(self.path) != self._written:
            stem = self.path.name.removesuffix(".json")
            others = (self.path.with_name(f"{stem} ({n}).json") for n in count(2))
            other = next(path for path in others if not path.exists())
            self._report(f"another program changed {self.path.name}; saved as {other.name} instead")
            self.path = other
        write_text(self.path, text)
        self._written = _state(self.path)


def _state(path: Path) -> tuple[int, int, int] | None:
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns
