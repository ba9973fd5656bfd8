"""Files of a library: .npy files with a header of fixed length, and their damage."""

import contextlib
import hashlib
import io
import json
import math
import mmap
import os
import re
import sqlite3
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

    Otherwise everything that was read counts as memory of the process until it ends. Arrays that
    are not mapped stay as they are.
    """
    if isinstance(array.base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        array.base.madvise(mmap.MADV_DONTNEED)


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
