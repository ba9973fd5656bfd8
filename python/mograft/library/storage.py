"""Libraries on disk: a folder of arrays, a catalogue, and a manifest that vouches for both.

::

    NAME/manifest.json        what the library is, and the SHA-256 of every other file
    NAME/0003/                its third generation
        catalog.sqlite        clips, skeletons, segments, labels: for SQL, and for opening
        frames-0001.npy       the clips' numbers as they were read, float64, one after the other
        frames-0003.npy       those that were added in this generation
        samples-0001.npy      the segments' samples, float32, one row each
        starts.npy ...        the segments
        0/points.npy ...      the first joint group: embedding, labels, poses at the ends

Files of a generation never change, and what the next one has in common with it is linked, not
copied. A generation counts from the moment when the manifest that names it takes the old
one's place: whenever writing stops, by a crash or otherwise, there is the old library or the
new one. Readers need no lock; writers take one, which ends with their process.
"""

import contextlib
import hashlib
import json
import math
import mmap
import os
import re
import shutil
import sqlite3
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, overload

import numpy as np
import numpy.typing as npt

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import FloatArray, IntArray, Packed
from mograft.analysis.embedding import CHUNK, Samples
from mograft.errors import LibraryError
from mograft.library import clip_table as catalogue
from mograft.library.clip_table import ClipInfo, ClipLocation
from mograft.library.ingest import IngestedClip, PackedMotion, rates_match, unpack
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = [
    "GenerationWriter",
    "StoredClips",
    "StoredLibrary",
    "StoredSamples",
    "list_leftovers",
    "read",
    "verify",
    "write_generation",
]

FORMAT, FORMAT_VERSION = "mograft.library", 1
MANIFEST, CATALOGUE, LOCK = "manifest.json", "catalog.sqlite", ".lock"

_MOST_SHARDS = 16
"""Generations whose clips lie in files of their own; one more, and all are written anew."""

_CLIPS_IN_HAND = 16
"""Clips that are kept once they are read: a graft asks for the same few again and again."""


class StoredClips(Sequence[Motion]):
    """The clips of a stored library, each read when it is asked for."""

    def __init__(
        self,
        entries: Sequence[ClipInfo],
        places: Sequence[ClipLocation],
        skeletons: Sequence[Skeleton],
        frames: Sequence[FloatArray],
        rate: float,
    ) -> None:
        self.entries, self.places, self.skeletons = entries, places, skeletons
        self._frames, self._rate = frames, rate
        self._in_hand: OrderedDict[int, Motion] = OrderedDict()

    def __len__(self) -> int:
        return len(self.entries)

    @overload
    def __getitem__(self, index: int) -> Motion: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Motion, ...]: ...
    def __getitem__(self, index: int | slice) -> Motion | tuple[Motion, ...]:
        if isinstance(index, slice):
            return tuple(self[at] for at in range(*index.indices(len(self))))
        at = range(len(self))[index]
        known = self._in_hand.get(at)
        if known is None:
            known = self.original(at)
            if not rates_match(known.rate, self._rate):
                known = known.resample(self._rate)
            self._in_hand[at] = known
            if len(self._in_hand) > _CLIPS_IN_HAND:
                self._in_hand.popitem(last=False)
        return known

    def original(self, index: int, *, as_read: bool = False) -> Motion:
        """Return a clip at its own rate; `as_read`, at the one that its file gives."""
        entry, place = self.entries[index], self.places[index]
        frame_time = place.frame_time
        if entry.rate_override is not None and not as_read:
            frame_time = 1.0 / entry.rate_override
        return unpack(
            PackedMotion(
                place.content,
                self._frames[place.shard][
                    place.first_number : place.first_number + place.n_numbers
                ],
                self.skeletons[place.skeleton],
                frame_time,
                entry.source_frames,
                entry.source_name if as_read else entry.name,
                None if entry.source_file is None else entry.source_file.path,
                place.repairs,
            )
        )


class ExtendedClips(Sequence[Motion]):
    """Clips and one more."""

    def __init__(self, clips: Sequence[Motion], last: Motion) -> None:
        self._clips, self._last = clips, last

    def __len__(self) -> int:
        return len(self._clips) + 1

    @overload
    def __getitem__(self, index: int) -> Motion: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Motion, ...]: ...
    def __getitem__(self, index: int | slice) -> Motion | tuple[Motion, ...]:
        if isinstance(index, slice):
            return tuple(self[at] for at in range(*index.indices(len(self))))
        at = range(len(self))[index]
        return self._last if at == len(self._clips) else self._clips[at]


@dataclass(frozen=True)
class StoredSamples:
    """Samples of all segments, in the order of the library, from the files that hold them.

    Read by `chunks` into memory of their own, not mapped: a page that is mapped and was seen
    once would count as the process's for as long as it runs.

    Attributes
    ----------
    files : tuple of Path
        The ``samples`` files.
    extents : tuple of (int, int, int)
        Runs of rows: file, first row, number of rows.
    n_samples, n_joints : int
        What a row holds.
    """

    files: tuple[Path, ...]
    extents: tuple[tuple[int, int, int], ...]
    n_samples: int
    n_joints: int

    def __len__(self) -> int:
        return sum(n for _, _, n in self.extents)

    def chunks(self) -> Iterator[Samples]:
        """Yield `CHUNK` segments at a time."""
        for rows in self._rows():
            yield Samples(rows, self.n_samples, self.n_joints)

    def _rows(self) -> Iterator[Packed]:
        width = self.n_samples * (4 * self.n_joints + 3) + 1
        with contextlib.ExitStack() as stack:
            streams = [stack.enter_context(path.open("rb")) for path in self.files]
            waiting: list[Packed] = []
            held = 0
            for shard, first, n in self.extents:
                done = 0
                while done < n:
                    take = min(n - done, CHUNK - held)
                    streams[shard].seek(_HEADER + 4 * width * (first + done))
                    part = np.fromfile(streams[shard], "<f4", take * width).reshape(take, width)
                    waiting.append(part)
                    held, done = held + take, done + take
                    if held == CHUNK:
                        yield waiting[0] if len(waiting) == 1 else np.concatenate(waiting)
                        waiting, held = [], 0
            if waiting:
                yield np.concatenate(waiting)


@dataclass(frozen=True, eq=False)
class StoredLibrary:
    """A stored library as its files say it.

    Attributes
    ----------
    folder : Path
        The library.
    manifest : dict
        Its manifest.
    entries, places, skeletons
        The catalogue.
    refused : dict of str to str
        Files that were left out, and why.
    arrays : dict of str to ndarray
        All arrays but ``samples``, by path within the generation without ending, mapped.
    """

    folder: Path
    manifest: dict[str, Any]
    entries: tuple[ClipInfo, ...]
    places: tuple[ClipLocation, ...]
    skeletons: tuple[Skeleton, ...]
    refused: dict[str, str]
    arrays: dict[str, npt.NDArray[Any]]

    def samples(self) -> StoredSamples:
        """Return where the samples are."""
        counts = np.bincount(self.arrays["clips"], minlength=len(self.entries)).tolist()
        folder = self.folder / self.manifest["generation"]
        return StoredSamples(
            tuple(folder / f"samples-{name}.npy" for name in self.manifest["shards"]),
            merge_ranges(
                [
                    (place.shard, place.first_row, n)
                    for place, n in zip(self.places, counts, strict=True)
                ]
            ),
            self.manifest["config"]["samples"],
            len(self.manifest["skeleton"]["names"]),
        )


def merge_ranges(extents: Sequence[tuple[int, int, int]]) -> tuple[tuple[int, int, int], ...]:
    """Join runs of rows that follow one another."""
    found: list[tuple[int, int, int]] = []
    for shard, first, n in extents:
        if found and found[-1][0] == shard and sum(found[-1][1:]) == first:
            found[-1] = (shard, found[-1][1], found[-1][2] + n)
        else:
            found.append((shard, first, n))
    return tuple(found)


# Reading.


def read(folder: Path) -> StoredLibrary:
    """Open a library.

    Parameters
    ----------
    folder : Path
        The library.

    Returns
    -------
    Contents
        With every array mapped, so that it stays whole when another process writes the next
        generation.

    Raises
    ------
    LibraryError
        If it is damaged, foreign or newer.
    FileNotFoundError
        If there is nothing of that name.
    """
    for _ in range(8):
        manifest = read_manifest(folder)
        try:
            return _read_generation(folder, manifest)
        except FileNotFoundError as error:
            # Unless another process has just put the next generation in this one's place.
            if read_manifest(folder) == manifest:
                raise _damaged(folder, f"{Path(error.filename).name} is missing") from error
    raise LibraryError(f"{folder} is written again and again; try later")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a library, checked."""
    if not folder.exists():
        raise FileNotFoundError(2, "no such library", str(folder))
    try:
        document = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except NotADirectoryError as error:
        raise LibraryError(f"{folder} is no mograft library: it is a file") from error
    except FileNotFoundError as error:
        raise LibraryError(
            f"{folder} is no mograft library: it has no {MANIFEST}; "
            f"make one with: mograft index CLIPS -o {folder}"
        ) from error
    except ValueError as error:
        raise _damaged(folder, f"{MANIFEST} is no JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise LibraryError(f"{folder} is no mograft library: its {MANIFEST} is of another format")
    version = document.get("version")
    if not isinstance(version, int):
        raise _damaged(folder, f"{MANIFEST} has no version")
    if version > FORMAT_VERSION:
        raise LibraryError(
            f"{folder} has format version {version}, made by mograft {document.get('mograft')}; "
            f"this is mograft {VERSION}, which reads up to version {FORMAT_VERSION}: upgrade it"
        )
    if document.get("checksum") != _checksum(document):
        raise _damaged(folder, f"{MANIFEST} does not agree with its checksum")
    return document


def _read_generation(folder: Path, manifest: dict[str, Any]) -> StoredLibrary:
    arrays = {}
    inside = manifest["generation"] + "/"
    for name, seal in manifest["files"].items():
        path = folder / name
        size = path.stat().st_size
        if size != seal["bytes"]:
            raise _damaged(folder, f"{name} has {size} bytes, not {seal['bytes']}")
        key = name.removeprefix(inside).removesuffix(".npy")
        if name.endswith(".npy") and not key.startswith("samples-"):
            try:
                arrays[key] = _mapped(path)
            except ValueError as error:
                raise _damaged(folder, f"{name}: {error}") from error
    try:
        return StoredLibrary(folder, manifest, *catalogue.read(folder / inside / CATALOGUE), arrays)
    except (sqlite3.Error, KeyError, TypeError, ValueError) as error:
        raise _damaged(folder, f"{CATALOGUE}: {error}") from error


def _mapped(path: Path) -> npt.NDArray[Any]:
    # np.load takes a header for any Python, which is slow for the dozens that are mapped at each
    # opening, and raises what its parser does.
    with path.open("rb") as stream:
        header = _WRITTEN.fullmatch(stream.read(_HEADER))
        numbers = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    if header is not None:
        dtype = np.dtype(header[1].decode())
        shape = tuple(int(n) for n in header[2].split(b",") if n)
        if dtype.itemsize * math.prod(shape) == len(numbers) - _HEADER:
            return np.ndarray(shape, dtype, numbers, _HEADER)
    raise ValueError("its header is not what was written")


def _damaged(folder: Path, what: str) -> LibraryError:
    return LibraryError(
        f"{folder} is damaged: {what}. Restore it from a copy, or build it anew: "
        f"mograft index CLIPS -o {folder} --force"
    )


def verify(folder: Path) -> list[str]:
    """Compare every byte of a library with what was written.

    Parameters
    ----------
    folder : Path
        The library.

    Returns
    -------
    list of str
        What is wrong, file by file; empty if nothing is.

    Raises
    ------
    LibraryError
        If not even the manifest can be read.
    """
    manifest = read_manifest(folder)
    wrong = []
    seals = _seals(folder, [name for name in manifest["files"] if (folder / name).is_file()])
    for name, seal in manifest["files"].items():
        if name not in seals:
            wrong.append(f"{name} is missing")
        elif seals[name]["bytes"] != seal["bytes"]:
            wrong.append(f"{name} has {seals[name]['bytes']} bytes, not {seal['bytes']}")
        elif seals[name] != seal:
            wrong.append(f"{name} is not what was written: its SHA-256 differs")
    if not wrong:
        try:
            read(folder)
        except LibraryError as error:
            wrong.append(str(error))
    return wrong


def list_leftovers(folder: Path) -> list[str]:
    """Return what an interrupted write has left in a library; the next write removes it."""
    manifest = read_manifest(folder)
    known = {MANIFEST, LOCK, manifest["generation"]}
    return sorted(path.name for path in folder.iterdir() if path.name not in known)


def _checksum(document: Mapping[str, Any]) -> str:
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _seals(folder: Path, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    def seal(name: str) -> dict[str, Any]:
        with (folder / name).open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
            return {"bytes": stream.tell(), "sha256": sha256}

    with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as threads:
        return dict(zip(names, threads.map(seal, names), strict=True))


# Writing.

_HEADER, _MAGIC = 128, b"\x93NUMPY\x01\x00v\x00"
_WRITTEN = re.compile(
    re.escape(_MAGIC) + rb"\{'descr': '(<f4|<f8|<i8|\|b1)', 'fortran_order': False, "
    rb"'shape': \(([0-9, ]+)\), \} *\n"
)
"""What `_npy_header` writes."""


def _npy_header(dtype: str, shape: tuple[int, ...]) -> bytes:
    """Return a header of the .npy format that has the same length whatever the shape."""
    text = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape!r}, }}"
    return _MAGIC + text.ljust(_HEADER - 11).encode() + b"\n"


class ArrayWriter:
    """An array file that rows are appended to; its header is written when it is done."""

    def __init__(self, path: Path, dtype: str, row: tuple[int, ...]) -> None:
        self.path, self.rows = path, 0
        self._dtype, self._row = np.dtype(dtype), row
        self._stream = path.open("w+b")
        self._stream.write(bytes(_HEADER))

    def append(self, rows: npt.NDArray[Any]) -> None:
        self.rows += len(rows)
        with self._named():
            self._stream.write(np.ascontiguousarray(rows, self._dtype).data)

    def read(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return rows that were appended."""
        width = int(np.prod(self._row, dtype=np.int64))
        with self._named():
            self._stream.flush()
        with self.path.open("rb") as stream:
            stream.seek(_HEADER + start * width * self._dtype.itemsize)
            found = np.fromfile(stream, self._dtype, (stop - start) * width)
        return found.reshape(stop - start, *self._row)

    def close(self) -> None:
        with self._named():
            self._stream.seek(0)
            self._stream.write(_npy_header(self._dtype.str, (self.rows, *self._row)))
            self._stream.close()

    def abandon(self) -> None:
        with contextlib.suppress(OSError):  # what is lost was not to be kept
            self._stream.close()

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        """Say of what file it is if the disk is full."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error


class GenerationWriter:
    """The next generation of a library, while it is written; made by `writing`.

    Attributes
    ----------
    base : Contents or None
        The generation before, if there is one to go on from.
    shards : list of str
        Names of the files that hold frames and samples.
    """

    def __init__(self, root: Path, final: Path, base: StoredLibrary | None, number: int) -> None:
        self.base = base
        self.shards: list[str] = []
        self._root, self.final = root, final
        self._generation = f"{number:04d}"
        self._seals: dict[str, dict[str, Any]] = {}
        self._open: dict[str, ArrayWriter] = {}
        self._names: list[str] = []
        self._skeletons: dict[str, int] = {}
        self.folder = root / self._generation
        self.folder.mkdir()

    def go_on(self) -> None:
        """Take over the frames and samples of the generation before."""
        if self.base is None:
            raise RuntimeError("there is no generation before")
        before = self.base.manifest
        for shard in before["shards"]:
            self.shards.append(shard)
            for stem in ("frames", "samples"):
                name = f"{stem}-{shard}.npy"
                seal = before["files"][f"{before['generation']}/{name}"]
                self._link(self.base.folder / before["generation"] / name, name)
                self._seals[f"{self._generation}/{name}"] = seal
        for skeleton in self.base.skeletons:
            self._skeleton(skeleton)

    def _link(self, source: Path, name: str) -> None:
        try:
            os.link(source, self.folder / name)
        except OSError:
            # Not every file system has links.
            shutil.copyfile(source, self.folder / name)

    def restart(self) -> None:
        """Forget all that was taken, and begin a shard of this generation's own."""
        self.abandon()
        for path in self.folder.iterdir():
            path.unlink()
        self._seals.clear()
        self._names.clear()
        self._skeletons.clear()
        self.shards.clear()
        self._open.clear()

    def take(self, digest: IngestedClip) -> ClipLocation:
        """Write a clip's numbers, samples and edges."""
        stored = digest.clip
        if not isinstance(stored, PackedMotion):
            raise TypeError("a draft takes clips as numbers")
        row = 0
        if f"samples-{self._generation}" in self._open:
            row = self._open[f"samples-{self._generation}"].rows
        place = self.take_frames(stored, row)
        self.take_samples(digest.samples)
        for key, values in digest.boundary_states.items():
            self._growing(f"edges-{key}", "<f8", values.shape[1:]).append(values)
        return place

    def take_frames(self, stored: PackedMotion, row: int) -> ClipLocation:
        """Write a clip's numbers, whose samples will begin in some row."""
        if self._generation not in self.shards:
            self.shards.append(self._generation)
        frames = self._growing(f"frames-{self._generation}", "<f8", ())
        place = ClipLocation(
            self.shards.index(self._generation),
            frames.rows,
            len(stored.numbers),
            row,
            stored.content,
            stored.frame_time,
            stored.repairs,
            self._skeleton(stored.skeleton),
        )
        frames.append(stored.numbers)
        return place

    def take_samples(self, rows: Packed) -> None:
        """Write samples of clips."""
        self._growing(f"samples-{self._generation}", "<f4", rows.shape[1:]).append(rows)

    def fresh_edges(self, key: str, start: int, stop: int) -> npt.NDArray[Any]:
        """Return rows of the edges of the clips taken, all joints."""
        return self._open[f"edges-{key}"].read(start, stop)

    def _growing(self, name: str, dtype: str, row: tuple[int, ...]) -> ArrayWriter:
        if name not in self._open:
            self._open[name] = ArrayWriter(self.folder / f"{name}.npy", dtype, row)
        return self._open[name]

    def _skeleton(self, skeleton: Skeleton) -> int:
        return self._skeletons.setdefault(catalogue.skeleton_text(skeleton), len(self._skeletons))

    def samples(
        self, extents: Sequence[tuple[int, int, int]], n_samples: int, n_joints: int
    ) -> StoredSamples:
        """Return the samples of the library that is being written."""
        self._shelve()
        files = tuple(self.folder / f"samples-{shard}.npy" for shard in self.shards)
        return StoredSamples(files, merge_ranges(extents), n_samples, n_joints)

    def _shelve(self) -> None:
        """Close the files of frames and samples: they are complete."""
        for name in [name for name in self._open if name.startswith(("samples-", "frames-"))]:
            self._open.pop(name).close()
            self._names.append(f"{name}.npy")

    def is_scattered(self, places: Sequence[ClipLocation]) -> bool:
        """Tell whether clips lie in too many files, or these hold too much that is of no use."""
        if len(self.shards) > _MOST_SHARDS:
            return True
        used = sum(place.n_numbers for place in places)
        before = [self.folder / f"frames-{shard}.npy" for shard in self.shards]
        held = sum(
            path.stat().st_size for path in before if path.name != f"frames-{self._generation}.npy"
        )
        return 8 * used < held / 2

    def edge_keys(self) -> list[str]:
        """Return the names of the edges taken."""
        return [name.removeprefix("edges-") for name in self._open if name.startswith("edges-")]

    def write_array(
        self, name: str, dtype: str, pieces: Iterator[npt.NDArray[Any]] | npt.NDArray[Any]
    ) -> None:
        """Write an array, piece by piece."""
        path = self.folder / f"{name}.npy"
        path.parent.mkdir(exist_ok=True)
        several = iter([pieces]) if isinstance(pieces, np.ndarray) else pieces
        for piece in several:
            self._growing(name, dtype, piece.shape[1:]).append(piece)
        if name in self._open:
            self._open.pop(name).close()
            self._names.append(f"{name}.npy")

    def write_catalogue(
        self,
        entries: Sequence[ClipInfo],
        places: Sequence[ClipLocation],
        refused: Mapping[str, str],
        segments: npt.NDArray[np.int64],
        labels: Mapping[str, IntArray],
    ) -> None:
        """Write what is known of clips, segments and labels, as tables.

        `segments` has the columns clip, start, stop and is_donor.
        """
        catalogue.write(
            self.folder / CATALOGUE,
            entries,
            places,
            tuple(self._skeletons),
            refused,
            segments,
            labels,
            self.final,
        )
        self._names.append(CATALOGUE)

    def commit(self, about: Mapping[str, Any]) -> None:
        """Make this generation the library."""
        self._shelve()
        self.abandon()  # the edges of whole clips, of which each group has its own now
        for path in self.folder.glob("edges-*.npy"):
            path.unlink()
        names = [f"{self._generation}/{name}" for name in self._names]
        self._seals |= _seals(self._root, names)
        document = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "mograft": VERSION,
            "generation": self._generation,
            **about,
            "shards": self.shards,
            "files": dict(sorted(self._seals.items())),
        }
        document["checksum"] = _checksum(document)
        for name in names:
            _sync(self._root / name)
        _sync(self.folder)
        draft = self._root / f"{MANIFEST}.{self._generation}"
        draft.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        _sync(draft)
        draft.replace(self._root / MANIFEST)
        _sync(self._root)
        if self._root != self.final:
            self._root.rename(self.final)
            _sync(self.final.parent)

    def abandon(self) -> None:
        """Close the files that are not complete."""
        for growing in self._open.values():
            growing.abandon()

    @property
    def skeletons(self) -> tuple[Skeleton, ...]:
        """The skeletons of the clips taken."""
        return tuple(map(catalogue.read_skeleton, self._skeletons))


@contextlib.contextmanager
def write_generation(
    path: Path, *, force: bool = False, add: bool = False
) -> Iterator[GenerationWriter]:
    """Begin the next generation of a library, which counts once it is committed.

    Parameters
    ----------
    path : Path
        The library.
    force : bool
        Put another library in the place of one that is there.
    add : bool
        Go on from the library that is there.

    Yields
    ------
    Draft
        What to write to. What is not committed is gone afterwards.

    Raises
    ------
    FileExistsError
        If there is a library already.
    LibraryError
        If something else is there, or another process is writing.
    """
    final = Path(os.path.abspath(path))
    final.parent.mkdir(parents=True, exist_ok=True)
    exists = final.exists() and (not final.is_dir() or any(final.iterdir()))
    if not exists and not add:
        _sweep(final)
        partial = final.with_name(f".{final.name}.partial-{os.getpid()}")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        try:
            with _locked(partial):
                yield from _drafted(GenerationWriter(partial, final, None, 1))
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        return
    if exists and not add and not force:
        raise FileExistsError(17, "is there already; --force (force=True) overwrites", str(path))
    if not add:
        _check_ours(final)
    with _locked(final):
        base = read(final) if add else None
        try:
            number = int(read_manifest(final)["generation"]) + 1
        except LibraryError:
            number = _free_number(final)
        kept = {MANIFEST, LOCK, f"{number - 1:04d}"}
        _remove(final, kept)
        draft = GenerationWriter(final, final, base, number)
        try:
            yield from _drafted(draft)
        finally:
            with contextlib.suppress(LibraryError, OSError):
                _remove(final, {MANIFEST, LOCK, read_manifest(final)["generation"]})


def _drafted(draft: GenerationWriter) -> Iterator[GenerationWriter]:
    try:
        yield draft
    finally:
        draft.abandon()


def _check_ours(folder: Path) -> None:
    """Check that what is to be overwritten is a library, though perhaps a damaged one."""
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if MANIFEST not in names or not all(
        name in (MANIFEST, LOCK) or name[:4].isdigit() or name.startswith(f"{MANIFEST}.")
        for name in names
    ):
        raise LibraryError(
            f"{folder} is no mograft library: it is not overwritten; remove it first"
        )


def _free_number(folder: Path) -> int:
    taken = [int(path.name) for path in folder.iterdir() if path.name.isdigit()]
    return max(taken, default=0) + 1


def _remove(folder: Path, kept: set[str]) -> None:
    for path in folder.iterdir():
        if path.name in kept or not (path.name.isdigit() or path.name.startswith(f"{MANIFEST}.")):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _sweep(final: Path) -> None:
    """Remove what killed processes have left of libraries of that name."""
    for path in final.parent.glob(f".{_escaped(final.name)}.partial-*"):
        with contextlib.suppress(LibraryError, OSError), _locked(path):
            shutil.rmtree(path, ignore_errors=True)


def _escaped(name: str) -> str:
    import glob

    return glob.escape(name)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of those that write to a folder; it ends with the process at the latest."""
    with (folder / LOCK).open("ab") as stream:
        _lock(stream, folder)
        yield


def _lock(stream: IO[bytes], folder: Path) -> None:
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LibraryError(f"another process is writing to {folder}; try again later") from error


def _sync(path: Path) -> None:
    """See that a file, or the names in a folder, have reached the disk."""
    flags = os.O_RDONLY
    try:
        handle = os.open(path, flags)
    except OSError:
        return  # folders cannot be opened everywhere
    try:
        with contextlib.suppress(OSError):
            os.fsync(handle)
    finally:
        os.close(handle)
