"""The file of a project: who may write it, and how it is saved after every action."""

import os
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
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
        self._state = _state(path)
        self._text: Callable[[], str] | None = None
        self._is_closed = self._is_writing = False
        self._condition = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="studio saving", daemon=True)
        self._thread.start()

    def save(self, text: Callable[[], str]) -> None:
        """Write the result of `text` soon; a newer text replaces one that waits."""
        with self._condition:
            self._text = text
            self._condition.notify_all()

    def flush(self) -> None:
        """Wait until everything is written."""
        with self._condition:
            self._condition.wait_for(lambda: self._text is None and not self._is_writing)

    def close(self) -> None:
        """Write what waits, and unlock the file."""
        with self._condition:
            self._is_closed = True
            self._condition.notify_all()
        self._thread.join()
        with suppress(OSError):
            self._lock_path.unlink()
        self._stack.close()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._text is not None or self._is_closed)
                text, self._text = self._text, None
                if text is None:
                    return
                self._is_writing = True
            try:
                self._write(text())
            except Exception as error:  # without the thread nothing would be saved any more
                self._report(f"the project is not saved: {error}")
            finally:
                with self._condition:
                    self._is_writing = False
                    self._condition.notify_all()

    def _write(self, text: str) -> None:
        """Write the file; beside it, if another program has changed it since it was written."""
        if _state(self.path) != self._state:
            stem, number = self.path.name.removesuffix(".json"), 2
            while (other := self.path.with_name(f"{stem} ({number}).json")).exists():
                number += 1
            self._report(f"another program changed {self.path.name}; saved as {other.name} instead")
            self.path = other
        write_text(self.path, text)
        self._state = _state(self.path)


def _state(path: Path) -> tuple[int, int, int] | None:
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns
