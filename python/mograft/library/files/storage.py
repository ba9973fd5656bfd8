"""Read libraries from disk: arrays, a database, and a manifest with their hashes.

docs/library.md lists the files. Files of a generation never change: a generation becomes the
library when the manifest that names it replaces the previous manifest. Readers need no lock;
writers hold an exclusive one (`mograft.library.files.generation`).
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft.errors import LibraryError
from mograft.library.clip_table import ClipTable, read_clip_table
from mograft.library.files.array_files import map_array
from mograft.library.files.integrity import (
    DATABASE,
    MANIFEST,
    check_contents,
    check_folders,
    check_manifest,
    damage,
    damage_raises_library_error,
    regular_file_size,
)
from mograft.library.files.stored_clips import RowRange, StoredSamples, merge_ranges

FORMAT, FORMAT_VERSION = "mograft.library", 1
LOCK = ".lock"

_MAX_READ_ATTEMPTS = 8
"""How many times reading is attempted if other processes replace the generation meanwhile."""


@dataclass(frozen=True, eq=False)
class StoredLibrary:
    """The files of a stored library."""

    folder: Path
    manifest: dict[str, Any]
    table: ClipTable
    arrays: dict[str, npt.NDArray[Any]]  # all but ``samples``, by path in the generation, mapped

    @cached_property
    def samples(self) -> StoredSamples:
        """The samples of all segments. Their files are opened now, and read when needed."""
        locations = self.table.locations
        counts = np.bincount(self.arrays["clips"], minlength=len(locations)).tolist()
        folder = self.folder / self.manifest["generation"]
        return StoredSamples.from_paths(
            [folder / f"samples-{name}.npy" for name in self.manifest["shards"]],
            ranges=merge_ranges(
                RowRange(location.shard, location.first_row, n)
                for location, n in zip(locations, counts, strict=True)
            ),
            n_samples=self.manifest["config"]["samples"],
            n_joints=len(self.manifest["skeleton"]["names"]),
        )


def read(folder: Path) -> StoredLibrary:
    """Open the files of a library; they stay valid when another process writes a generation.

    Raise LibraryError if the folder is not a library, or the library is damaged or was written by a
    newer version. Raise FileNotFoundError if the folder does not exist.
    """
    for _ in range(_MAX_READ_ATTEMPTS):
        manifest = read_manifest(folder)
        try:
            stored = _read_generation(folder, manifest)
            _ = stored.samples  # opens the files
            return stored
        except FileNotFoundError as error:
            # Another process may have replaced the generation since the manifest was read.
            if read_manifest(folder) == manifest:
                raise damage(folder, f"{Path(error.filename).name} is missing") from error
    raise LibraryError(f"{folder} was rewritten {_MAX_READ_ATTEMPTS} times while it was read")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a library after checking format, version and checksum."""
    if not folder.exists():
        raise FileNotFoundError(2, "no such library", str(folder))
    try:
        regular_file_size(folder, MANIFEST)
        document = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except NotADirectoryError as error:
        raise LibraryError(f"{folder} is not a mograft library: it is a file") from error
    except FileNotFoundError as error:
        raise LibraryError(
            f"{folder} is not a mograft library: it has no {MANIFEST}; "
            f"create one with: mograft index CLIPS -o {folder}"
        ) from error
    except (ValueError, RecursionError) as error:
        raise damage(folder, f"{MANIFEST} is not valid JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise LibraryError(f"{folder} is not a mograft library: its {MANIFEST} has another format")
    version = document.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise damage(folder, f"{MANIFEST} has no version")
    if version > FORMAT_VERSION:
        raise LibraryError(
            f"{folder} has format version {version}, written by mograft "
            f"{document.get('mograft')}; this is mograft {VERSION}, which reads versions up to "
            f"{FORMAT_VERSION}: upgrade mograft"
        )
    with damage_raises_library_error(folder, MANIFEST):
        if document.get("checksum") != manifest_checksum(document):
            raise damage(folder, f"{MANIFEST} does not match its checksum")
    check_manifest(folder, document)
    return document


def _read_generation(folder: Path, manifest: dict[str, Any]) -> StoredLibrary:
    arrays = {}
    prefix = manifest["generation"] + "/"
    check_folders(folder, list(manifest["files"]))
    for name, expected in manifest["files"].items():
        size = regular_file_size(folder, name)
        if size != expected["bytes"]:
            raise damage(folder, f"{name} has {size} bytes, expected {expected['bytes']}")
        key = name.removeprefix(prefix).removesuffix(".npy")
        if name.endswith(".npy") and not key.startswith("samples-"):
            try:
                arrays[key] = map_array(folder / name)
            except ValueError as error:
                raise damage(folder, f"{name}: {error}") from error
    with damage_raises_library_error(folder, DATABASE):
        table = read_clip_table(folder / prefix / DATABASE)
        check_contents(folder, manifest, table, arrays)
    return StoredLibrary(folder, manifest, table, arrays)


def verify(folder: Path) -> list[str]:
    """Compare the size and the SHA-256 of every file of a library with the manifest.

    Return a message for each missing or different file. If all files agree with the manifest, but
    the library cannot be opened, return the message of that error. Raise LibraryError if the
    manifest cannot be read.
    """
    manifest = read_manifest(folder)
    problems, files = [], []
    check_folders(folder, list(manifest["files"]))
    for name in manifest["files"]:
        with contextlib.suppress(FileNotFoundError):
            regular_file_size(folder, name)
            files.append(name)
    hashes = hash_files(folder, files)
    for name, expected in manifest["files"].items():
        if name not in hashes:
            problems.append(f"{name} is missing")
        elif hashes[name]["bytes"] != expected["bytes"]:
            n_bytes = hashes[name]["bytes"]
            problems.append(f"{name} has {n_bytes} bytes, expected {expected['bytes']}")
        elif hashes[name] != expected:
            problems.append(f"{name} has changed: its SHA-256 differs from the manifest")
    if not problems:
        try:
            read(folder)
        except LibraryError as error:
            problems.append(str(error))
    return problems


def list_leftovers(folder: Path) -> list[str]:
    """Return the names of files and folders that an interrupted write left in a library's folder.

    The next write removes generations and drafts of manifests. Other files stay.
    """
    manifest = read_manifest(folder)
    known = {MANIFEST, LOCK, manifest["generation"]}
    return sorted(path.name for path in folder.iterdir() if path.name not in known)


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
