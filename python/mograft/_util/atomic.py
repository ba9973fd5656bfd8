"""Files that are there whole or not at all."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["atomic_path", "write_bytes", "write_text"]


@contextmanager
def atomic_path(target: Path) -> Iterator[Path]:
    """Give another name to write to, which takes the target's once all is written.

    It lies in the target's folder and has its ending, by which some writers go.
    """
    path = Path(os.path.realpath(target))
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(target.parent))
    draft = path.with_name(f".{path.stem}.{os.urandom(4).hex()}{path.suffix}")
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, where a file is wanted", str(target))
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all."""
    with atomic_path(path) as draft:
        draft.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write text as UTF-8, with the line ends that it has."""
    write_bytes(path, text.encode("utf-8"))
