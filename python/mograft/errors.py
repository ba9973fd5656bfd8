"""Exceptions that mograft raises."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

DAMAGE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What reading a damaged document raises."""


class MograftError(Exception):
    """Base class of all exceptions of mograft."""


class FormatError(MograftError, ValueError):
    """Invalid motion file; the message starts with the file and the place in it.

    Parameters
    ----------
    message : str
        What was expected and what was found.
    path : str or Path
        The file, or a name for the stream that was read; stored as a str attribute.
    place : str, optional
        Where in the file, such as ``accessors[3]`` or ``byte 20``; stored as an attribute.
    """

    def __init__(self, message: str, path: str | Path, place: str | None = None) -> None:
        self.message = message
        self.path = str(path)
        self.place = place
        start = self.path if place is None else f"{path}: {place}"
        super().__init__(f"{start}: {message}")

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        """Pickle the constructor arguments, so that worker processes can return the error."""
        return type(self), (self.message, self.path, self.place)


class MemoryBudgetError(MograftError, MemoryError):
    """The work needs more memory than the system has available, and was not begun."""


class BvhError(FormatError):
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
        place = ":".join(str(part) for part in (path, line, column) if part is not None)
        super().__init__(message, place)
        self.path = str(path)
        self.line = line
        self.column = column

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
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
    return f"; did you mean {prefix + close[0]!r}?" if close and close[0] != name else ""


def suggest_frames(frames: tuple[int, int], last: int, shortest: int = 0) -> str:
    """Return "got A-B; did you mean C-D?" for frames that end after the frame `last`.

    C-D is the part of A-B up to `last`, or if that is not two frames, the last frames of a motion,
    as many as in A-B, and at least `shortest` + 1. A range of one frame is written as A.
    """
    n = max(frames[1] - frames[0], shortest)
    stop = min(frames[0] + n, last)
    start = frames[0] if frames[0] + max(min(n, 1), shortest) <= stop else max(stop - n, 0)
    given, meant = (f"{a}-{b}" if a < b else f"{a}" for a, b in (frames, (start, stop)))
    return f"got {given}; did you mean {meant}?"


def suggest_path(path: str | Path) -> str:
    """Return "; did you mean 'X'?" for a path that does not exist, or "".

    X is the most similar path in the folder of the first missing part of the path, or one that
    differs in its suffix. If none is similar, the files there with the suffix of the path are
    listed.
    """
    missing = [own for own in (Path(path), *Path(path).parents) if not own.exists()]
    if not missing or not missing[-1].parent.is_dir():
        return ""
    folder = missing[-1].parent
    beside = [str(folder / own.name) for own in sorted(folder.iterdir())]
    prefix = str(missing[-1])[: -len(missing[-1].name)]
    twins = [own for own in beside if Path(own).stem == missing[-1].stem]  # of another format
    close = suggest_name(str(missing[-1]), twins or beside, prefix, cutoff=0.7 * (not twins))
    suffix = missing[-1].suffix.lower()
    same = [own for own in beside if suffix and own.lower().endswith(suffix)]
    return close or (f"; the folder has {join_names(same, 5)}" if same else "")


def join_names(names: Sequence[str], maximum: int = 12) -> str:
    """Return the first `maximum` names, joined by commas, and the number of the other names."""
    more = f" and {len(names) - maximum} more" if len(names) > maximum else ""
    return ", ".join(names[:maximum]) + more
