"""Exceptions that mograft raises."""

from collections.abc import Collection, Sequence
from pathlib import Path


class MograftError(Exception):
    """Base class of all exceptions of mograft."""


class BvhError(MograftError, ValueError):
    """Invalid BVH file; the message starts with path, line and column.

    Parameters
    ----------
    message : str
        What was expected and what was found.
    path : str or Path
        The file, or a name for the stream that was read; stored as a str attribute.
    line, column : int, optional
        Position of the error, counted from 1; stored as attributes.
    """

    def __init__(
        self, message: str, path: str | Path, line: int | None = None, column: int | None = None
    ) -> None:
        self.path = str(path)
        self.line = line
        self.column = column
        place = ":".join(str(part) for part in (path, line, column) if part is not None)
        super().__init__(f"{place}: {message}")
        self.message = message

    def __reduce__(self) -> tuple[type, tuple[str, str, int | None, int | None]]:
        """Pickle the constructor arguments, so that worker processes can return the error."""
        return type(self), (self.message, self.path, self.line, self.column)


class ProvenanceError(MograftError, ValueError):
    """The provenance of a graft is damaged, or its library or files are missing or have changed."""


class SkeletonMismatchError(MograftError, ValueError):
    """Motions have different skeletons; the message names the joints that differ."""


class LibraryError(MograftError):
    """A folder is not a library, or its library is damaged or has an unsupported version."""


class InsufficientDataError(MograftError, ValueError):
    """There is too little data to compute a measure; the message names what is missing."""


def suggest_name(
    name: object, names: Collection[str], prefix: str = "", cutoff: float = 0.6
) -> str:
    """Return "; did you mean 'X'?" for the most similar X of `names`, or "" if none is similar.

    All `names` begin with `prefix`, which is not compared. Names are similar if the ratio of
    `difflib` is at least `cutoff`.
    """
    from difflib import get_close_matches  # only for the message: 20 ms

    if not isinstance(name, str):
        return ""
    words = [known.removeprefix(prefix) for known in names]
    close = get_close_matches(name.removeprefix(prefix), words, n=1, cutoff=cutoff)
    return f"; did you mean {prefix + close[0]!r}?" if close else ""


def join_names(names: Sequence[str], maximum: int = 12) -> str:
    """Return the first `maximum` names, joined by commas, and the number of the other names."""
    more = f" and {len(names) - maximum} more" if len(names) > maximum else ""
    return ", ".join(names[:maximum]) + more
