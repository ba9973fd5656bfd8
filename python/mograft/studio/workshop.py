"""`Workshop`: the libraries and grafts of a session, which are built when they are needed."""

import json
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.containers import SizedCache
from mograft.body.loops import is_loop
from mograft.config import Config, scale_of_variety
from mograft.errors import LibraryError, ProvenanceError
from mograft.library.library import Library
from mograft.library.origin import hash_library, hash_poses, is_partial
from mograft.motion.motion import Motion
from mograft.provenance.document import graft_record, move_record
from mograft.provenance.graft_record import find_whole_library, read_record
from mograft.provenance.replay import replay
from mograft.studio.project import Record, record_key
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.newness import grafted_joints, mean_angle, newness
from mograft.viewing.encoding import encode_objects
from mograft.viewing.figure import ShownConstraint

_MAX_BYTES = 256_000_000
"""Motions of grafts in memory; those used longest ago are built again when they are needed."""

_MAX_LIBRARIES = 4
_MAX_CONFIGURED = 6  # libraries with other options, such as the variety
_MAX_UNUSED = 100  # records
_SHOWN = (
    *("name", "base", "seed", "frames", "frame_time", "remarks", "violations"),
    *("groups", "scenario"),
)
"""Keys of a record that the page shows."""


class Workshop:
    """Libraries, provenance records and grafts. All methods can be called from any thread."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder  # to which paths in records are relative
        self.library: Library | None = None  # of new motions
        self.texts: dict[str, str] = {}  # records as JSON; as objects they need ten times as much
        self.summaries: dict[str, Record] = {}  # what the page shows of each record
        self.measures: dict[str, dict[str, Any]] = {}  # of motions that were built, by record
        self._grafts = SizedCache[str, Graft](_MAX_BYTES, 2)  # a motion and its preview
        self._libraries = SizedCache[str, Library](_MAX_LIBRARIES)  # by hash
        self._configured = SizedCache[tuple[str, Config], Library](_MAX_CONFIGURED)
        self._angles: dict[tuple[str, str], float | None] = {}
        self._building = threading.RLock()  # one graft or library at a time

    def set_library(self, library: Library) -> None:
        """Set the library of new motions."""
        self.library = self._add_library(library)

    def _add_library(self, library: Library) -> Library:
        key = hash_library(library)
        return self._libraries.put(key, self._libraries.get(key) or library, 1)

    def configured(self, library: Library, config: Config) -> Library:
        """Return a library with another configuration; the same one for the same arguments."""
        if library.config == config:
            return library
        key = (hash_library(library), config)
        with self._building:
            known = self._configured.get(key) or library.relabelled(config)
            return self._configured.put(key, known, 1)

    def with_variety(self, library: Library, variety: float | None) -> Library:
        """Return a library whose neighbourhoods allow more or fewer donors; None: as many."""
        if variety is None:
            return library
        config = replace(library.config, sigma_scale=scale_of_variety(variety))
        return self.configured(library, config)

    def add_records(self, records: Mapping[str, Record]) -> None:
        """Add the records of a project file, with its keys."""
        for key, record in records.items():
            self._add_record(key, record, record_key(record)[1])

    def _add_record(self, key: str, record: Record, text: str) -> None:
        summary = {name: record.get(name) for name in _SHOWN}
        summary["constraints"] = record.get("request", {}).get("constraints", [])
        summary["library"] = record.get("library", {}).get("sha256")
        self.texts[key], self.summaries[key] = text, summary

    def record(self, key: str) -> Record:
        """Return a provenance record with paths relative to the working folder."""
        return move_record(json.loads(self.texts[key]), self.folder, Path())

    def keep_only(self, keys: Collection[str]) -> None:
        """Forget the records that have none of these keys, if they are many."""
        if len(self.texts) > 2 * len(keys) + _MAX_UNUSED:
            for key in self.texts.keys() - keys:
                for table in (self.texts, self.summaries, self.measures):
                    table.pop(key, None)
            self._angles.clear()

    def add(self, graft: Graft, sources: Callable[[], Sequence[str]]) -> str:
        """Add a graft that was made from the files `sources()`; return the key of its record."""
        if not graft.request.sources:
            graft = replace(graft, request=replace(graft.request, sources=tuple(sources())))
        record = graft_record(graft, self.folder)
        key, text = record_key(record)
        self._add_record(key, record, text)
        self.keep(key, graft)
        return key

    def rename(self, key: str, name: str) -> str:
        """Return the key of a record with another name of the motion."""
        record = {**json.loads(self.texts[key]), "name": name}
        new, text = record_key(record)
        self._add_record(new, record, text)
        if key in self.measures:
            self.measures[new] = self.measures[key]
        graft = self._grafts.get(key)
        if graft is not None:
            self.keep(new, renamed(graft, name))
        return new

    def graft(self, key: str) -> Graft:
        """Return the graft of a record: one in memory, or else by replay."""
        graft = self._grafts.get(key)
        if graft is None:
            with self._building:  # another thread may have built it meanwhile
                graft = self._grafts.get(key)
                if graft is None:
                    record = self.record(key)
                    graft = replay(record, self._find_library(record))
        return self.keep(key, graft)

    def find(self, key: str) -> Graft | None:
        """Return the graft of a record if it is in memory."""
        return self._grafts.get(key)

    def editable(self, key: str) -> Graft:
        """Return the graft of a record with the library of new motions, if that has its clips.

        Otherwise return it with its own library, which may take long to build. Raise
        ProvenanceError, LibraryError or OSError if that cannot be built.
        """
        graft, library = self.graft(key), self.library
        with self._building:
            if library is not None and hash_library(library) != self.summaries[key]["library"]:
                rebased = self._rebase(key, library)
                if rebased is not None:
                    return rebased
            return self._whole(key) if is_partial(graft.library) else graft

    def _rebase(self, key: str, library: Library) -> Graft | None:
        """Return a graft on another library; None if its motion would be another one."""
        record = self.record(key)
        own = self.configured(library, Config.from_dict(record["config"]))
        if record["groups_toml"] != library.groups.to_toml():
            return None
        section = {**record["library"], "sha256": hash_library(library)}
        try:
            graft = replay({**record, "library": section}, own)
        except ProvenanceError:
            return None
        return graft if hash_poses(graft.motion) == record["poses_sha256"] else None

    def _whole(self, key: str) -> Graft:
        """Return a graft with all clips of its library, built from their files."""
        record = read_record(self.record(key))
        library = self._add_library(find_whole_library(record, ()))
        return self.keep(key, replay(record.document, self.configured(library, record.config)))

    def keep(self, key: str, graft: Graft) -> Graft:
        """Keep a graft in memory, measure it, and return it."""
        if key in self.texts and key not in self.measures:
            self.measures[key] = _measure(graft)
        return self._grafts.put(key, graft, _size(graft))

    def _find_library(self, record: Record) -> Library | None:
        """Return the library of a record in its configuration; None if it is not in memory."""
        library = self._libraries.get(record["library"]["sha256"])
        if library is None:
            return None
        try:
            return self.configured(library, Config.from_dict(record["config"]))
        except (LibraryError, ValueError):
            return None

    def angle(self, one: str, other: str) -> float | None:
        """Return the mean angle between two motions, in radians.

        None if they have another number of frames, or one of them is not in memory.
        """
        first, second = sorted((one, other))
        if (first, second) not in self._angles:
            pair = self._grafts.get(first), self._grafts.get(second)
            if pair[0] is None or pair[1] is None:
                return None
            a, b = pair[0].motion, pair[1].motion
            is_comparable = (a.n_frames, a.n_joints) == (b.n_frames, b.n_joints)
            angle = mean_angle(a, b, grafted_joints(pair[0])) if is_comparable else None
            self._angles[first, second] = angle
        return self._angles[first, second]


def renamed(graft: Graft, name: str) -> Graft:
    """Return a graft whose motion has another name, also the motion before its changes."""
    original = None if graft.unchanged is None else renamed(graft.unchanged, name)
    return replace(graft, motion=replace(graft.motion, name=name), unchanged=original)


def _measure(graft: Graft) -> dict[str, Any]:
    """Return what the page shows of a motion, and its obstacles and targets in its axes."""
    new = newness(graft)
    shapes = {}
    for number, own in enumerate(graft.request.constraints):
        if not own.is_on_poses:
            continue
        found = encode_objects([ShownConstraint(own, graft.motion)])
        if found and found[0]["kind"] != "figure":
            shapes[number] = found[0]
    return {
        "cost": round(float(np.mean([own.cost for own in graft.substitutions])), 4),
        "new": round(new.new, 4),
        "isLoop": is_loop(graft.motion),
        "shapes": shapes,
    }


def _size(graft: Graft) -> int:
    motions: list[Motion] = [graft.motion]
    motions += [] if graft.unchanged is None else [graft.unchanged.motion]
    return sum(own.rotations.nbytes + own.positions.nbytes for own in motions)
