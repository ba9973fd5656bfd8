"""Exclusive locks between processes, from the standard library of each platform."""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def exclusive_lock(path: Path) -> Iterator[None]:
    """Lock a file until the block ends; raise BlockingIOError if the file is already locked.

    The file is created if it does not exist, stays empty and is not removed. The operating system
    releases the lock when the process ends, for whatever reason. The lock excludes other processes
    and other calls in this process. Raises OSError if the platform or the file system has no locks.
    The lock is ``flock`` on POSIX, and `msvcrt.locking` of the first byte on Windows.
    """
    with path.open("ab") as stream:
        _acquire(stream, path)
        yield


if sys.platform == "win32":
    import msvcrt

    def _acquire(stream: IO[bytes], path: Path) -> None:
        os.lseek(stream.fileno(), 0, os.SEEK_SET)
        try:
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(errno.EAGAIN, "is locked", str(path)) from error

else:

    def _acquire(stream: IO[bytes], path: Path) -> None:
        try:
            import fcntl
        except ModuleNotFoundError as error:
            raise OSError(errno.ENOLCK, "this platform has no file locks", str(path)) from error
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
