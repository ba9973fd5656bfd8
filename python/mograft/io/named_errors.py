"""Errors of values in files, which name the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mograft.errors import FormatError


@contextmanager
def errors_of_file(path: str | Path, place: str | None = None) -> Iterator[None]:
    """Convert ValueError and TypeError to `FormatError`, which names the file and the place."""
    try:
        yield
    except FormatError:
        raise
    except (TypeError, ValueError) as error:
        raise FormatError(str(error), path, place) from error
