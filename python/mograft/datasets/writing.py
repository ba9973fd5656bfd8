"""Write data sets to folders, shard by shard, so that an interrupted run can be continued."""

import csv
import hashlib
import itertools
import json
import shutil
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.atomic import exclusive_lock, write_bytes, write_text
from mograft._util.documents import read_document
from mograft._util.extras import import_extra
from mograft._util.validate import as_integer, check_choice, check_type
from mograft.datasets.augmentation import PROVENANCE, Augmentation, Window
from mograft.datasets.executors import call_each, check_executor
from mograft.datasets.features import FEATURES
from mograft.datasets.shards import FORMATS, SHARD_SIZE, Files, write_files
from mograft.errors import MograftError
from mograft.io.csv import to_csv, without_formula
from mograft.library.origin import hash_library

SCHEMA = "mograft.dataset/1"
MANIFEST = "manifest.json"
TABLE = "provenance.csv"

_HASHED = ("library", "bases")  # entries of requests
_PARTS = ".provenance"
"""Folder of the provenance of each shard, until the table is complete."""

Progress = Callable[[str, int, int], None]


def write(
    windows: Augmentation,
    folder: str | PathLike[str],
    count: int,
    *,
    format: str = "npz",  # noqa: A002 - the name that users know
    resume: bool = False,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Write windows of grafts to a folder, with their provenance and a manifest.

    Parameters
    ----------
    windows : Augmentation
        The result of `augment`.
    folder : path
        The folder to create.
    count : int
        Greatest number of windows. There are fewer if no more are new enough and different.
    format : {"npz", "parquet", "lerobot", "bvh", "glb"}
        The format of the shards. ``lerobot`` is LeRobot v3.0: each window is an episode.
    resume : bool
        Whether to continue an interrupted call with the same arguments. Files that are complete and
        unchanged are kept; the result has the bytes of an undisturbed call.
    executor : concurrent.futures.Executor, optional
        The workers that compute grafts: processes, threads, or
        ``dask.distributed.Client.get_executor()``. The result does not depend on it. The library
        must be in a folder that all workers can read. Default: the calling thread.
    progress : callable, optional
        Called with the name of a stage, the number of windows done and the number of all windows.

    Returns
    -------
    dict
        The manifest: options, shards with their SHA-256, and a ``report`` of the data set.

    Raises
    ------
    FileExistsError
        If the folder has files and `resume` is false.
    LibraryError
        If the library in the folder changes meanwhile.
    MograftError
        If a worker process is killed. The shards written so far remain.
    ValueError
        If an option is invalid; with `resume`, if the folder holds a data set of other options.
    OSError
        If a file cannot be written. Nothing is half written.
    """
    check_type("windows", windows, Augmentation)
    check_choice("format", format, tuple(FORMATS))
    if format in ("parquet", "lerobot"):
        import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
    if format == "lerobot" and "humanml3d" in windows.features:
        raise ValueError("`format` lerobot needs a row for each frame, humanml3d has another rate")
    target, request = Path(fspath(folder)), _request(windows, as_integer("count", count, 1), format)
    check_executor(executor, windows.library)
    if not resume and target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(f"{target} exists: resume the run, or choose another folder")
    target.mkdir(parents=True, exist_ok=True)
    with exclusive_lock(target / ".lock"):
        run = _Run.find(windows, target, request)
        run.write_shards(executor, progress)
        return run.finish()


def _request(windows: Augmentation, count: int, format_: str) -> dict[str, Any]:
    """Return what determines the bytes of a data set, as JSON."""
    library, part = windows.library, windows.part
    members = np.packbits(part.clips).tobytes() + windows.bases.astype("<i8").tobytes()
    return {
        "count": count,
        "format": format_,
        "library": hash_library(library),
        "config": library.config.as_dict(),
        "part": part.name,
        "bases": _hash(members),
        "rate": library.rate,
        "frames": windows.n_frames,
        "stride": windows.stride,
        "features": list(windows.features),
        "joints": list(library.skeleton.names),
        **{"seed": windows.seed, "epoch": windows.epoch},
        **{"variants": windows.variants, "min_new": windows.min_new},
    }


def _describe_change(name: str, before: Any, value: Any, rate: float) -> str:  # noqa: ANN401 - JSON
    """Return which argument differs from that of a data set, and how if it is a number or word."""
    if name in ("frames", "stride") and before is not None:
        name = "seconds" if name == "frames" else name
        before, value = (f"{n / rate:.6g}" for n in (before, value))
    if name in _HASHED or isinstance(value, list | dict):
        return f"another {'--set or --variety' if name == 'config' else f'`{name}`'}"
    return f"`{name}` {before}, not {value}"


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _entries(files: Files) -> list[dict[str, Any]]:
    return [{"file": name, "bytes": len(data), "sha256": _hash(data)} for name, data in files]


@dataclass
class _Run:
    """A data set in a folder: how far it is written, and where its next window comes from."""

    windows: Augmentation
    folder: Path
    request: dict[str, Any]
    job: int = 0
    offset: int = 0  # windows of this job that are in shards
    n_windows: int = 0
    n_in_pass: int = 0  # windows of this pass over all bases
    n_rejected: int = 0  # of the jobs before this one
    is_exhausted: int = 0  # 1 if no more windows exist
    shards: list[dict[str, Any]] = field(default_factory=list)
    features: dict[str, Any] = field(default_factory=dict)  # their shapes

    @classmethod
    def find(cls, windows: Augmentation, folder: Path, request: dict[str, Any]) -> "_Run":
        """Return the run whose whole shards are in a folder, or begin one."""
        path = folder / MANIFEST
        if not path.exists():
            if not all(own.name.startswith((".lock", ".mograft-")) for own in folder.iterdir()):
                raise FileExistsError(f"{folder} holds other files than a data set of mograft")
            run = cls(windows, folder, request)
            run.write_manifest()  # from now on the folder is ours
            return run
        document = read_document(path)
        if (found := document.get("schema")) != SCHEMA:
            raise ValueError(f"{path}: expected a manifest of {SCHEMA}, got {found}")
        known = document["request"]
        if other := [name for name, value in request.items() if known.get(name) != value]:
            name = min(other, key=_HASHED.__contains__)  # other options change the hashes, too
            change = _describe_change(name, known.get(name), request[name], request["rate"])
            raise ValueError(
                f"{folder} holds a data set with {change}; use the options with which it was "
                "begun, or choose another folder"
            )
        for own in (file for shard in document["shards"] for file in shard["files"]):
            path = folder / own["file"]
            if not path.is_file() or _hash(path.read_bytes()) != own["sha256"]:
                raise MograftError(f"{path} has changed since it was written")
        entries = {name: document[name] for name in ("shards", "features")}
        return cls(windows, folder, request, **document["state"], **entries)

    def write_shards(self, executor: Executor | None, progress: Progress | None) -> None:
        """Write shards until there are `count` windows, or a pass over all bases gives none."""
        pending, count, n_bases = list[Window](), self.request["count"], len(self.windows.bases)
        if self.n_windows == count or self.is_exhausted:
            return
        run = partial(Augmentation.run_job, encode=FORMATS[self.request["format"]].encode)
        results = call_each(executor, run, self.windows, itertools.count(self.job))
        for windows, n_rejected in results:
            for window in windows[self.offset :]:
                pending.append(window)
                self.offset, self.n_in_pass = self.offset + 1, self.n_in_pass + 1
                self.n_windows += 1
                if len(pending) == SHARD_SIZE or self.n_windows == count:
                    self._write_shard(pending)
                    pending = []
                if progress is not None:
                    progress("windows", self.n_windows, count)
                if self.n_windows == count:
                    return
            self.job, self.offset = self.job + 1, 0
            self.n_rejected += n_rejected
            if self.job % n_bases == 0:
                self.is_exhausted, self.n_in_pass = int(self.n_in_pass == 0), 0
            if self.is_exhausted:
                break
        if pending:
            self._write_shard(pending)

    def _write_shard(self, windows: list[Window]) -> None:
        """Write a shard, its provenance and then the manifest that lists it."""
        number, first = len(self.shards), self.n_windows - len(windows)
        for name, array in windows[0].features.items():
            kind = {"shape": list(array.shape), "dtype": str(array.dtype)}
            self.features[name] = {"summary": FEATURES[name].summary, **kind}
        rows = ((k, *row) for k, own in enumerate(windows, first) for row in own.provenance)
        files = FORMATS[self.request["format"]].files(number, first, windows, self.request["rate"])
        write_files(self.folder, [*files, (f"{_PARTS}/{number:05d}.csv", to_csv(rows))])
        self.shards.append({"first": first, "windows": len(windows), "files": _entries(files)})
        self.write_manifest()

    def write_manifest(self, **more: object) -> dict[str, Any]:
        """Write the manifest, with `more` entries, and return it."""
        state = {name: value for name, value in vars(self).items() if isinstance(value, int)}
        document = {"schema": SCHEMA, "request": self.request, "state": state, **more}
        document |= {"features": self.features, "shards": self.shards}
        write_text(self.folder / MANIFEST, json.dumps(document, indent=1) + "\n")
        return document

    def finish(self) -> dict[str, Any]:
        """Join the provenance of the shards, complete the manifest by a report, remove the parts.

        If the table exists, an earlier run joined it, but may have ended before all parts were
        removed.
        """
        parts = self.folder / _PARTS
        if not (self.folder / TABLE).exists():
            names = [parts / f"{number:05d}.csv" for number in range(len(self.shards))]
            body = b"".join(path.read_bytes() for path in names)
            write_bytes(self.folder / TABLE, ",".join(PROVENANCE).encode() + b"\n" + body)
        more: dict[str, Any] = {"report": self._report()}
        if (meta := FORMATS[self.request["format"]].meta) is not None:
            document = {"request": self.request, "features": self.features, "shards": self.shards}
            write_files(self.folder, files := meta(self.folder, document))
            more["files"] = _entries(files)
        document = self.write_manifest(**more)
        shutil.rmtree(parts, ignore_errors=True)
        return document

    def _report(self) -> dict[str, Any]:
        """Return a summary of the provenance: how new the windows are, and how much they use."""
        windows, library, part = self.windows, self.windows.library, self.windows.part
        measures: dict[str, tuple[float, ...]] = {}
        used: dict[str, set[tuple[str, str]]] = {name: set() for name in library.groups.names}
        donors, bases, n_captured, n_parts = set[tuple[str, str]](), set[str](), 0, 0
        with (self.folder / TABLE).open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream):
                donors.add((row["clip"], row["clip_start"]))
                used[row["group"]].add((row["clip"], row["clip_start"]))
                used[library.groups.base].add((row["base"], row["start"]))
                bases.add(row["base"])
                n_parts, n_captured = n_parts + 1, n_captured + (row["is_captured"] == "True")
                if row["window"] not in measures:
                    own = tuple(float(row[name]) for name in ("new", "changed", "gap"))
                    measures[row["window"]] = own
        new, changed, gap = np.array(list(measures.values()) or [(0.0,) * 3]).T
        cut, names = library.segments, [without_formula(name) for name in library.names]
        pairs = zip(cut.clip.tolist(), cut.start.tolist(), strict=True)
        segments = {(names[clip], str(start)): index for index, (clip, start) in enumerate(pairs)}
        is_ours, coverage = part.clips[cut.clip], dict[str, float]()
        for group, places in used.items():  # the share of segments whose cluster has a used one
            labels, known = library.labels[group], [segments[place] for place in places]
            is_covered = np.isin(labels[library.is_donor & is_ours], labels[known])
            coverage[group] = float(is_covered.mean())
        return {
            "windows": self.n_windows,
            "seconds": self.n_windows * windows.n_frames / library.rate,
            "bases": len(bases),
            "new_frames": float(new.mean()),
            "degrees_from_base": float(changed.mean()),
            "degrees_at_widest_seam": float(np.median(gap)),
            "captured_parts": n_captured / max(n_parts, 1),
            "segments_used": len(donors),
            "coverage": coverage,
            "segments_usable": int((library.is_donor & is_ours).sum()),
            "segments_with_faults": int((~library.is_donor & is_ours).sum()),
            "rejected_windows": self.n_rejected,
            "clips_of_part": int(part.clips.sum()),
            "clips_left_out": list(part.shared),
            "clips_of_other_parts": part.n_others,
        }
