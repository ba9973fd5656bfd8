"""Check the content of the files of a library, so that no crafted library causes harm.

The checksum of a manifest reveals accidental changes. It does not reveal changes by somebody who
computes it again. These checks therefore do not depend on it.
"""

import contextlib
import os
import re
import sqlite3
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from mograft.errors import LibraryError
from mograft.library.clip_table import ClipTable
from mograft.library.files.array_files import HEADER_BYTES
from mograft.library.files.packing import PackedContent
from mograft.motion import limits
from mograft.motion.limits import MAX_CLIP_FRAME_TIME, MIN_CLIP_FRAME_TIME

MANIFEST, DATABASE = "manifest.json", "catalog.sqlite"

_GENERATION = re.compile(r"[0-9]{4,9}")
_FILE = re.compile(rf"(?:(?:[0-9]{{1,9}}/)?[A-Za-z0-9_-]{{1,99}}\.npy|{re.escape(DATABASE)})")
_SHA256 = re.compile(r"[0-9a-f]{64}")

_MAX_COUNT = 1 << 53
"""Limit of counts and positions; the sum of two cannot overflow."""


_MIN_RATE, _MAX_RATE = 0.5 / MAX_CLIP_FRAME_TIME, 2.0 / MIN_CLIP_FRAME_TIME
"""Frames per second, with a margin to the frame times that `Library` takes. Resampling between
rates of other sizes would take any amount of memory."""


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
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
        sqlite3.Error,
    ) as error:
        raise damage(folder, f"{name}: {error or type(error).__name__}") from error


def regular_file_size(folder: Path, name: str) -> int:
    """Return the size in bytes of a regular file in a folder, without opening the file.

    Raise LibraryError if the path is another kind of file, such as a pipe, which could block, or a
    symbolic link that leaves the folder. Raise FileNotFoundError if there is no file.
    """
    path = f"{folder}{os.sep}{name}"
    status = os.lstat(path)
    if stat.S_ISLNK(status.st_mode):
        _check_link(folder, name)
        try:
            status = os.stat(path)
        except OSError as error:
            raise damage(folder, f"{name}: {error.strerror}") from error
    if not stat.S_ISREG(status.st_mode):
        raise damage(folder, f"{name} is not a regular file")
    return status.st_size


def check_folders(folder: Path, names: Sequence[str]) -> None:
    """Raise LibraryError if a symbolic link on the path of a file in `names` leaves `folder`."""
    for parent in sorted({name.rpartition("/")[0] for name in names}):
        parts = parent.split("/")
        for n in range(1, len(parts) + 1):
            name = "/".join(parts[:n])
            if os.path.islink(os.path.join(folder, name)):
                _check_link(folder, name)


def _check_link(folder: Path, name: str) -> None:
    target = os.path.realpath(os.path.join(folder, name))
    if not target.startswith(os.path.realpath(folder) + os.sep):
        raise damage(folder, f"{name} is a symbolic link to a path outside the library")


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _MAX_COUNT


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_rate(value: Any) -> bool:  # noqa: ANN401 - of a JSON document
    return _is_number(value) and _MIN_RATE <= value <= _MAX_RATE


def _is_generation(value: object) -> bool:
    return isinstance(value, str) and _GENERATION.fullmatch(value) is not None


def _is_group(value: object) -> bool:
    return (
        isinstance(value, dict)
        and isinstance(value.get("folder"), str)
        and re.fullmatch("[0-9]{1,9}", value["folder"]) is not None
        and _is_number(value.get("sigma"))
        and isinstance(value.get("compared"), bool)
        and isinstance(value.get("has_root"), bool)
    )


def _is_file_state(value: object) -> bool:
    return (
        isinstance(value, dict)
        and set(value) == {"bytes", "sha256"}
        and _is_count(value["bytes"])
        and isinstance(value["sha256"], str)
        and _SHA256.fullmatch(value["sha256"]) is not None
    )


def _is_skeleton(value: object) -> bool:
    names = value.get("names") if isinstance(value, dict) else None
    return isinstance(names, list) and bool(names) and all(isinstance(name, str) for name in names)


_ENTRIES: Mapping[str, Callable[[Any], bool]] = {
    "generation": _is_generation,
    "config": lambda value: isinstance(value, dict) and _is_count(value.get("samples")),
    # A text without a line break would be the path of a file.
    "groups": lambda value: isinstance(value, str) and "\n" in value,
    "group": lambda value: isinstance(value, dict) and all(map(_is_group, value.values())),
    "skeleton": _is_skeleton,
    "rate": _is_rate,
    "root": _is_count,
    "up": lambda value: _is_count(value) and value < 3,
    "shards": lambda value: isinstance(value, list) and all(map(_is_generation, value)),
    "files": lambda value: isinstance(value, dict) and all(map(_is_file_state, value.values())),
}
"""Conditions of the entries that every manifest has."""

_OPTIONAL_ENTRIES: Mapping[str, Callable[[Any], bool]] = {
    "given_rate": _is_rate,
    "match": lambda value: isinstance(value, str),
    "rest": _is_skeleton,
}
"""Conditions of the entries that may be missing or null."""


def check_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise LibraryError unless all entries are valid and all files are in the generation's folder.

    This is the only check of the entries: code that reads them afterwards relies on it.
    """
    invalid = [name for name, is_valid in _ENTRIES.items() if not is_valid(manifest.get(name))]
    for name, is_valid in _OPTIONAL_ENTRIES.items():
        value = manifest.get(name)
        if value is not None and not is_valid(value):
            invalid.append(name)
    if not invalid and manifest["root"] >= len(manifest["skeleton"]["names"]):
        invalid.append("root")
    if invalid:
        raise damage(folder, f"{MANIFEST} has no valid entry `{invalid[0]}`")
    prefix, files = manifest["generation"] + "/", manifest["files"]
    for name in files:
        if not name.startswith(prefix) or _FILE.fullmatch(name, len(prefix)) is None:
            raise damage(folder, f"{MANIFEST} lists {name!r}, which is no file of its generation")
    stems = [f"{stem}-{shard}" for shard in manifest["shards"] for stem in ("frames", "samples")]
    names = [DATABASE, *(f"{stem}.npy" for stem in ("starts", "stops", "clips", "donors", *stems))]
    missing = [name for name in names if prefix + name not in files]
    if missing:
        raise damage(folder, f"{MANIFEST} does not list {missing[0]}")


def check_contents(
    folder: Path,
    manifest: Mapping[str, Any],
    table: ClipTable,
    arrays: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Raise LibraryError if the clip table, the manifest and the arrays do not fit together."""
    shapes = dict.fromkeys(("starts", "stops", "clips"), ("<i8", 1)) | {"donors": ("|b1", 1)}
    shapes |= {f"frames-{shard}": ("<f8", 1) for shard in manifest["shards"]}
    for name, (dtype, n_dimensions) in shapes.items():
        if arrays[name].dtype != np.dtype(dtype) or arrays[name].ndim != n_dimensions:
            raise damage(folder, f"{name}.npy does not have the expected shape and type")
    clips, n_clips = arrays["clips"], len(table.entries)
    n_segments = len(clips)
    if any(len(arrays[name]) != n_segments for name in ("starts", "stops", "donors")):
        raise damage(folder, "the arrays of segments have different lengths")
    if n_segments and (clips.min() < 0 or clips.max() >= n_clips):
        raise damage(folder, "clips.npy names clips that the library does not have")
    for about in manifest["group"].values():
        labels = arrays[f"{about['folder']}/labels"]
        if labels.dtype != np.dtype("<i8") or labels.shape != (n_segments,):
            name = f"{about['folder']}/labels.npy"
            raise damage(folder, f"{name} does not have the expected shape and type")
        if n_segments and (labels.min() < 0 or labels.max() >= n_segments):
            raise damage(folder, f"{about['folder']}/labels.npy has invalid clusters")
    n_frames = np.array([entry.n_frames for entry in table.entries], np.int64)
    if n_segments and (arrays["starts"].min() < 0 or (arrays["stops"] >= n_frames[clips]).any()):
        raise damage(folder, "segments lie outside their clips")
    _check_locations(folder, manifest, table, arrays)


def _check_locations(
    folder: Path,
    manifest: Mapping[str, Any],
    table: ClipTable,
    arrays: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Raise LibraryError if a clip lies outside the files of its shard, or has invalid metadata."""
    if not table.locations:
        return
    shard, first, n, first_row, content, frame_time, _, skeleton = zip(
        *table.locations, strict=True
    )
    _check_types(folder, {int}, *[shard, first, n, first_row, skeleton])
    _check_types(folder, {float}, frame_time)
    if not all(seconds and _is_rate(1.0 / seconds) for seconds in set(frame_time)):
        raise damage(folder, f"{DATABASE}: a clip has an invalid frame time")
    if not set(content) <= set(get_args(PackedContent)):
        raise damage(folder, f"{DATABASE}: unknown content of a clip")
    columns = np.array([shard, first, n, first_row, skeleton])
    shards, firsts, counts, first_rows, _ = columns
    if (
        (columns < 0).any()
        or (columns >= _MAX_COUNT).any()
        or max(skeleton) >= len(table.skeletons)
    ):
        raise damage(folder, f"{DATABASE}: a clip has an invalid location")
    with damage_raises_library_error(folder, DATABASE):
        limits.check_frames(max(n))
    if max(shard) >= len(manifest["shards"]):
        raise damage(folder, f"{DATABASE}: a clip has an unknown shard")
    width = manifest["config"]["samples"] * (4 * len(manifest["skeleton"]["names"]) + 3) + 1
    prefix = manifest["generation"] + "/samples-"
    n_numbers = np.array([len(arrays[f"frames-{name}"]) for name in manifest["shards"]])
    n_rows = np.array(
        [
            (manifest["files"][f"{prefix}{name}.npy"]["bytes"] - HEADER_BYTES) // (4 * width)
            for name in manifest["shards"]
        ]
    )
    n_segments = np.bincount(arrays["clips"], minlength=len(table.locations))
    ends, row_ends = firsts + counts, first_rows + n_segments
    if (ends > n_numbers[shards]).any() or (row_ends > n_rows[shards]).any():
        raise damage(folder, f"{DATABASE}: a clip lies outside its file")
    _check_entries(folder, table)


def _check_entries(folder: Path, table: ClipTable) -> None:
    names, source_names, files, rates, given, source_frames, frames, root, up, faults, tags = zip(
        *table.entries, strict=True
    )
    _check_types(folder, {str}, names, source_names)
    _check_types(folder, {float}, rates)
    _check_types(folder, {float, type(None)}, given)
    if not all(map(_is_rate, {*rates, *given} - {None})):
        raise damage(folder, f"{DATABASE}: a clip has an invalid frame rate")
    _check_types(folder, {int}, source_frames, frames, root, up)
    for column in (faults, tags):
        _check_types(folder, {str}, [text for texts in set(column) for text in texts])
    states = [file for file in files if file is not None]
    if states:
        _, size, mtime, sha256, *_ = zip(*states, strict=True)
        _check_types(folder, {int}, size, mtime)
        _check_types(folder, {str}, sha256)


def _check_types(folder: Path, types: set[type], *columns: Sequence[object]) -> None:
    for column in columns:
        if not set(map(type, column)) <= types:
            raise damage(folder, f"{DATABASE}: a clip has metadata of a wrong type")
