"""`Workshop`: the libraries and grafts of a session, which are built when they are needed."""

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft.config import Config
from mograft.library.library import Library
from mograft.library.origin import hash_library
from mograft.motion.motion import Motion
from mograft.provenance.document import graft_record
from mograft.provenance.replay import replay
from mograft.studio.project import Record, record_key
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.newness import grafted_joints, mean_angle, newness

_MAX_BYTES = 256_000_000
"""Motions of grafts in memory; those used longest ago are built again when they are needed."""


class Workshop:
    """Libraries, provenance records and grafts. All methods can be called from any thread."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder  # to which paths in records are relative
        self.library: Library | None = None  # of new motions
        self.records: dict[str, Record] = {}
        self.texts: dict[str, str] = {}  # the records as JSON
        self.measures: dict[str, dict[str, Any]] = {}  # of motions that were built, by record
        self._grafts: OrderedDict[str, Graft] = OrderedDict()
        self._libraries: dict[str, Library] = {}  # by hash
        self._relabelled: dict[tuple[str, str], Library] = {}
        self._angles: dict[tuple[str, str], float | None] = {}
        self._lock = threading.RLock()

    def set_library(self, library: Library) -> None:
        """Set the library of new motions."""
        key = hash_library(library)
        with self._lock:
            self.library = self._libraries.setdefault(key, library)

    def configured(self, library: Library, config: Config) -> Library:
        """Return a library with another configuration; the same one for the same arguments."""
        key = (hash_library(library), str(sorted(config.as_dict().items())))
        with self._lock:
            if library.config == config:
                return self._relabelled.setdefault(key, library)
            if key not in self._relabelled:
                self._relabelled[key] = library.relabelled(config)
            return self._relabelled[key]

    def add_records(self, records: Mapping[str, Record]) -> None:
        """Add the records of a project file, with its keys."""
        for key, record in records.items():
            self.records[key] = record
            self.texts[key] = record_key(record)[1]

    def add(self, graft: Graft, sources: Sequence[str]) -> str:
        """Add a graft that was made from the files `sources`; return the key of its record."""
        if not graft.request.sources:
            graft = replace(graft, request=replace(graft.request, sources=tuple(sources)))
        key, text = record_key(record := graft_record(graft, self.folder))
        with self._lock:
            self.records[key], self.texts[key] = record, text
            self._keep(key, graft)
        return key

    def graft(self, key: str) -> Graft:
        """Return the graft of a record: one in memory, or else by replay."""
        with self._lock:
            if key in self._grafts:
                self._grafts.move_to_end(key)
                return self._grafts[key]
            record = self.records[key]
            graft = replay(_placed(record, self.folder), self._find_library(record))
            self._keep(key, graft)
            return graft

    def _keep(self, key: str, graft: Graft) -> None:
        self._grafts[key] = graft
        self.measures.setdefault(key, _measure(graft))
        sizes = {own: _size(each) for own, each in self._grafts.items()}
        while len(self._grafts) > 2 and sum(sizes.values()) > _MAX_BYTES:
            del sizes[self._grafts.popitem(last=False)[0]]

    def _find_library(self, record: Record) -> Library | None:
        """Return the library of a record in its configuration; None if it is not in memory."""
        library = self._libraries.get(record["library"]["sha256"])
        if library is None:
            return None
        return self.configured(library, Config.from_dict(record["config"]))

    def angle(self, one: str, other: str) -> float | None:
        """Return the mean angle between two motions, in radians.

        None if they have another number of frames, or one of them is not in memory.
        """
        first, second = sorted((one, other))
        if (first, second) not in self._angles:
            pair = self._grafts.get(first), self._grafts.get(second)
            if pair[0] is None or pair[1] is None:
                return None
            same = pair[0].motion.n_frames == pair[1].motion.n_frames
            joints = grafted_joints(pair[0])
            angle = mean_angle(pair[0].motion, pair[1].motion, joints) if same else None
            self._angles[first, second] = angle
        return self._angles[first, second]


def _placed(record: Record, folder: Path) -> Record:
    """Return a record whose paths, relative to `folder`, do not depend on the working folder."""
    from mograft.provenance.document import move_record

    return record if folder == Path() else move_record(record, folder, Path.cwd())


def _measure(graft: Graft) -> dict[str, Any]:
    new = newness(graft)
    return {
        "frames": graft.motion.n_frames,
        "rate": round(graft.motion.rate, 6),
        "cost": round(float(np.mean([own.cost for own in graft.substitutions])), 4),
        "new": round(new.new, 4),
        "changed": round(float(np.degrees(new.changed)), 2),
    }


def _size(graft: Graft) -> int:
    motions: list[Motion] = [graft.motion]
    motions += [] if graft.unchanged is None else [graft.unchanged.motion]
    return sum(own.rotations.nbytes + own.positions.nbytes for own in motions)
