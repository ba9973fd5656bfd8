"""The SQLite database of a library: clips, skeletons and refused files."""

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from mograft.body.mass import up_axis
from mograft.errors import LibraryError
from mograft.library.discover import SourceFile, relative_path
from mograft.motion.hinges import Hinges
from mograft.motion.motion import Motion
from mograft.motion.skeleton import EndSite, Skeleton

PackedContent: TypeAlias = Literal["channels", "poses", "both"]
"""The numbers that are stored of a clip; see `PackedMotion`."""


class ClipInfo(NamedTuple):
    """The metadata of a clip; a tuple, because a library may have many thousands of clips."""

    name: str  # in the library; unique
    source_name: str  # in the source; may be empty
    source_file: SourceFile | None
    source_rate: float  # true frames per second, before resampling to the library's rate
    rate_override: float | None  # the true rate if the caller gave it, because the file's is wrong
    source_frames: int  # number of frames before resampling
    n_frames: int  # number of frames at the library's rate
    root: int  # the joint that carries the body; -1 if no joint changes its position
    up: int  # the axis that points up: 0, 1 or 2
    faults: tuple[str, ...]  # messages of the faults that exclude segments as donors
    tags: tuple[str, ...]  # words by which donors can be chosen

    @classmethod
    def from_motion(
        cls,
        motion: Motion,
        source_file: SourceFile | None = None,
        rate_override: float | None = None,
        tags: tuple[str, ...] = (),
    ) -> "ClipInfo":
        """Return the metadata of a motion at its true rate, before it is resampled or checked."""
        is_moving = bool(np.ptp(motion.positions, axis=0).any())
        return cls(
            name=motion.name,
            source_name=motion.name,
            source_file=source_file,
            source_rate=motion.rate,
            rate_override=rate_override,
            source_frames=motion.n_frames,
            n_frames=motion.n_frames,
            root=motion.locomotion_root() if is_moving else -1,
            up=up_axis(motion),
            faults=(),
            tags=tags,
        )


class ClipLocation(NamedTuple):
    """Location of a clip in the files of a library, and fields of its `PackedMotion`."""

    shard: int  # index of its files, in the order of the manifest
    first_number: int  # its first number in the ``frames`` file
    n_numbers: int
    first_row: int  # its first row in the ``samples`` file
    content: PackedContent
    frame_time: float
    repairs: tuple[str, ...]
    skeleton: int  # index in `ClipTable.skeletons`


@dataclass(frozen=True)
class ClipTable:
    """The clips of a stored library."""

    entries: tuple[ClipInfo, ...]
    locations: tuple[ClipLocation, ...]
    skeletons: tuple[Skeleton, ...]
    refused: Mapping[str, str]  # files that were left out, and the reasons


_SCHEMA = """
CREATE TABLE skeleton (id INTEGER PRIMARY KEY, json TEXT NOT NULL);
CREATE TABLE clip (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, own_name TEXT NOT NULL,
    path TEXT, bytes INTEGER, mtime_ns INTEGER, sha256 TEXT, file_format TEXT, file_clip TEXT,
    rate REAL NOT NULL, given_rate REAL, own_frames INTEGER NOT NULL, n_frames INTEGER NOT NULL,
    root INTEGER NOT NULL, up INTEGER NOT NULL, faults TEXT NOT NULL, tags TEXT NOT NULL,
    shard INTEGER NOT NULL, first_number INTEGER NOT NULL, n_numbers INTEGER NOT NULL,
    first_row INTEGER NOT NULL, kind TEXT NOT NULL, frame_time REAL NOT NULL,
    repairs TEXT NOT NULL, skeleton INTEGER NOT NULL REFERENCES skeleton
);
CREATE TABLE refused (path TEXT, reason TEXT NOT NULL);
"""


_SELECT = """
SELECT name, own_name, path, bytes, mtime_ns, sha256, file_format, file_clip,
    rate, given_rate, own_frames, n_frames, root, up, faults, tags,
    shard, first_number, n_numbers, first_row, kind, frame_time, repairs, skeleton
FROM clip ORDER BY id
"""
"""Query of the clips: the fields of `ClipInfo`, with those of `SourceFile`, and `ClipLocation`."""


def write_clip_table(path: Path, folder: Path, table: ClipTable) -> None:
    """Create the database `path` of a library in `folder`, with source paths relative to `folder`.

    Raise LibraryError if the file cannot be written.
    """
    clips = zip(table.entries, table.locations, strict=True)
    skeletons = [json.dumps(skeleton_to_json(skeleton)) for skeleton in table.skeletons]
    rows: dict[str, Iterable[Any]] = {
        "skeleton VALUES (?, ?)": enumerate(skeletons),
        f"clip VALUES ({', '.join('?' * 25)})": (
            _clip_row(i, *clip, folder) for i, clip in enumerate(clips)
        ),
        "refused VALUES (?, ?)": table.refused.items(),
    }
    try:
        with contextlib.closing(sqlite3.connect(path)) as database, database:
            database.executescript("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF;" + _SCHEMA)
            for target, values in rows.items():
                database.executemany(f"INSERT INTO {target}", values)
    except sqlite3.Error as error:
        raise LibraryError(f"{path} cannot be written: {error}") from error


def _clip_row(index: int, info: ClipInfo, location: ClipLocation, folder: Path) -> tuple[Any, ...]:
    """Return a row of the table ``clip``: the fields in their order, those of the file in place."""
    name, source_name, file, *properties, faults, tags = info
    *numbers, repairs, skeleton = location
    state: Iterable[Any] = [None] * len(SourceFile._fields)
    if file is not None:
        state = file._replace(path=relative_path(file.path, folder).as_posix())
    lists = [json.dumps(own) for own in (faults, tags)]
    row = (index, name, source_name, *state, *properties, *lists)
    return (*row, *numbers, json.dumps(repairs), skeleton)


def read_clip_table(path: Path) -> ClipTable:
    """Read the clips from the database `path` of a generation.

    Relative paths of source files become absolute. Raise sqlite3.Error, LookupError,
    AttributeError, TypeError or ValueError if the database is damaged.
    """
    # Immutable: SQLite takes no lock and writes no file beside the database.
    uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    folder = str(path.absolute().parent.parent)

    @cache  # most clips have the same parent folder
    def absolute_parent(parent: str) -> str:
        return os.path.normpath(os.path.join(folder, parent))

    entries, locations = [], []
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
        texts = database.execute("SELECT json FROM skeleton ORDER BY id")
        skeletons = tuple(skeleton_from_json(json.loads(text)) for (text,) in texts)
        # By position, in the order of the fields: a mapping per row takes 1.5 times as long.
        for name, source_name, source, *rest in database.execute(_SELECT):
            file = None
            if source is not None:
                parent, _, file_name = source.rpartition("/")
                file = SourceFile(f"{absolute_parent(parent)}{os.sep}{file_name}", *rest[:5])
            lists = map(_strings, rest[11:13])
            entries.append(ClipInfo(name, source_name, file, *rest[5:11], *lists))
            *numbers, repairs, skeleton = rest[13:]
            locations.append(ClipLocation._make((*numbers, _strings(repairs), skeleton)))
        refused = dict(database.execute("SELECT path, reason FROM refused"))
    return ClipTable(tuple(entries), tuple(locations), skeletons, refused)


def _strings(text: str) -> tuple[str, ...]:
    return () if text == "[]" else tuple(json.loads(text))


def skeleton_to_json(skeleton: Skeleton) -> dict[str, Any]:
    """Return a skeleton as a JSON document."""
    return {
        "names": skeleton.names,
        "parents": skeleton.parents.tolist(),
        "offsets": skeleton.offsets.tolist(),
        "channels": skeleton.channels,
        "end_sites": [
            [site.parent, site.offset.tolist(), site.before, site.name]
            for site in skeleton.end_sites
        ],
        **({} if skeleton.hinges is None else {"hinges": skeleton.hinges.to_json()}),
    }


def skeleton_from_json(document: Mapping[str, Any]) -> Skeleton:
    """Return the skeleton of a JSON document."""
    end_sites = tuple(EndSite(*site) for site in document["end_sites"])
    hinges = Hinges.from_json(document["hinges"]) if "hinges" in document else None
    return Skeleton(**{**document, "end_sites": end_sites, "hinges": hinges})
