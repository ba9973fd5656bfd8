"""Array files of a library: .npy files with a header of fixed length."""

import contextlib
import errno
import io
import math
import mmap
import os
import re
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.lib.format as npy
import numpy.typing as npt

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


class RowFile:
    """Rows of an array file that `ArrayWriter` wrote, read when they are needed.

    On POSIX the file stays open, so that its rows can be read after another process removed it. On
    Windows it is opened for each read, because an open file cannot be removed there. Each read
    states its position, so that threads and forked processes can share the file.
    """

    def __init__(self, path: Path, dtype: str, width: int) -> None:
        self._path, self._dtype, self._width = path, np.dtype(dtype), width
        self._handle: int | None = None
        if os.name == "posix":
            self._handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            weakref.finalize(self, os.close, self._handle)

    def __reduce__(self) -> tuple[type["RowFile"], tuple[Path, str, int]]:
        return RowFile, (self._path, self._dtype.str, self._width)

    def read(self, first: int, n: int) -> npt.NDArray[Any]:
        """Return `n` rows from row `first` on, shape (n, width).

        Raise OSError if the file has fewer.
        """
        n_bytes = n * self._width * self._dtype.itemsize
        start = HEADER_BYTES + first * self._width * self._dtype.itemsize
        data = bytearray(n_bytes)  # writable, as other arrays
        if self._handle is not None:
            count = os.preadv(self._handle, [data], start)
        else:
            with self._path.open("rb") as stream:
                stream.seek(start)
                count = stream.readinto(data)
        if count < n_bytes:
            raise OSError(errno.EIO, "is shorter than its header states", str(self._path))
        return np.frombuffer(data, self._dtype).reshape(n, self._width)


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

    def read(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return the rows `start` to `stop - 1` of those that were appended."""
        width = math.prod(self._row_shape)
        with self._name_file_in_errors():
            self._stream.flush()
        with self._path.open("rb") as stream:
            stream.seek(HEADER_BYTES + start * width * self._dtype.itemsize)
            rows = np.fromfile(stream, self._dtype, (stop - start) * width)
        return rows.reshape(stop - start, *self._row_shape)

    def close(self) -> None:
        """Write the header and close the file."""
        header = io.BytesIO()
        shape = (self.n_rows, *self._row_shape)
        description = {"descr": self._dtype.str, "fortran_order": False, "shape": shape}
        npy.write_array_header_1_0(header, description)
        if len(header.getvalue()) != HEADER_BYTES:
            n_bytes = len(header.getvalue())
            raise RuntimeError(f"the .npy header must have {HEADER_BYTES} bytes, got {n_bytes}")
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
