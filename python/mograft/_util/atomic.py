"""Atomic file writes: a file is replaced as a whole or not at all. Locks between processes."""

import errno
import hashlib
import os
import platform
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from mograft._util.signals import clean_up_by

_DRAFT_ENDING = ".part"
"""Ending of draft folders, which no scan for clips enters."""


@contextmanager
def atomic_path(target: Path) -> Iterator[Path]:
    """Yield a temporary path; the file written there replaces `target` when the block succeeds.

    The file is synced before the replacement, and its folder after it. A power failure within the
    block leaves the old or the new file, and one after the block leaves the new file. The
    temporary file is in a `draft_folder` and has the name of `target`, because some writers choose
    the format by suffix. The permissions of an existing `target` are kept. Raises OSError if
    `target` is a symbolic link to a missing file or a folder, or if its folder does not exist.
    """
    path = Path(os.path.realpath(target))
    if target.is_symlink() and not path.exists():
        raise FileExistsError(errno.EEXIST, "is a symbolic link to a missing file", str(target))
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(target.parent))
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, expected a file", str(target))
    with draft_folder(path) as folder:
        draft = folder / path.name
        yield draft
        sync(draft)
        with suppress(OSError):  # no such file, or a file system without permissions
            draft.chmod(stat.S_IMODE(path.stat().st_mode))
        draft.replace(path)
        sync(path.parent)


@contextmanager
def checked_path(target: Path, is_whole: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield a temporary path as `atomic_path`, for a file that another library writes.

    Libraries ignore errors of the system, for example short writes. `is_whole` reads the file
    again; OSError is raised and `target` kept unless it returns True.
    """
    with atomic_path(target) as draft:
        yield draft
        try:
            error, is_good = None, is_whole(draft)
        except Exception as caught:  # each library has its own
            error, is_good = caught, False
        if not is_good:
            raise OSError(errno.EIO, "was written incompletely", str(target)) from error


def sync(path: Path) -> None:
    """Flush a file, or the entries of a folder, to the disk.

    Has no effect on a folder if the platform or the file system cannot sync folders.
    """
    is_folder = path.is_dir()
    if is_folder and os.name != "posix":
        return
    # Windows syncs only files that are open for writing.
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if not is_folder or error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(handle)


@contextmanager
def draft_folder(target: Path) -> Iterator[Path]:
    """Create a temporary folder beside `target`, yield its path, and remove it afterwards.

    First, it removes the folders that ended processes of this computer have left for the same
    target.
    """
    parent = target.parent
    key = _short_hash(target.name)
    prefix = f".mograft-{key}-{_short_hash(platform.node())}-"
    _remove_stale_drafts(parent, prefix)
    folder = parent / f"{prefix}{os.getpid()}-{os.urandom(4).hex()}{_DRAFT_ENDING}"
    with clean_up_by(lambda: shutil.rmtree(folder, ignore_errors=True)):
        folder.mkdir(mode=0o700)
        yield folder


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes `target` when the block succeeds.

    Its entries are synced, and the folder of `target` after it. Raises OSError if `target` is then
    a file, or a folder with files.
    """
    with draft_folder(target) as folder:
        draft = folder / target.name
        draft.mkdir()
        yield draft
        sync(draft)
        draft.replace(target)
        sync(target.parent)


def _short_hash(text: str) -> str:
    return hashlib.sha256(os.fsencode(text)).hexdigest()[:12]


def _remove_stale_drafts(parent: Path, prefix: str) -> None:
    """Remove the draft folders whose names begin with `prefix` and whose process has ended."""
    try:
        names = os.listdir(parent)
    except OSError:
        return  # a folder may be writable and not readable
    for name in names:
        if name.startswith(prefix) and name.endswith(_DRAFT_ENDING):
            number = name.removeprefix(prefix).partition("-")[0]
            if number.isdigit() and not _is_running(int(number)):
                shutil.rmtree(parent / name, ignore_errors=True)


if sys.platform == "win32":
    import ctypes

    def _is_running(process_id: int) -> bool:
        """Return whether a process exists, without `os.kill`, which could end it on Windows."""
        synchronize = 0x00100000
        handle = ctypes.windll.kernel32.OpenProcess(synchronize, 0, process_id)
        if handle:
            ctypes.windll.kernel32.CloseHandle(handle)
        return bool(handle)

else:

    def _is_running(process_id: int) -> bool:
        """Return whether a process exists."""
        try:
            os.kill(process_id, 0)
        except ProcessLookupError:
            return False
        except (OSError, OverflowError):
            return True  # the process of another user
        return True


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically."""
    with checked_path(path, lambda draft: draft.stat().st_size == len(data)) as draft:
        draft.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write text atomically as UTF-8, without conversion of line endings."""
    write_bytes(path, text.encode("utf-8"))


@contextmanager
def exclusive_lock(path: Path) -> Iterator[None]:
    """Lock a file until the block ends; raise BlockingIOError if the file is already locked.

    The file is created if it does not exist, stays empty and is not removed. The operating system
    releases the lock when the process ends, for whatever reason. The lock excludes other processes
    and other calls in this process. Raises OSError if the file system has no locks.
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
    import fcntl

    def _acquire(stream: IO[bytes], _: Path) -> None:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
