"""The SQLite database of a library: clips, skeletons, segments and labels."""

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.errors import LibraryError
from mograft.library.discover import relative_path
from mograft.library.ingest import SourceFile
from mograft.library.packing import PackedContent
from mograft.library.spec import ClipProperties
from mograft.motion.skeleton import EndSite, Skeleton

__all__ = [
    "ClipInfo",
    "ClipLocation",
    "ClipTable",
    "read_clip_table",
    "skeleton_from_json",
    "skeleton_to_json",
    "write_clip_table",
]


@dataclass(frozen=True)
class ClipInfo:
    """The metadata of a clip.

    Attributes
    ----------
    name : str
        Its name in the library; unique.
    source_name : str
        Its name in the source; may be empty.
    source_file : SourceFile or None
        The file from which it was read.
    source_rate : float
        Frames per second before resampling to the library's rate.
    rate_override : float or None
        `source_rate`, if it was given because the file has a wrong rate.
    source_frames, n_frames : int
        Number of frames before and after resampling.
    root, up : int
        As in `ClipProperties`.
    faults : tuple of str
        Messages of the faults because of which some of its segments are excluded as donors.
    tags : tuple of str
        Words by which donors can be chosen.
    """

    name: str
    source_name: str
    source_file: SourceFile | None
    source_rate: float
    rate_override: float | None
    source_frames: int
    n_frames: int
    root: int
    up: int
    faults: tuple[str, ...]
    tags: tuple[str, ...]

    def properties(self, skeleton: Skeleton) -> ClipProperties:
        """Return the properties of the clip, given its skeleton."""
        return ClipProperties(
            skeleton=skeleton,
            rate=self.source_rate,
            n_frames=self.source_frames,
            root=self.root,
            up=self.up,
        )


class ClipLocation(NamedTuple):
    """Where a clip lies in the files of a library.

    Attributes
    ----------
    shard : int
        Index of its files, in the order of the manifest.
    first_number, n_numbers : int
        Its numbers in the ``frames`` file.
    first_row : int
        Its first row in the ``samples`` file.
    content, frame_time, repairs
        As in `PackedMotion`.
    skeleton : int
        Index of its skeleton.
    """

    shard: int
    first_number: int
    n_numbers: int
    first_row: int
    content: PackedContent
    frame_time: float
    repairs: tuple[str, ...]
    skeleton: int


@dataclass(frozen=True)
class ClipTable:
    """The clips of a stored library.

    Attributes
    ----------
    entries : tuple of ClipInfo
        Metadata of the clips.
    locations : tuple of ClipLocation
        Locations of the clips.
    skeletons : tuple of Skeleton
        The skeletons that `ClipLocation.skeleton` counts.
    refused : dict of str to str
        Files that were left out, and the reasons.
    """

    entries: tuple[ClipInfo, ...]
    locations: tuple[ClipLocation, ...]
    skeletons: tuple[Skeleton, ...]
    refused: Mapping[str, str]


_SCHEMA = """
CREATE TABLE skeleton (id INTEGER PRIMARY KEY, json TEXT NOT NULL);
CREATE TABLE clip (
    id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, own_name TEXT NOT NULL,
    path TEXT, bytes INTEGER, mtime_ns INTEGER, sha256 TEXT,
    rate REAL NOT NULL, given_rate REAL, own_frames INTEGER NOT NULL, n_frames INTEGER NOT NULL,
    root INTEGER NOT NULL, up INTEGER NOT NULL, faults TEXT NOT NULL, tags TEXT NOT NULL,
    shard INTEGER NOT NULL, first_number INTEGER NOT NULL, n_numbers INTEGER NOT NULL,
    first_row INTEGER NOT NULL, kind TEXT NOT NULL, frame_time REAL NOT NULL,
    repairs TEXT NOT NULL, skeleton INTEGER NOT NULL REFERENCES skeleton
);
CREATE TABLE refused (path TEXT, reason TEXT NOT NULL);
CREATE TABLE segment (
    id INTEGER PRIMARY KEY, clip INTEGER NOT NULL REFERENCES clip,
    start INTEGER NOT NULL, stop INTEGER NOT NULL, is_donor INTEGER NOT NULL
);
CREATE TABLE label (
    joint_group TEXT NOT NULL, cluster INTEGER NOT NULL,
    segment INTEGER NOT NULL REFERENCES segment,
    PRIMARY KEY (joint_group, cluster, segment)
) WITHOUT ROWID;
"""


def write_clip_table(
    path: Path,
    table: ClipTable,
    segments: Segments,
    is_donor: BoolArray,
    labels: Mapping[str, IntArray],
    folder: Path,
) -> None:
    """Write the database of a library.

    Parameters
    ----------
    path : Path
        The file to create.
    table : ClipTable
        The clips.
    segments : Segments
        The segments.
    is_donor : ndarray of bool, shape (n_segments,)
        Whether each segment may be a donor.
    labels : mapping of str to ndarray of int, shape (n_segments,)
        The cluster of each segment, by joint group.
    folder : Path
        The library: paths of source files are written relative to it.

    Raises
    ------
    LibraryError
        If the file cannot be written.
    """
    rows = zip(table.entries, table.locations, strict=True)
    ends = (segments.clip, segments.start, segments.stop, is_donor.astype(np.int64))
    with _create_database(path) as database:
        database.executescript("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF;" + _SCHEMA)
        database.executemany(
            "INSERT INTO skeleton (id, json) VALUES (?, ?)",
            [(i, json.dumps(skeleton_to_json(one))) for i, one in enumerate(table.skeletons)],
        )
        database.executemany(
            _INSERT_CLIP, [_clip_row(i, *row, folder=folder) for i, row in enumerate(rows)]
        )
        database.executemany(
            "INSERT INTO refused (path, reason) VALUES (?, ?)", list(table.refused.items())
        )
        database.executemany(
            "INSERT INTO segment (id, clip, start, stop, is_donor) VALUES (?, ?, ?, ?, ?)",
            [(i, *row) for i, row in enumerate(np.stack(ends, axis=1).tolist())],
        )
        for group, clusters in labels.items():
            order = np.argsort(clusters, kind="stable")
            members = zip(clusters[order].tolist(), order.tolist(), strict=True)
            database.executemany(
                "INSERT INTO label (joint_group, cluster, segment) VALUES (?, ?, ?)",
                [(group, *member) for member in members],
            )


_INSERT_CLIP = """
INSERT INTO clip VALUES (
    :id, :name, :own_name, :path, :bytes, :mtime_ns, :sha256,
    :rate, :given_rate, :own_frames, :n_frames, :root, :up, :faults, :tags,
    :shard, :first_number, :n_numbers, :first_row, :kind, :frame_time, :repairs, :skeleton
)
"""


def _clip_row(
    index: int, info: ClipInfo, location: ClipLocation, *, folder: Path
) -> dict[str, Any]:
    """Return the row of a clip, by column."""
    file = info.source_file
    return {
        "id": index,
        "name": info.name,
        "own_name": info.source_name,
        "path": None if file is None else relative_path(file.path, folder).as_posix(),
        "bytes": None if file is None else file.size,
        "mtime_ns": None if file is None else file.mtime_ns,
        "sha256": None if file is None else file.sha256,
        "rate": info.source_rate,
        "given_rate": info.rate_override,
        "own_frames": info.source_frames,
        "n_frames": info.n_frames,
        "root": info.root,
        "up": info.up,
        "faults": json.dumps(info.faults),
        "tags": json.dumps(info.tags),
        "shard": location.shard,
        "first_number": location.first_number,
        "n_numbers": location.n_numbers,
        "first_row": location.first_row,
        "kind": location.content,
        "frame_time": location.frame_time,
        "repairs": json.dumps(location.repairs),
        "skeleton": location.skeleton,
    }


@contextlib.contextmanager
def _create_database(path: Path) -> Iterator[sqlite3.Connection]:
    """Create a database; errors name the file."""
    try:
        with contextlib.closing(sqlite3.connect(path)) as database, database:
            yield database
    except sqlite3.Error as error:
        raise LibraryError(f"{path} cannot be written: {error}") from error


def read_clip_table(path: Path) -> ClipTable:
    """Read the clips from the database of a library.

    Parameters
    ----------
    path : Path
        The database, in the folder of a generation of a library.

    Returns
    -------
    ClipTable
        With absolute paths of source files.

    Raises
    ------
    sqlite3.Error, KeyError, TypeError, ValueError
        If the database is damaged.
    """
    # Immutable: SQLite takes no lock and writes no file beside the database.
    uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    folder = str(path.absolute().parent.parent)
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
        return ClipTable(
            entries=tuple(_read_entries(database, folder)),
            locations=tuple(_read_locations(database)),
            skeletons=tuple(
                skeleton_from_json(json.loads(text))
                for (text,) in database.execute("SELECT json FROM skeleton ORDER BY id")
            ),
            refused=dict(database.execute("SELECT path, reason FROM refused")),
        )


_SELECT_INFO = """
SELECT name, own_name, path, bytes, mtime_ns, sha256, rate, given_rate, own_frames, n_frames,
    root, up, faults, tags
FROM clip ORDER BY id
"""


def _read_entries(database: sqlite3.Connection, folder: str) -> Iterator[ClipInfo]:
    # Unpacked by name: a mapping per row would make opening a library a quarter slower.
    for (
        name,
        own_name,
        path,
        size,
        mtime_ns,
        sha256,
        rate,
        given_rate,
        own_frames,
        n_frames,
        root,
        up,
        faults,
        tags,
    ) in database.execute(_SELECT_INFO):
        source_file = None
        if path is not None:
            absolute = os.path.normpath(os.path.join(folder, path))
            source_file = SourceFile(path=absolute, size=size, mtime_ns=mtime_ns, sha256=sha256)
        yield ClipInfo(
            name=name,
            source_name=own_name,
            source_file=source_file,
            source_rate=rate,
            rate_override=given_rate,
            source_frames=own_frames,
            n_frames=n_frames,
            root=root,
            up=up,
            faults=_strings(faults),
            tags=_strings(tags),
        )


_SELECT_LOCATION = """
SELECT shard, first_number, n_numbers, first_row, kind, frame_time, repairs, skeleton
FROM clip ORDER BY id
"""


def _read_locations(database: sqlite3.Connection) -> Iterator[ClipLocation]:
    for (
        shard,
        first_number,
        n_numbers,
        first_row,
        kind,
        frame_time,
        repairs,
        skeleton,
    ) in database.execute(_SELECT_LOCATION):
        yield ClipLocation(
            shard=shard,
            first_number=first_number,
            n_numbers=n_numbers,
            first_row=first_row,
            content=kind,
            frame_time=frame_time,
            repairs=_strings(repairs),
            skeleton=skeleton,
        )


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
    }


def skeleton_from_json(document: Mapping[str, Any]) -> Skeleton:
    """Return the skeleton of a JSON document."""
    fields = {key: value for key, value in document.items() if key != "end_sites"}
    return Skeleton(**fields, end_sites=tuple(EndSite(*site) for site in document["end_sites"]))
