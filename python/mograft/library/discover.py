"""Find the clips of a library, name them, and look up their tags and frame rates."""

import csv
import glob
import hashlib
import json
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from os import PathLike, fspath
from pathlib import Path
from typing import NamedTuple, TypeVar

from mograft.motion.motion import Motion

ClipSource = Motion | str | PathLike[str]
T = TypeVar("T")


class SourceFile(NamedTuple):
    """The state of a file when a clip was read from it."""

    path: str
    size: int  # bytes
    mtime_ns: int  # time of the last modification
    sha256: str

    @classmethod
    def from_path(cls, path: str) -> "SourceFile":
        """Return the present state of a file."""
        with open(path, "rb") as stream:
            status = os.fstat(stream.fileno())
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
        return cls(path, status.st_size, status.st_mtime_ns, sha256)


@dataclass(frozen=True, eq=False)
class FoundClip:
    """A clip that a source stands for."""

    source: Motion | str  # the clip, or its file
    folders: tuple[str, ...] = ()  # the folders between the source and the file
    is_graft: bool = False  # whether a folder holds it with the provenance of a graft beside it

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys by which `tags` and `frame_rates` can name the clip; see `matching_values`.

        A motion has one key: its name. A file has three: its name without suffix, its name, and its
        path relative to the source.
        """
        if isinstance(self.source, Motion):
            return (self.source.name,)
        path = Path(self.source)
        return (path.stem, path.name, "/".join((*self.folders, path.name)))


def find_clips(sources: ClipSource | Iterable[ClipSource]) -> list[FoundClip]:
    """Find the clips that motions, paths, folders and globs stand for, in the order of the sources.

    A folder stands for the files that `scan_folder` returns, a glob for the regular files that it
    matches. Both are sorted by name. Raise FileNotFoundError if a path, folder or glob provides no
    file, and ValueError if there is no source.
    """
    several = [sources] if isinstance(sources, Motion | str | PathLike) else sources
    clips: list[FoundClip] = []
    for source in several:
        clips += [FoundClip(source)] if isinstance(source, Motion) else _find_files(fspath(source))
    if not clips:
        raise ValueError("`sources` must hold at least one clip, got none")
    return clips


def scan_folder(folder: str) -> list[Path]:
    """Return the BVH files in a folder and its subfolders, sorted by path.

    Hidden files, files in hidden folders and anything but regular files are left out. Other
    programs give hidden names to copies and to incomplete files; reading a pipe would block.
    """
    files: list[Path] = []
    for parent, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        paths = [Path(parent, name) for name in names if not name.startswith(".")]
        files += [path for path in paths if path.suffix.lower() == ".bvh" and path.is_file()]
    return sorted(files)


def _find_files(path: str) -> list[FoundClip]:
    if os.path.isdir(path):
        files = scan_folder(path)
        if not files:
            raise FileNotFoundError(2, "no BVH file in this folder", path)
        return [
            FoundClip(str(file), file.relative_to(path).parts[:-1], is_graft=has_provenance(file))
            for file in files
        ]
    matches = sorted(glob.glob(path, recursive=True)) if glob.has_magic(path) else []
    matches = [match for match in matches if os.path.isfile(match)]
    if glob.has_magic(path) and not matches and not glob.glob(glob.escape(path)):
        raise FileNotFoundError(f"no file matches {path}")
    if not matches and not os.path.lexists(path):
        raise FileNotFoundError(2, "No such file or directory", path)
    return [FoundClip(match) for match in matches or [path]]


def has_provenance(path: Path) -> bool:
    """Return whether a JSON file that ``mograft graft`` wrote lies beside a motion file."""
    provenance = path.with_suffix(".json")
    try:
        document = json.loads(provenance.read_bytes()) if provenance.is_file() else None
    except (OSError, ValueError, RecursionError):
        return False
    schema = document.get("schema") if isinstance(document, dict) else None
    return isinstance(schema, str) and schema.startswith("mograft.graft/")


def exclude_grafts(clips: Sequence[FoundClip]) -> list[FoundClip]:
    """Return the clips without the grafts that were found in folders; warn about such grafts.

    Donors from a graft could contain its seams. Raise FileNotFoundError if no clip remains.
    """
    kept = [clip for clip in clips if not clip.is_graft]
    n_grafts = len(clips) - len(kept)
    remedy = "--include-grafts (include_grafts=True) includes them"
    if clips and not kept:
        raise FileNotFoundError(f"all files of these folders are grafts of mograft; {remedy}")
    if n_grafts:
        grafts = "1 graft" if n_grafts == 1 else f"{n_grafts} grafts"
        message = f"{grafts} of mograft in these folders excluded as donors; {remedy}"
        warnings.warn(message, stacklevel=3)
    return kept


def relative_path(path: str, folder: Path) -> Path:
    """Return a file's path relative to a folder; absolute if the two are on different drives."""
    parent, name = os.path.split(os.path.abspath(path))
    return _relative_folder(parent, os.path.abspath(folder)) / name


@cache
def _relative_folder(path: str, start: str) -> Path:
    """Return the path of folder `path` relative to `start`; cached, because files share folders."""
    try:
        return Path(os.path.relpath(path, start))
    except ValueError:
        return Path(path)


def matching_values(table: Mapping[str, T] | None, clip: FoundClip) -> list[T]:
    """Return the values for the keys of a table that match a clip, in the order of the table.

    A key is the name, file name or path of a clip, or a glob of one of these.
    """
    if not table:
        return []
    keys = clip.keys
    return [
        value
        for pattern, value in table.items()
        if pattern in keys
        or (glob.has_magic(pattern) and any(fnmatchcase(key, pattern) for key in keys))
    ]


def read_tags(path: str | PathLike[str]) -> dict[str, tuple[str, ...]]:
    """Read the `tags` for `Library.build` and `Library.index` from a CSV file.

    The first cell of a row is a clip's name, file name or path, or a glob of these; the other cells
    are its tags. A first row that begins with ``clip`` or ``file`` is a heading. Raise ValueError
    with the number of the line if a row lacks the clip or the tags.
    """
    table: dict[str, tuple[str, ...]] = {}
    with open(path, encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        for row in rows:
            cells = [cell.strip() for cell in row]
            if not any(cells) or (rows.line_num == 1 and cells[0].lower() in ("clip", "file")):
                continue
            tags = tuple(cell for cell in cells[1:] if cell)
            if not cells[0] or not tags:
                raise ValueError(f"{path}:{rows.line_num}: expected a clip and its tags, got {row}")
            table[cells[0]] = (*table.get(cells[0], ()), *tags)
    return table
