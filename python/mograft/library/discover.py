"""Which clips are meant: files found, named and tagged."""

import csv
import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from os import PathLike, fspath
from pathlib import Path
from typing import TypeVar

from mograft.motion.motion import Motion

__all__ = [
    "ClipSource",
    "FoundClip",
    "find_clips",
    "matching_values",
    "read_tags",
    "sort_by_path",
    "unique_names",
]

ClipSource = Motion | str | PathLike[str]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class FoundClip:
    """A clip that was meant.

    Attributes
    ----------
    source : Motion or str
        The clip, or its file.
    folders : tuple of str
        The folders between what was asked for and the file.
    """

    source: Motion | str
    folders: tuple[str, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """What the clip may be called in a table: name, file name, way from what was asked for."""
        if isinstance(self.source, Motion):
            return (self.source.name,)
        path = Path(self.source)
        return (path.stem, path.name, "/".join((*self.folders, path.name)))


def find_clips(sources: ClipSource | Iterable[ClipSource]) -> list[FoundClip]:
    """Return the clips that are meant.

    Parameters
    ----------
    sources : Motion, path, folder or glob, or several
        What is asked for.

    Returns
    -------
    list of Found
        In the order asked for; what a folder or a glob holds in order of name.

    Raises
    ------
    FileNotFoundError
        If a folder or glob holds no BVH file.
    ValueError
        If nothing is asked for.
    """
    several = [sources] if isinstance(sources, Motion | str | PathLike) else list(sources)
    found: list[FoundClip] = []
    for source in several:
        if isinstance(source, Motion):
            found.append(FoundClip(source))
            continue
        path = fspath(source)
        if os.path.isdir(path):
            found += _inside(path)
            continue
        matches = sorted(glob.glob(path, recursive=True)) if glob.has_magic(path) else []
        if glob.has_magic(path) and not matches and not glob.glob(glob.escape(path)):
            raise FileNotFoundError(f"no file matches {path}")
        if not matches and not os.path.lexists(path):
            raise FileNotFoundError(2, "No such file or directory", path)
        found += [FoundClip(match) for match in matches or [path]]
    if not found:
        raise ValueError("sources must hold at least one clip, got none")
    return found


def _inside(folder: str) -> list[FoundClip]:
    files = sorted(path for path in Path(folder).rglob("*") if path.suffix.lower() == ".bvh")
    if not files:
        raise FileNotFoundError(2, "no BVH file in this folder", folder)
    return [FoundClip(str(path), path.relative_to(folder).parts[:-1]) for path in files]


def sort_by_path(found: Sequence[FoundClip], folder: Path) -> dict[tuple[str, ...], FoundClip]:
    """Return files by their ways from a folder, in the order of these, each once.

    Raises
    ------
    TypeError
        If a motion is among them.
    """
    ways = {}
    for own in found:
        if isinstance(own.source, Motion):
            raise TypeError("sources must be files; a library of motions is built, then saved")
        ways[relative_path(own.source, folder).parts] = own
    return {way: ways[way] for way in sorted(ways)}


def relative_path(path: str, folder: Path) -> Path:
    """Return the way from a folder to a file: what clips are ordered by.

    It is relative, but for a file on another drive.
    """
    home, name = os.path.split(os.path.abspath(path))
    return _way(home, os.path.abspath(folder)) / name


@cache
def _way(path: str, start: str) -> Path:
    """Return the way from one folder to another; files by the thousand lie in few of them."""
    try:
        return Path(os.path.relpath(path, start))
    except ValueError:
        return Path(path)


def unique_names(names: Sequence[str]) -> list[str]:
    """Give every clip a name of its own."""
    taken: set[str] = set()
    given = []
    for index, own in enumerate(names):
        name = plain = own or f"clip{index}"
        count = 1
        while name in taken:
            count += 1
            name = f"{plain}~{count}"
        taken.add(name)
        given.append(name)
    return given


def matching_values(table: Mapping[str, T] | None, found: FoundClip) -> list[T]:
    """Return what a table says of a clip.

    Parameters
    ----------
    table : mapping of str, optional
        By name, file name or path, or globs of these.
    found : Found
        The clip.

    Returns
    -------
    list
        All that fits, in the order of the table.
    """
    if not table:
        return []
    keys = found.keys
    globs = [key for key in table if glob.has_magic(key)]
    wanted = {key for key in keys if key in table}
    wanted |= {key for key in globs if any(fnmatchcase(own, key) for own in keys)}
    return [table[key] for key in sorted(wanted, key=list(table).index)] if wanted else []


def read_tags(path: str | PathLike[str]) -> dict[str, tuple[str, ...]]:
    """Read tags from a CSV file.

    Parameters
    ----------
    path : path
        A file of rows: a clip's name, file name, path or a glob of these, then its tags. A
        first row that begins with ``clip`` or ``file`` is a heading.

    Returns
    -------
    dict of str to tuple of str
        For `Library.build` and `Library.index`.

    Raises
    ------
    ValueError
        If a row names a clip but no tag; with its line.
    """
    table: dict[str, tuple[str, ...]] = {}
    with open(path, encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        for row in rows:
            words = [word.strip() for word in row]
            if not any(words) or (rows.line_num == 1 and words[0].lower() in ("clip", "file")):
                continue
            tags = tuple(word for word in words[1:] if word)
            if not words[0] or not tags:
                raise ValueError(f"{path}:{rows.line_num}: must be a clip and its tags, got {row}")
            table[words[0]] = (*table.get(words[0], ()), *tags)
    return table
