"""NPZ: motions as NumPy arrays; the arrays of any NPZ file, checked before memory is allocated.

Pickled objects are not read.
"""

import errno
import io
import math
import os
import re
import shutil
import sys
import threading
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import numpy.lib.format as npy
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray, Shape, fits_shape
from mograft._util.atomic import atomic_path, write_bytes
from mograft._util.names import unique_names
from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips, errors_of_file
from mograft.io.export_figure import check_single_precision
from mograft.motion import limits
from mograft.motion.motion import Motion, as_motions
from mograft.motion.skeleton import EndSite, Skeleton

_FORMAT = "mograft.motion/1"

MAX_ARRAY_BYTES = 2**30
"""Largest array that is read: about two hours of SMPL-H poses at 120 fps in float64."""

_LONG = re.compile(rb"(?<=[0-9])L")
"""The mark of integers in headers that Python 2 wrote, about which NumPy warns."""

_PARSER = threading.Lock()
"""NumPy parses headers by `ast`, which fails at random in several threads in Python 3.11.0 to
3.11.7 (CPython issue 106905)."""

_MAX_HEADER_BYTES = 10_000  # as NumPy, with the bytes before the text
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # those that NumPy writes


class ArrayHeader(NamedTuple):
    """Shape and type of an array, from the header in the file."""

    shape: tuple[int, ...]
    is_fortran: bool  # whether the first index varies fastest
    dtype: np.dtype[Any]
    header_bytes: int  # size of the header

    @property
    def n_bytes(self) -> int:
        """Size of all elements in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize


class NpzArchive(NamedTuple):
    """The headers of all arrays of an NPZ file; `open_npz_archive` reads them."""

    path: Path
    headers: Mapping[str, ArrayHeader]
    prefix: str = ""  # of the arrays in the file

    def read(self, name: str, shape: Shape, kinds: str = "", content: str = "") -> npt.NDArray[Any]:
        """Return an array of the given shape; a string in `shape` stands for any length.

        `kinds` holds the accepted kinds of its type, as NumPy abbreviates them, and `content`
        describes them; by default all are accepted. Raises `FormatError` if the array is missing,
        has another shape or type, or more than 1 GiB, is pickled or is damaged.
        """
        header = self.header(name, shape)
        if header.n_bytes > MAX_ARRAY_BYTES:
            got = f"{header.n_bytes / 2**30:.1f} GiB"
            raise self.error(name, f"expected at most 1 GiB, got {got}")
        if kinds and header.dtype.kind not in kinds:
            raise self.error(name, f"expected {content}, got {header.dtype}")
        with _named_errors(self.path, name), zipfile.ZipFile(self.path) as archive:
            info = archive.getinfo(f"{self.prefix}{name}.npy")
            if (n_bytes := info.file_size - header.header_bytes) != header.n_bytes:
                expected = (
                    f"{header.n_bytes} bytes for shape {header.shape} and type {header.dtype}"
                )
                raise self.error(name, f"expected {expected}, got {n_bytes}")
            with archive.open(info) as member:
                member.read(header.header_bytes)
                elements = np.frombuffer(member.read(header.n_bytes), header.dtype)
            if header.dtype.kind == "U":
                numbers = elements.view(header.dtype.byteorder + "u4")
                if numbers.max(initial=0) > sys.maxunicode:
                    raise self.error(name, "expected text, got numbers that are no characters")
            return elements.reshape(header.shape, order="F" if header.is_fortran else "C")

    def read_floats(self, name: str, shape: Shape) -> FloatArray:
        """Return an array of finite real numbers as float64.

        Raises the errors of `read`, and `FormatError` if there are other elements.
        """
        array = self.read(name, shape, "fiu", "real numbers")
        with np.errstate(over="ignore"):  # the range of float128 is larger
            floats = np.ascontiguousarray(array, np.float64).reshape(array.shape)
        if not np.isfinite(floats).all():
            index = np.argwhere(~np.isfinite(floats))[0].tolist()
            got = f"{floats[tuple(index)]} at {index}"
            raise self.error(name, f"expected finite numbers, got {got}")
        return floats

    def read_integers(self, name: str, shape: Shape) -> IntArray:
        """Return an array of integers as int64; errors are as for `read`."""
        return self.read(name, shape, "iu", "integers").astype(np.int64)

    def read_strings(self, name: str, shape: Shape) -> list[str]:
        """Return the texts of an array; errors are as for `read`."""
        return self.read(name, shape, "U", "text").tolist()

    def header(self, name: str, shape: Shape) -> ArrayHeader:
        """Return the header of an array; shape and errors are as for `read`."""
        header = self.headers.get(f"{self.prefix}{name}")
        if header is None:
            raise self.error(name, "expected this array, got none of this name")
        if not fits_shape(header.shape, shape):
            wanted = str(shape).replace("'", "")
            raise self.error(name, f"expected shape {wanted}, got {header.shape}")
        if header.dtype.hasobject:
            raise self.error(name, "expected numbers, got pickled objects, which are not read")
        return header

    def error(self, name: str, message: str) -> FormatError:
        """Return the error for an array."""
        return FormatError(message, self.path, f"array `{self.prefix}{name}`")


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
                if info.compress_type not in _METHODS:
                    raise ValueError("expected an array that is uncompressed or deflated")
                with archive.open(info) as member:
                    headers[name] = _read_header(member)
    return NpzArchive(path, headers)


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
            header = evaluate(start)
    except MemoryError:  # Python's parser raises it for deep expressions
        raise ValueError("expected the header of a NumPy array, got a deep expression") from None
    if not all(type(length) is int and length >= 0 for length in header[0]):
        raise ValueError(f"expected a shape of lengths from 0 on, got {header[0]}")
    return ArrayHeader(*header, start.tell())


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


def write_npz(
    motions: Motion | Sequence[Motion],
    path: str | os.PathLike[str],
    *,
    provenance: Sequence[str] = (),
) -> None:
    """Write motions as compressed NumPy arrays.

    Parameters
    ----------
    motions : Motion or sequence of Motion
        The motions.
    path : str or path
        The file to write.
    provenance : sequence of str
        For each motion the text of the JSON document that describes how it was made. Default: none.

    Raises
    ------
    ValueError
        If there is no motion, or a coordinate exceeds 1e38.
    OSError
        If the file cannot be written.

    Notes
    -----
    The arrays of the first motion, for F frames and J joints, lengths in the unit of the motion:

    - ``rotations`` (F, J, 4), local, xyzw; ``positions`` (F, J, 3), local; ``world_positions``
      (F, J, 3); all float32
    - ``offsets`` (J, 3) and ``frame_time``, float64
    - ``parents`` (J,), ``names`` (J,), ``channels`` (J,): the channels of each joint, separated
      by spaces
    - ``end_parents``, ``end_offsets``, ``end_before`` and ``end_names`` of the end sites, with the
      meaning of the fields of `EndSite`
    - ``name`` of the motion, ``format``, which identifies this format, and ``provenance``

    Those of the second motion have the same names after ``1/``, and so on. No array is pickled.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.npz"
    >>> write_npz(dance(strides=1).motion, target)
    >>> np.load(target)["rotations"].shape
    (1508, 18, 4)
    """
    arrays: dict[str, Any] = {}
    for index, motion in enumerate(as_motions(motions)):
        text = provenance[index : index + 1]
        own = _to_arrays(motion) | ({"provenance": np.array(text[0])} if text else {})
        arrays |= {f"{_prefix(index)}{name}": array for name, array in own.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(Path(path), buffer.getvalue())


def _prefix(index: int) -> str:
    """Return the prefix of the arrays of a motion."""
    return f"{index}/" if index else ""


def _to_arrays(motion: Motion) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a motion by name."""
    skeleton = motion.skeleton
    sites = skeleton.end_sites
    world_positions = motion.world_positions()
    check_single_precision("position", motion.positions, skeleton)
    check_single_precision("world position", world_positions, skeleton)
    return {
        "format": np.array(_FORMAT),
        "name": np.array(_to_strings([motion.name])[0]),
        "frame_time": np.array(motion.frame_time),
        "names": _to_strings(skeleton.names),
        "parents": skeleton.parents,
        "offsets": skeleton.offsets,
        "channels": _to_strings([" ".join(channels) for channels in skeleton.channels]),
        "end_parents": np.array([site.parent for site in sites], np.int64),
        "end_offsets": np.array([site.offset for site in sites]).reshape(-1, 3),
        "end_before": np.array([site.before for site in sites], np.int64),
        "end_names": _to_strings([site.name for site in sites]),
        "rotations": motion.rotations.astype(np.float32),
        "positions": motion.positions.astype(np.float32),
        "world_positions": world_positions.astype(np.float32),
    }


def open_npz(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clips of an NPZ file; see `mograft.io.formats.Opener`."""
    archive = open_npz_archive(path)
    parts = [archive]
    while f"{_prefix(len(parts))}format" in archive.headers:
        parts.append(archive._replace(prefix=_prefix(len(parts))))
    names, is_single = [path.stem], len(parts) == 1
    if not is_single:
        names = unique_names([str(own.read("name", (), "U", "text")) for own in parts])

    def load(clip: int) -> Motion:
        with errors_of_file(path):
            motion = _to_motion(parts[clip])
            motion = motion if is_single else replace(motion, name=names[clip])
            return motion if rate is None else motion.resample(rate)

    grafts = {
        name: str(own.read("provenance", (), "U", "text"))
        for name, own in zip(names, parts, strict=True)
        if f"{own.prefix}provenance" in archive.headers
    }
    return Clips(path, tuple(names), load, "NPZ", grafts=grafts)


def _to_motion(archive: NpzArchive) -> Motion:
    """Return the motion in a file; if it has no name, it is named after the file."""
    if f"{archive.prefix}format" not in archive.headers:
        kimodo = "Kimodo (`posed_joints`, `global_rot_mats`)"
        expected = f"the arrays of mograft (`format`), AMASS (`poses`, `trans`) or {kimodo}"
        got = join_names(sorted(archive.headers)) or "no arrays"
        raise FormatError(f"expected {expected}, got {got}", archive.path)
    given = str(archive.read("format", (), "U", "text"))
    if given != _FORMAT:
        raise archive.error("format", f"expected {_FORMAT}, got {given}")
    (n_joints,) = archive.header("names", ("n_joints",)).shape
    (n_sites,) = archive.header("end_parents", ("n_end_sites",)).shape
    n_frames = archive.header("rotations", ("n_frames", n_joints, 4)).shape[0]
    limits.check_joints(n_joints)
    integers, floats, strings = archive.read_integers, archive.read_floats, archive.read_strings
    owners, tips = integers("end_parents", (n_sites,)).tolist(), floats("end_offsets", (n_sites, 3))
    ranks, titles = integers("end_before", (n_sites,)).tolist(), strings("end_names", (n_sites,))
    names, parents = tuple(strings("names", (n_joints,))), integers("parents", (n_joints,))
    offsets = floats("offsets", (n_joints, 3))
    channels = tuple(tuple(own.split()) for own in strings("channels", (n_joints,)))
    sites = tuple(map(EndSite, owners, tips, ranks, titles))
    skeleton = Skeleton(names, parents, offsets, channels, sites)
    quats = floats("rotations", (n_frames, n_joints, 4))
    norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    quats = quats / np.where(norms > 0, norms, 1.0)
    seconds = float(floats("frame_time", ()))
    places = floats("positions", (n_frames, n_joints, 3))
    name = str(archive.read("name", (), "U", "text")) or archive.path.stem
    return Motion(skeleton, seconds, quats, places, name=name, path=archive.path)


def _to_strings(values: Sequence[str]) -> npt.NDArray[np.str_]:
    """Return an array of strings; lone surrogates, which UTF-8 cannot encode, become ``?``."""
    return np.array([v.encode("utf-8", "replace").decode() for v in values], dtype=np.str_)
