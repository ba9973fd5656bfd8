"""Files of a library: .npy files with a header of fixed length, and their damage."""

import contextlib
import errno
import hashlib
import io
import json
import math
import mmap
import os
import re
import sqlite3
import weakref
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.lib.format as npy
import numpy.typing as npt

from mograft._util.arrays import IntArray
from mograft.errors import DAMAGE, LibraryError

MANIFEST, DATABASE = "manifest.json", "catalog.sqlite"

HEADER_BYTES = 128
"""Length of the headers that NumPy writes for arrays of at most four dimensions."""

_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00v\x00\{'descr': '(<f4|<f8|<i8|\|b1)', 'fortran_order': False, "
    rb"'shape': \(([0-9, ]+)\), \} *\n"
)


def map_array(path: Path) -> npt.NDArray[Any]:
    """Memory-map the array of a file that `ArrayWriter` wrote; the file may then be removed.

    Raise ValueError if the header is damaged or does not match the size of the file. A regular
    expression reads the header, because `numpy.lib.format` is many times slower, and because it can
    raise errors of Python's tokenizer for a damaged header, and warn about files of Python 2.
    """
    with path.open("rb") as stream:
        header = _HEADER.fullmatch(stream.read(HEADER_BYTES))
        data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    if header is not None:
        dtype = np.dtype(header[1].decode())
        shape = tuple(int(n) for n in header[2].split(b",") if n)
        if dtype.itemsize * math.prod(shape) == len(data) - HEADER_BYTES:
            return np.ndarray(shape, dtype, data, HEADER_BYTES)
    raise ValueError("the header is damaged or does not match the size of the file")


def release_pages(array: npt.NDArray[Any]) -> None:
    """Remove what was read of a mapped array from the memory of the process, but not of the system.

    Otherwise each clip that was read counts as memory of the process until it ends.
    """
    if isinstance(array.base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        array.base.madvise(mmap.MADV_DONTNEED)


def _close(handle: int) -> None:
    """Close a file that was read; Python would print the traceback of an error in a finalizer."""
    with contextlib.suppress(OSError):
        os.close(handle)


class RowFile:
    """Rows of an array file that `ArrayWriter` wrote, read when they are needed.

    On POSIX the file stays open, so that its rows can be read after another process removed it. On
    Windows it is opened for each read, because an open file cannot be removed there. Each read
    states its position, so that threads and forked processes can share the file.
    """

    def __init__(self, path: Path, dtype: str, width: int) -> None:
        self._path, self._dtype, self.width = path, np.dtype(dtype), width
        self._handle: int | None = None
        if os.name == "posix":
            self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            weakref.finalize(self, _close, self._handle)

    def __reduce__(self) -> tuple[type["RowFile"], tuple[Path, str, int]]:
        return RowFile, (self._path, self._dtype.str, self.width)

    def read(self, first: int, n: int) -> npt.NDArray[Any]:
        """Return `n` rows from row `first` on, shape (n, width).

        Raise OSError if the file has fewer.
        """
        n_bytes = n * self.width * self._dtype.itemsize
        start = HEADER_BYTES + first * self.width * self._dtype.itemsize
        data = bytearray(n_bytes)  # writable, as other arrays
        if self._handle is not None:
            count = os.preadv(self._handle, [data], start)
        else:
            with self._path.open("rb") as stream:
                stream.seek(start)
                count = stream.readinto(data)
        if count < n_bytes:
            raise OSError(errno.EIO, "is shorter than its header states", str(self._path))
        return np.frombuffer(data, self._dtype).reshape(n, self.width)


class ArrayWriter:
    """Write an array file row by row; `close` writes the header.

    `dtype` includes the byte order; `row_shape` is the shape of one row.
    """

    def __init__(self, path: Path, dtype: str, row_shape: tuple[int, ...]) -> None:
        self.n_rows = 0
        self._path, self._dtype, self._row_shape = path, np.dtype(dtype), row_shape
        self._stream = path.open("w+b")
        self._stream.write(bytes(HEADER_BYTES))

    def append(self, rows: npt.NDArray[Any]) -> None:
        """Append rows, shape (n, *row_shape)."""
        self.n_rows += len(rows)
        with self._name_file_in_errors():
            self._stream.write(np.ascontiguousarray(rows, self._dtype).data)

    def read(self, rows: IntArray) -> npt.NDArray[Any]:
        """Return some of the rows that were appended, by their indices."""
        with self._name_file_in_errors():
            self._stream.flush()
        shape = (self.n_rows, *self._row_shape)
        return np.memmap(self._path, self._dtype, "r", HEADER_BYTES, shape)[rows]

    def close(self) -> None:
        """Write the header and close the file."""
        header = io.BytesIO()
        shape = (self.n_rows, *self._row_shape)
        description = {"descr": self._dtype.str, "fortran_order": False, "shape": shape}
        npy.write_array_header_1_0(header, description)
        with self._name_file_in_errors():
            self._stream.seek(0)
            self._stream.write(header.getvalue())
            self._stream.close()

    def abandon(self) -> None:
        """Close the file without writing its header; the caller must remove the file."""
        with contextlib.suppress(OSError):  # unwritten rows are not needed
            self._stream.close()

    @contextlib.contextmanager
    def _name_file_in_errors(self) -> Iterator[None]:
        """Add the name of the file to an OSError, such as that of a full disk."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error


def damage(folder: Path, reason: str) -> LibraryError:
    """Return the error for a damaged library."""
    return LibraryError(
        f"{folder} is damaged: {reason}. Restore a copy, or build it again: "
        f"mograft index CLIPS -o {folder} --force"
    )


@contextlib.contextmanager
def damage_raises_library_error(folder: Path, name: str) -> Iterator[None]:
    """Convert errors that invalid content of the file `name` causes to LibraryError."""
    try:
        yield
    except (*DAMAGE, sqlite3.Error) as error:
        raise damage(folder, f"{name}: {error or type(error).__name__}") from error


def manifest_checksum(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a manifest, computed without its entry ``checksum``."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def hash_files(folder: Path, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the size (``bytes``) and the SHA-256 (``sha256``) of files in a folder, by name."""

    def hash_file(name: str) -> dict[str, Any]:
        with (folder / name).open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
            return {"bytes": stream.tell(), "sha256": sha256}

    with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:
        return dict(zip(names, pool.map(hash_file, names), strict=True))
