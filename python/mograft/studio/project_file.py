"""The file of a project: who may write it, and how it is saved after every action."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
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
        self._text: Callable[[], str] | None = None
        self._worker = ThreadPoolExecutor(1, "studio saving")

    @property
    def name(self) -> str:
        """The name of the project."""
        return self.path.name.removesuffix(".json").removesuffix(".project")

    def save(self, text: Callable[[], str]) -> None:
        """Write the result of `text` soon; a newer text replaces one that waits."""
        self._text = text
        self._worker.submit(self._write_latest)

    def flush(self) -> None:
        """Wait until everything is written."""
        self._worker.submit(lambda: None).result()

    def close(self) -> None:
        """Write what waits, and unlock the file."""
        self._worker.shutdown()
        with suppress(OSError):
            self._lock_path.unlink()
        self._stack.close()

    def _write_latest(self) -> None:
        text, self._text = self._text, None
        if text is None:  # an earlier call has written it
            return
        try:
            write_text(self.path, text())
        except Exception as error:  # the session goes on
            self._report(f"the project is not saved: {error}")
