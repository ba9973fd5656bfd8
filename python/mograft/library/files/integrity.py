"""Detect damage of the files of a library: sizes, checksums and hashes."""

import contextlib
import hashlib
import json
import os
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from mograft.errors import DAMAGE, LibraryError

MANIFEST, DATABASE = "manifest.json", "catalog.sqlite"

_FILE = re.compile(rf"\d{{4,}}/(?:(?:\d+/)?[\w-]+\.npy|{re.escape(DATABASE)})")


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


def check_manifest(folder: Path, document: Mapping[str, Any]) -> None:
    """Raise LibraryError unless a manifest has its checksum and names files of generations only."""
    with damage_raises_library_error(folder, MANIFEST):
        if document.get("checksum") != manifest_checksum(document):
            raise damage(folder, f"{MANIFEST} does not match its checksum")
        foreign = [name for name in document["files"] if not _FILE.fullmatch(name)]
    if foreign:
        raise damage(folder, f"{MANIFEST} lists {foreign[0]!r}, which is no file of a generation")


def check_sizes(folder: Path, files: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise LibraryError if a file has another size than in `files`, an entry of the manifest.

    Raise FileNotFoundError if there is no such file.
    """
    for name, expected in files.items():
        size = os.stat(f"{folder}{os.sep}{name}").st_size
        if size != expected["bytes"]:
            raise damage(folder, f"{name} has {size} bytes, expected {expected['bytes']}")


def hash_files(folder: Path, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the size (``bytes``) and the SHA-256 (``sha256``) of files in a folder, by name."""

    def hash_file(name: str) -> dict[str, Any]:
        with (folder / name).open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
            return {"bytes": stream.tell(), "sha256": sha256}

    with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:
        return dict(zip(names, pool.map(hash_file, names), strict=True))


def compare_hashes(folder: Path, files: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a message for each file whose size or SHA-256 differs from that in `files`."""
    problems = []
    hashes = hash_files(folder, [name for name in files if (folder / name).is_file()])
    for name, expected in files.items():
        if name not in hashes:
            problems.append(f"{name} is missing")
        elif hashes[name]["bytes"] != expected["bytes"]:
            n_bytes = hashes[name]["bytes"]
            problems.append(f"{name} has {n_bytes} bytes, expected {expected['bytes']}")
        elif hashes[name] != expected:
            problems.append(f"{name} has changed: its SHA-256 differs from the manifest")
    return problems
