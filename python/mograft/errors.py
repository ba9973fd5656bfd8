"""What mograft raises."""

from collections.abc import Sequence
from pathlib import Path

__all__ = [
    "BvhError",
    "InsufficientDataError",
    "LibraryError",
    "MograftError",
    "SkeletonMismatchError",
]


class MograftError(Exception):
    """Base of all errors that are mograft's own."""


class BvhError(MograftError, ValueError):
    """A file that is no BVH motion, with the place where it stops being one.

    Parameters
    ----------
    message : str
        What was expected and what came.
    path : str or Path
        The file, or a name for what was read instead of one.
    line, column : int, optional
        Where it came, counted from 1.

    Attributes
    ----------
    path, line, column
        As given.
    """

    def __init__(
        self,
        message: str,
        path: str | Path,
        line: int | None = None,
        column: int | None = None,
    ) -> None:
        self.path = str(path)
        self.line = line
        self.column = column
        place = ":".join(str(part) for part in (path, line, column) if part is not None)
        super().__init__(f"{place}: {message}")
        self.message = message

    def __reduce__(self) -> tuple[type, tuple[str, str, int | None, int | None]]:
        """Pickle by arguments, so that the error crosses process borders whole."""
        return type(self), (self.message, self.path, self.line, self.column)


class SkeletonMismatchError(MograftError, ValueError):
    """Motions of different skeletons where one is needed; names the joints that differ."""


class LibraryError(MograftError):
    """A library on disk that is damaged, foreign or of another version."""


class InsufficientDataError(MograftError, ValueError):
    """Data that cannot support a measure; says what is missing."""


def join_names(names: Sequence[str], most: int = 12) -> str:
    """Return names as a message gives them: all of a few, of many the first."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
