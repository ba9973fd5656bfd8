"""Write libraries to folders: the next generation of a library, in the format of `storage`."""

import contextlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import FloatArray, IntArray, Packed
from mograft._util.atomic import atomic_folder, exclusive_lock, sync
from mograft._util.signals import clean_up_by
from mograft.errors import LibraryError, join_names
from mograft.library.clip_table import ClipLocation, ClipTable, skeleton_to_json, write_clip_table
from mograft.library.data import LibraryData
from mograft.library.files import array_files, storage, stored_clips
from mograft.library.files.array_files import DATABASE, MANIFEST, ArrayWriter
from mograft.library.ingest import IngestedClip
from mograft.library.ingest_run import check_storable
from mograft.motion.skeleton import Skeleton

MAX_SHARDS = 16
"""Generations whose clips may lie in separate files; beyond that all clips are written again."""

_States = Mapping[str, FloatArray | Iterator[FloatArray]]
BoundaryParts = Mapping[str, _States]
"""Boundary states by group and key: arrays, or their parts in order."""


class GenerationWriter:
    """Write the next generation of a library; `write_generation` creates the writer.

    A generation is one committed state of a library, in a folder that is named by its number.
    `final` is the folder of the library, and `root` the folder to write to: `final` or a temporary
    folder that is renamed to `final` at the end. `base` is the previous generation if clips are
    added to it. `number` is that of the new generation. A shard is a pair of files with the frames
    and the samples of clips; later generations link it. `shards` are the names of all shards, which
    are those of the generations that wrote them.
    """

    def __init__(
        self, root: Path, final: Path, base: storage.StoredLibrary | None, number: int
    ) -> None:
        self.base, self.final = base, final
        self._root = root
        self._generation = f"{number:04d}"
        self._writers: dict[str, ArrayWriter] = {}
        self.folder = root / self._generation
        self.restart()

    def restart(self) -> None:
        """Discard everything that was written or linked; the folder of the generation is empty."""
        self.abandon()
        if self.folder.exists():
            shutil.rmtree(self.folder)
        self.folder.mkdir()
        self.shards: list[str] = []
        self._linked_hashes: dict[str, dict[str, Any]] = {}
        self._writers.clear()
        self._skeletons: dict[str, tuple[int, Skeleton]] = {}

    def link_shards(self, base: storage.StoredLibrary) -> None:
        """Link the shards of the previous generation into the new one."""
        for shard in base.manifest["shards"]:
            self.shards.append(shard)
            for stem in ("frames", "samples"):
                name = f"{stem}-{shard}.npy"
                source = f"{base.manifest['generation']}/{name}"
                try:
                    os.link(base.folder / source, self.folder / name)
                except OSError:  # some file systems have no hard links
                    shutil.copyfile(base.folder / source, self.folder / name)
                self._linked_hashes[f"{self._generation}/{name}"] = base.manifest["files"][source]
        for skeleton in base.table.skeletons:
            self._skeleton_index(skeleton)

    def write_clip(self, clip: IngestedClip) -> ClipLocation:
        """Write the packed motion, the samples and the boundary states of a clip."""
        assert isinstance(clip.clip, stored_clips.PackedMotion)
        samples = self._writers.get(f"samples-{self._generation}")
        location = self.write_frames(clip.clip, 0 if samples is None else samples.n_rows)
        self.write_samples(clip.samples)
        for key, states in clip.boundary_states.items():
            self._writer(f"edges-{key}", "<f8", states.shape[1:]).append(states)
        return location

    def write_frames(self, packed: stored_clips.PackedMotion, first_row: int) -> ClipLocation:
        """Write a packed motion; `first_row` is the first row of its samples."""
        if self._generation not in self.shards:
            self.shards.append(self._generation)
        frames = self._writer(f"frames-{self._generation}", "<f8", ())
        location = ClipLocation(
            shard=self.shards.index(self._generation),
            first_number=frames.n_rows,
            n_numbers=len(packed.numbers),
            first_row=first_row,
            content=packed.content,
            frame_time=packed.frame_time,
            repairs=packed.repairs,
            skeleton=self._skeleton_index(packed.skeleton),
        )
        frames.append(packed.numbers)
        return location

    def write_samples(self, rows: Packed) -> None:
        """Write samples of segments."""
        self._writer(f"samples-{self._generation}", "<f4", rows.shape[1:]).append(rows)

    def read_boundary_states(self, key: str, segments: IntArray) -> npt.NDArray[Any]:
        """Return the boundary states of all joints for some segments of the clips written.

        `key` is a key of `boundary_states`.
        """
        return self._writers[f"edges-{key}"].read(segments)

    def _writer(self, name: str, dtype: str, row_shape: tuple[int, ...]) -> ArrayWriter:
        if name not in self._writers:
            self._writers[name] = ArrayWriter(self.folder / f"{name}.npy", dtype, row_shape)
        return self._writers[name]

    def _skeleton_index(self, skeleton: Skeleton) -> int:
        text = json.dumps(skeleton_to_json(skeleton))
        return self._skeletons.setdefault(text, (len(self._skeletons), skeleton))[0]

    def map_samples(self) -> tuple[Packed, ...]:
        """Close the new shard and return the samples of all shards; write no clip afterwards."""
        self._close("frames-", "samples-")
        files = (self.folder / f"samples-{shard}.npy" for shard in self.shards)
        return tuple(map(array_files.map_array, files))

    def _close(self, *starts: str) -> None:
        """Complete the arrays whose names begin with any of `starts`."""
        for name in [name for name in self._writers if name.startswith(starts)]:
            self._writers.pop(name).close()

    def write_array(
        self, name: str, dtype: str, parts: Iterator[npt.NDArray[Any]] | npt.NDArray[Any]
    ) -> None:
        """Write an array that is given as a whole or as consecutive parts."""
        (self.folder / name).parent.mkdir(exist_ok=True)
        for part in [parts] if isinstance(parts, np.ndarray) else parts:
            self._writer(name, dtype, part.shape[1:]).append(part)
        self._close(name)

    def write_group(self, library: LibraryData, index: int, states: _States) -> dict[str, Any]:
        """Write the arrays of the joint group with this index; return its entry in the manifest."""
        group = library.groups.names[index]
        embedding, labels = library.embedding[group], library.labels[group]
        self.write_array(f"{index}/labels", "<i8", labels)
        for key, parts in states.items():
            self.write_array(f"{index}/{key}", "<f8", parts)
        if embedding is not None:
            self.write_array(f"{index}/joints", "<i8", embedding.joints)
            for name in storage.EMBEDDING_ARRAYS:
                self.write_array(f"{index}/{name}", "<f8", getattr(embedding, name))
        return {
            "folder": str(index),
            "sigma": library.sigma[group],
            "compared": embedding is not None,
            "has_root": embedding is not None and embedding.has_root,
            "clusters": int(labels.max(initial=-1)) + 1,
        }

    def write_clip_table(self, library: LibraryData, locations: Sequence[ClipLocation]) -> None:
        """Write the database of a library whose clips were written at `locations`."""
        skeletons = tuple(skeleton for _, skeleton in self._skeletons.values())
        table = ClipTable(library.entries, tuple(locations), skeletons, library.refused)
        write_clip_table(self.folder / DATABASE, self.final, table)

    def commit(self, metadata: Mapping[str, Any]) -> None:
        """Write the manifest with `metadata`, which makes this generation the current one."""
        self._close("frames-", "samples-")
        self.abandon()  # each group has its part of the boundary states
        for path in self.folder.glob("edges-*.npy"):
            path.unlink()
        files = [path for path in self.folder.rglob("*") if path.is_file()]
        names = {path.relative_to(self._root).as_posix() for path in files}
        new = sorted(names - self._linked_hashes.keys())
        hashes = self._linked_hashes | array_files.hash_files(self._root, new)
        document = {
            "format": storage.FORMAT,
            "version": storage.FORMAT_VERSION,
            "mograft": VERSION,
            "generation": self._generation,
            **metadata,
            "shards": self.shards,
            "files": dict(sorted(hashes.items())),
        }
        document["checksum"] = array_files.manifest_checksum(document)
        paths = [self._root / name for name in hashes]
        for path in [*paths, *dict.fromkeys(path.parent for path in paths), self.folder]:
            sync(path)
        sync(self._root)  # the manifest must not become valid before the folder that it names
        draft = self._root / f"{MANIFEST}.{self._generation}"
        draft.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        sync(draft)
        draft.replace(self._root / MANIFEST)
        sync(self._root)

    def abandon(self) -> None:
        """Close the files that are not complete."""
        for writer in self._writers.values():
            writer.abandon()


@contextlib.contextmanager
def write_generation(
    path: Path, *, force: bool = False, add: bool = False
) -> Iterator[GenerationWriter]:
    """Yield a writer of a library's next generation, under an exclusive lock.

    `force` permits to replace an existing library; `add` extends it. If neither is true and the
    folder exists and is not empty, raise FileExistsError. At the end, everything that was written
    but not committed is removed. Raise LibraryError if the folder is not a library, or another
    process is writing to it.
    """
    final = Path(os.path.abspath(path))
    final.parent.mkdir(parents=True, exist_ok=True)
    exists = final.exists() and (not final.is_dir() or any(final.iterdir()))
    if exists and not add and not force:
        raise FileExistsError(17, "exists; force=True replaces it", str(path))
    with _write_in_place(final, add=add) if exists or add else _write_new(final) as writer:
        try:
            yield writer
        finally:
            writer.abandon()


@contextlib.contextmanager
def _write_new(final: Path) -> Iterator[GenerationWriter]:
    """Yield a writer of a new library, in a temporary folder that is renamed after the commit."""
    # The lock file is closed first: Windows does not rename a folder with an open file.
    with atomic_folder(final) as draft, _lock(draft):
        yield GenerationWriter(draft, final, None, 1)


@contextlib.contextmanager
def _write_in_place(final: Path, *, add: bool) -> Iterator[GenerationWriter]:
    """Yield a writer of the next generation, in the library's folder, beside the current one."""
    if not add:
        _check_is_library(final)
    with _lock(final):
        base = storage.read(final) if add else None
        try:
            number = int(storage.read_manifest(final)["generation"]) + 1
        except LibraryError:
            taken = [int(path.name) for path in final.iterdir() if path.name.isdigit()]
            number = max(taken, default=0) + 1
        _remove(final / f"{number:04d}")  # a killed process may have left it
        with clean_up_by(lambda: _remove_old_generations(final)):
            yield GenerationWriter(final, final, base, number)


def _check_is_library(folder: Path) -> None:
    """Raise LibraryError if a folder to be overwritten holds anything other than a library.

    The library may be damaged.
    """
    text = ""
    with contextlib.suppress(OSError):
        text = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace")
    # The manifest may be truncated.
    if re.match(rf'\s*{{\s*"format":\s*"{re.escape(storage.FORMAT)}"', text) is None:
        reason = f"it is not a mograft library: it has no valid {MANIFEST}; move it away first"
        raise LibraryError(f"{folder} is not overwritten: {reason}")
    paths = [path for path in folder.iterdir() if path.name not in (MANIFEST, storage.LOCK)]
    if foreign := sorted(path.name for path in paths if not _is_replaceable(path)):
        reason = f"it also holds other files, such as {join_names(foreign, 3)}; move them away"
        raise LibraryError(f"{folder} is not overwritten: {reason}")


def _is_replaceable(path: Path) -> bool:
    """Return whether a path in a library's folder is a generation or the draft of a manifest.

    Only these may be removed. A generation is a folder that is named by its number and holds only
    arrays, folders of arrays and the database.
    """
    if path.is_symlink() or not path.is_dir():
        return re.fullmatch(rf"{re.escape(MANIFEST)}\.\d{{4,}}", path.name) is not None
    return re.fullmatch(r"\d{4,}", path.name) is not None and all(
        not entry.is_symlink()
        and (entry.is_dir() or entry.suffix == ".npy" or entry.name.startswith(DATABASE))
        for entry in path.rglob("*")
    )


def _remove(path: Path) -> None:
    """Remove a generation or the draft of a manifest; leave any other path unchanged."""
    if path.exists() and _is_replaceable(path):
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def _remove_old_generations(folder: Path) -> None:
    """Remove all generations except the current one, and all drafts of manifests."""
    with contextlib.suppress(LibraryError, OSError):
        current = storage.read_manifest(folder)["generation"]
        for path in folder.iterdir():
            if path.name != current:
                _remove(path)


@contextlib.contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Hold the exclusive lock of writers of a library; raise LibraryError if it is taken."""
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(exclusive_lock(folder / storage.LOCK))
        except BlockingIOError as error:
            message = f"another process is writing to {folder}; try again later"
            raise LibraryError(message) from error
        yield


def save_library(library: LibraryData, path: Path, *, force: bool) -> None:
    """Write a library to a folder; see `Library.save`."""
    if isinstance(library.clips, stored_clips.ExtendedClips):
        raise ValueError("a library with an appended base motion cannot be saved")
    check_storable(library.config)
    with write_generation(path, force=force) as writer:
        entries, locations = list(library.entries), list[ClipLocation]()
        first_rows = np.searchsorted(library.segments.clip, np.arange(len(library.entries)))
        for index, first_row in enumerate(first_rows.tolist()):
            if isinstance(library.clips, stored_clips.StoredClips):
                clip = library.clips.original(index, as_read=True)
            else:
                # The source of the saved library are these clips, whatever they were made from.
                clip = library.clips[index]
                entries[index] = entries[index]._replace(
                    source_rate=clip.rate, rate_override=None, source_frames=clip.n_frames
                )
            locations.append(writer.write_frames(stored_clips.pack(clip), first_row))
        for chunk in library.samples.chunks():
            writer.write_samples(chunk.pack())
        saved = replace(library, entries=tuple(entries))
        commit_library(writer, saved, locations, library.boundary_states, None)


def commit_library(
    writer: GenerationWriter,
    library: LibraryData,
    locations: Sequence[ClipLocation],
    boundary_states: BoundaryParts,
    requested_rate: float | None,
) -> None:
    """Write the files of a generation other than ``frames`` and ``samples``, and commit it.

    ``frames`` and ``samples`` must already be written, at `locations`. `boundary_states` holds the
    states of the feature joints; `library.boundary_states` and `library.clips` are ignored.
    `requested_rate` is the `rate` that the caller of `Library.index` gave; it is stored for clips
    that are added later.
    """
    segments = library.segments
    for name in ("start", "stop", "clip"):
        writer.write_array(f"{name}s", "<i8", getattr(segments, name))
    writer.write_array("donors", "|b1", library.is_donor)
    groups = {
        group: writer.write_group(library, index, boundary_states[group])
        for index, group in enumerate(library.groups.names)
    }
    writer.write_clip_table(library, locations)
    writer.commit(
        {
            "config": library.config.as_dict(),
            "groups": library.groups.to_toml(),
            "group": groups,
            "skeleton": skeleton_to_json(library.skeleton),
            "rate": library.rate,
            "given_rate": requested_rate,
            "root": library.root,
            "up": library.up,
            "match": library.spec.match,
            "rest": None if library.spec.rest is None else skeleton_to_json(library.spec.rest),
            "clips": len(library.entries),
            "frames": sum(info.n_frames for info in library.entries),
            "segments": len(segments),
        }
    )
