"""The arrays of an NPZ file, checked before memory is allocated; pickled objects are not read."""

import errno
import io
import math
import re
import shutil
import threading
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

import numpy as np
import numpy.lib.format as npy
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray, Shape
from mograft._util.atomic import atomic_path
from mograft.errors import FormatError
from mograft.motion import limits

MAX_ARRAY_BYTES = 2**30
"""Largest array that is read: about two hours of SMPL-H poses at 120 fps in float64."""

_LONG = re.compile(rb"(?<=[0-9])L")
"""The mark of integers in headers that Python 2 wrote, about which NumPy warns."""

_PARSER = threading.Lock()
"""NumPy parses headers by `ast`, which fails at random in several threads in Python 3.11.0 to
3.11.7 (CPython issue 106905)."""

_MAX_HEADER_BYTES = 10_000  # as NumPy, with the bytes before the text
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # those that NumPy writes


@dataclass(frozen=True)
class ArrayHeader:
    """Shape and type of an array, from the header in the file."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    is_fortran: bool  # whether the first index varies fastest
    header_bytes: int  # size of the header

    @property
    def n_bytes(self) -> int:
        """Size of all elements in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def is_pickled(self) -> bool:
        """Whether the elements are pickled Python objects, which are never read."""
        return bool(self.dtype.hasobject)


@dataclass(frozen=True)
class NpzArchive:
    """The headers of all arrays of an NPZ file; `open_npz_archive` reads them."""

    path: Path
    headers: Mapping[str, ArrayHeader]

    def read(self, name: str, shape: Shape) -> npt.NDArray[Any]:
        """Return an array of the given shape; a string in `shape` stands for any length.

        Raises `FormatError` if the array is missing, has another shape or more than 1 GiB, is
        pickled or is damaged.
        """
        header = self.header(name, shape)
        if header.n_bytes > MAX_ARRAY_BYTES:
            gibibytes = header.n_bytes / 2**30
            raise self.error(name, f"expected at most 1 GiB, got {gibibytes:.1f} GiB")
        with _named_errors(self.path, name), zipfile.ZipFile(self.path) as archive:
            info = archive.getinfo(f"{name}.npy")
            if info.file_size != header.header_bytes + header.n_bytes:
                raise self.error(
                    name,
                    f"expected {header.n_bytes} bytes for shape {header.shape} and type "
                    f"{header.dtype}, got {info.file_size - header.header_bytes}",
                )
            with archive.open(info) as member:
                member.read(header.header_bytes)
                data = member.read(header.n_bytes)
        if len(data) != header.n_bytes:
            raise self.error(name, f"expected {header.n_bytes} bytes, got {len(data)}")
        elements = np.frombuffer(data, header.dtype)
        if header.is_fortran:
            return elements.reshape(header.shape[::-1]).T
        return elements.reshape(header.shape)

    def read_floats(self, name: str, shape: Shape) -> FloatArray:
        """Return an array of finite real numbers as float64.

        Raises the errors of `read`, and `FormatError` if there are other elements.
        """
        array = self.read(name, shape)
        if array.dtype.kind not in "fiu":
            raise self.error(name, f"expected real numbers, got {array.dtype}")
        with np.errstate(over="ignore"):  # the range of float128 is larger
            floats = np.ascontiguousarray(array, np.float64).reshape(array.shape)
        finite = np.isfinite(floats)
        if not finite.all():
            index = [int(i) for i in np.argwhere(~finite)[0]]
            raise self.error(
                name, f"expected finite numbers, got {floats[tuple(index)]} at {index}"
            )
        return floats

    def read_integers(self, name: str, shape: Shape) -> IntArray:
        """Return an array of integers as int64.

        Raises the errors of `read`, and `FormatError` if there are other elements.
        """
        array = self.read(name, shape)
        if array.dtype.kind not in "iu":
            raise self.error(name, f"expected integers, got {array.dtype}")
        return array.astype(np.int64)

    def read_strings(self, name: str, shape: Shape) -> npt.NDArray[np.str_]:
        """Return an array of text.

        Raises the errors of `read`, and `FormatError` if there are other elements or long texts.
        """
        n_characters = self.header(name, shape).dtype.itemsize // 4
        if n_characters > limits.MAX_NAME_CHARACTERS:
            raise self.error(
                name,
                f"expected at most {limits.MAX_NAME_CHARACTERS} characters, got {n_characters}",
            )
        array = self.read(name, shape)
        if array.dtype.kind != "U":
            raise self.error(name, f"expected text, got {array.dtype}")
        return array

    def header(self, name: str, shape: Shape) -> ArrayHeader:
        """Return the header of an array; shape and errors are as for `read`."""
        if name not in self.headers:
            raise self.error(name, "expected this array, got none of this name")
        header = self.headers[name]
        fits = len(header.shape) == len(shape) and all(
            isinstance(want, str) or want == length
            for want, length in zip(shape, header.shape, strict=True)
        )
        if not fits:
            wanted = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
            raise self.error(name, f"expected shape ({wanted}), got {header.shape}")
        if header.is_pickled:
            raise self.error(name, "expected numbers, got pickled objects, which are not read")
        return header

    def error(self, name: str, message: str) -> FormatError:
        """Return the error for an array."""
        return FormatError(message, self.path, f"array `{name}`")


def open_npz_archive(path: Path) -> NpzArchive:
    """Read the headers of all arrays of an NPZ file.

    Raises `FormatError` if the file is not an NPZ file or a header is damaged, and OSError if the
    file cannot be read.
    """
    headers = {}
    with _named_errors(path, None), zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            if name == info.filename:
                continue
            with _named_errors(path, name):
                if info.compress_type not in _METHODS or info.flag_bits & 1:
                    raise ValueError(
                        "expected an array without a password, uncompressed or deflated"
                    )
                with archive.open(info) as member:
                    headers[name] = _read_header(member)
    return NpzArchive(path, MappingProxyType(headers))


def copy_npz_archive(
    source: NpzArchive, target: Path, replaced: Mapping[str, npt.NDArray[Any]], omitted: set[str]
) -> None:
    """Copy an NPZ file; replace some of its arrays and omit others.

    `replaced` holds arrays by name, `omitted` names. The other members of the archive keep their
    content and their compression, and all keep their order. The same arguments give the same bytes.
    """
    with (
        atomic_path(target) as draft,
        _named_errors(source.path, None),
        zipfile.ZipFile(source.path) as old,
        zipfile.ZipFile(draft, "w") as new,
    ):
        for info in old.infolist():
            name = info.filename.removesuffix(".npy")
            if name in omitted:
                continue
            member = zipfile.ZipInfo(info.filename)  # of 1980: files contain no present dates
            member.compress_type = info.compress_type
            member.external_attr = info.external_attr
            with new.open(member, "w", force_zip64=True) as out:
                if name in replaced:
                    npy.write_array(out, replaced[name], allow_pickle=False)
                else:
                    with old.open(info) as data:
                        shutil.copyfileobj(data, out)


def _read_header(member: IO[bytes]) -> ArrayHeader:
    """Read the header of an array at the start of its member; raise ValueError if it is damaged."""
    # NumPy would read as many bytes as a damaged header claims.
    start = io.BytesIO(_LONG.sub(b" ", member.read(_MAX_HEADER_BYTES)))
    # Version 3 differs from version 2 only in the encoding of field names.
    is_first = npy.read_magic(start) == (1, 0)
    evaluate = npy.read_array_header_1_0 if is_first else npy.read_array_header_2_0
    try:
        with _PARSER:
            shape, is_fortran, dtype = evaluate(start)
    except MemoryError:  # Python's parser raises it for deep expressions
        raise ValueError("expected the header of a NumPy array, got a deep expression") from None
    if any(length < 0 for length in shape):
        raise ValueError(f"expected a shape without negative lengths, got {shape}")
    return ArrayHeader(shape, dtype, is_fortran, start.tell())


@contextmanager
def _named_errors(path: Path, name: str | None) -> Iterator[None]:
    """Convert the errors of a damaged archive to `FormatError`, for the array `name` if not None.

    zipfile, zlib and NumPy raise exceptions of many classes for damaged files. MemoryError is not
    converted: the file may be valid.
    """
    try:
        yield
    except (FormatError, MemoryError):
        raise
    except Exception as error:
        # zipfile seeks to offsets that a damaged directory states, even negative ones.
        if isinstance(error, OSError) and error.errno != errno.EINVAL:
            raise
        if name is None:
            raise FormatError(f"expected an NPZ file: {error}", path) from error
        raise FormatError(f"damaged: {error}", path, f"array `{name}`") from error
