"""The catalogue of a library: clips, skeletons, segments and labels as tables of SQLite."""

import contextlib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import IntArray
from mograft.errors import LibraryError
from mograft.library.discover import relative_path
from mograft.library.ingest import ClipProperties, PackedContent, SourceFile
from mograft.motion.skeleton import EndSite, Skeleton

__all__ = [
    "ClipInfo",
    "ClipLocation",
    "read",
    "read_skeleton",
    "skeleton_fields",
    "skeleton_of",
    "skeleton_text",
    "write",
]


@dataclass(frozen=True)
class ClipInfo:
    """What a library knows of a clip besides its frames.

    Attributes
    ----------
    name : str
        Its name, which no other clip of the library has.
    own_name : str
        What it calls itself.
    origin : Origin or None
        The file that it was read from, and what that was like then.
    rate : float
        Frames per second of the clip itself; the library's clips all have the library's.
    given_rate : float or None
        That rate, if it was given because the file has a wrong one.
    own_frames, n_frames : int
        Its frames, and those at the library's rate.
    root, up : int
        As in `Facts`.
    faults : tuple of str
        What was found in it that makes some of its segments unfit to lend.
    tags : tuple of str
        Words to choose clips by.
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
        """Return what the clip says of itself."""
        return ClipProperties(skeleton, self.source_rate, self.source_frames, self.root, self.up)


class ClipLocation(NamedTuple):
    """Where a stored clip is, and how to read it.

    Attributes
    ----------
    shard : int
        Index of the files that hold it, in the order of the manifest.
    at, size : int
        Its first number in ``frames`` and how many there are.
    row : int
        Its first row in ``samples``.
    kind, frame_time, repairs
        As in `Stored`.
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


@contextlib.contextmanager
def _database(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a new database; what goes wrong is told with its name."""
    try:
        with contextlib.closing(sqlite3.connect(path)) as base, base:
            yield base
    except sqlite3.Error as error:
        raise LibraryError(f"{path} cannot be written: {error}") from error


_TABLES = """
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
_COLUMNS = 23


def _row(number: int, entry: ClipInfo, place: ClipLocation, folder: Path) -> tuple[Any, ...]:
    source: tuple[Any, ...] = (None,) * 4
    if entry.source_file is not None:
        own = entry.source_file
        source = (relative_path(own.path, folder).as_posix(), own.size, own.mtime_ns, own.sha256)
    return (
        number,
        entry.name,
        entry.source_name,
        *source,
        entry.source_rate,
        entry.rate_override,
        entry.source_frames,
        entry.n_frames,
        entry.root,
        entry.up,
        json.dumps(entry.faults),
        json.dumps(entry.tags),
        *place[:6],
        json.dumps(place.repairs),
        place.skeleton,
    )


def write(
    path: Path,
    entries: Sequence[ClipInfo],
    places: Sequence[ClipLocation],
    skeletons: Sequence[str],
    refused: Mapping[str, str],
    segments: npt.NDArray[np.int64],
    labels: Mapping[str, IntArray],
    folder: Path,
) -> None:
    """Write what is known of clips, segments and labels, as tables.

    Parameters
    ----------
    path : Path
        The database to make.
    entries, places : sequence of Entry and of Place
        The clips.
    skeletons : sequence of str
        `skeleton_text` of those that places name, in the order of their indices.
    refused : mapping of str to str
        Files that were left out, and why.
    segments : ndarray of int, shape (n_segments, 4)
        Clip, start, stop and whether it is a donor.
    labels : mapping of str to ndarray of int, shape (n_segments,)
        The cluster of each segment, by joint group.
    folder : Path
        The library: paths of files are written as seen from there.

    Raises
    ------
    LibraryError
        If it cannot be written.
    """
    with _database(path) as base:
        base.executescript("PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF;" + _TABLES)
        base.executemany("INSERT INTO skeleton VALUES (?, ?)", list(enumerate(skeletons)))
        base.executemany(
            f"INSERT INTO clip VALUES ({', '.join('?' * _COLUMNS)})",
            [
                _row(number, entry, place, folder)
                for number, (entry, place) in enumerate(zip(entries, places, strict=True))
            ],
        )
        base.executemany("INSERT INTO refused VALUES (?, ?)", list(refused.items()))
        base.executemany(
            "INSERT INTO segment VALUES (?, ?, ?, ?, ?)",
            [(number, *row) for number, row in enumerate(segments.tolist())],
        )
        for group, own in labels.items():
            order = np.argsort(own, kind="stable")
            rows = zip(own[order].tolist(), order.tolist(), strict=True)
            base.executemany("INSERT INTO label VALUES (?, ?, ?)", [(group, *row) for row in rows])


def read(
    path: Path,
) -> tuple[tuple[ClipInfo, ...], tuple[ClipLocation, ...], tuple[Skeleton, ...], dict[str, str]]:
    """Read what `write` wrote, segments and labels apart.

    Parameters
    ----------
    path : Path
        The database, in the folder of a generation of a library.

    Returns
    -------
    entries, places, skeletons : tuple of Entry, of Place and of Skeleton
        The clips, files with their paths from here, and the skeletons that places name.
    refused : dict of str to str
        Files that were left out, and why.

    Raises
    ------
    sqlite3.Error, KeyError, TypeError, ValueError
        If it is damaged.
    """
    # As immutable: nothing is ever written beside it, and no lock is asked for.
    uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    folder = str(path.absolute().parent.parent)
    entries, places = [], []
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as base:
        for row in base.execute("SELECT * FROM clip ORDER BY id"):
            origin = None
            if row[3] is not None:
                where = os.path.normpath(os.path.join(folder, row[3]))
                origin = SourceFile(where, row[4], row[5], row[6])
            facts = row[7], row[8], row[9], row[10], row[11], row[12]
            words = _words(row[13]), _words(row[14])
            entries.append(ClipInfo(row[1], row[2], origin, *facts, *words))
            place = row[15], row[16], row[17], row[18], row[19], row[20]
            places.append(ClipLocation(*place, _words(row[21]), row[22]))
        skeletons = tuple(
            read_skeleton(text) for (text,) in base.execute("SELECT json FROM skeleton ORDER BY id")
        )
        refused = dict(base.execute("SELECT path, reason FROM refused"))
    return tuple(entries), tuple(places), skeletons, refused


def _words(text: str) -> tuple[str, ...]:
    return () if text == "[]" else tuple(json.loads(text))


def skeleton_fields(skeleton: Skeleton) -> dict[str, Any]:
    """Return a skeleton as JSON can hold it."""
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


def skeleton_of(fields: Mapping[str, Any]) -> Skeleton:
    """Return the skeleton that `skeleton_fields` made fields of."""
    rest = {key: value for key, value in fields.items() if key != "end_sites"}
    return Skeleton(**rest, end_sites=tuple(EndSite(*own) for own in fields["end_sites"]))


def skeleton_text(skeleton: Skeleton) -> str:
    """Return a skeleton as JSON."""
    return json.dumps(skeleton_fields(skeleton))


def read_skeleton(text: str) -> Skeleton:
    """Return the skeleton that `skeleton_text` made a text of."""
    return skeleton_of(json.loads(text))
