"""Write data sets to folders, shard by shard, so that an interrupted run can be continued."""

import csv
import hashlib
import io
import itertools
import json
import shutil
from collections import Counter
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
from mograft.datasets.measuring import TABLE, Places, coverage
from mograft.datasets.shards import FORMATS, SHARD_SIZE, Files, write_files
from mograft.errors import MograftError
from mograft.io.csv import without_formula
from mograft.library.origin import hash_library

SCHEMA = "mograft.dataset/1"
MANIFEST = "manifest.json"

_HASHED = ("library", "bases")  # entries of requests
_PARTS = ".provenance"
"""Folder of the provenance of each shard, until the table is complete."""

Progress = Callable[[str, int, int], None]


@dataclass
class _State:
    """How far a data set is written, and where its next window comes from."""

    job: int = 0
    offset: int = 0  # windows of this job that are in shards
    n_windows: int = 0
    n_in_pass: int = 0  # windows of this pass over all bases
    n_rejected: int = 0  # of the jobs before this one
    is_exhausted: int = 0  # 1 if no more windows exist
    shards: list[dict[str, Any]] = field(default_factory=list)
    features: dict[str, Any] = field(default_factory=dict)  # their shapes

    def as_dict(self) -> dict[str, int]:
        return {name: value for name, value in vars(self).items() if isinstance(value, int)}


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
        state = _find_state(target, request)
        _write_shards(windows, target, request, state, executor, progress)
        return _finish(windows, target, request, state)


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
        "bases": hashlib.sha256(members).hexdigest(),
        "rate": library.rate,
        "frames": windows.n_frames,
        "stride": windows.stride,
        "features": list(windows.features),
        "joints": list(library.skeleton.names),
        "seed": windows.seed,
        "epoch": windows.epoch,
        "variants": windows.variants,
        "min_new": windows.min_new,
    }


def _describe_change(name: str, before: Any, value: Any, rate: float) -> str:  # noqa: ANN401 - JSON
    """Return which argument differs from that of a data set, and how if it is a number or word."""
    if name in ("frames", "stride") and before is not None:
        name = "seconds" if name == "frames" else name
        before, value = (f"{n / rate:.6g}" for n in (before, value))
    if name in _HASHED or isinstance(value, list | dict):
        return f"another {'--set or --variety' if name == 'config' else f'`{name}`'}"
    return f"`{name}` {before}, not {value}"


def _find_state(folder: Path, request: dict[str, Any]) -> _State:
    """Return the state of the whole shards in a folder."""
    path = folder / MANIFEST
    if not path.exists():
        if not all(own.name.startswith((".lock", ".mograft-")) for own in folder.iterdir()):
            raise FileExistsError(f"{folder} holds other files than a data set of mograft")
        _write_manifest(folder, request, _State())  # from now on the folder is ours
        return _State()
    document = read_document(path)
    if document.get("schema") != SCHEMA:
        raise ValueError(f"{path}: expected a manifest of {SCHEMA}, got {document.get('schema')}")
    known = document["request"]
    if other := [name for name, value in request.items() if known.get(name) != value]:
        name = min(other, key=_HASHED.__contains__)  # other options change the hashes, too
        change = _describe_change(name, known.get(name), request[name], request["rate"])
        raise ValueError(
            f"{folder} holds a data set with {change}; use the options with which it was begun, "
            "or choose another folder"
        )
    state = _State(**document["state"], features=document["features"])
    for shard in document["shards"]:
        damaged = [own for own in shard["files"] if not _is_whole(folder, own)]
        if damaged:
            raise MograftError(f"{folder / damaged[0]['file']} has changed since it was written")
        state.shards.append(shard)
    return state


def _is_whole(folder: Path, entry: dict[str, Any]) -> bool:
    path = folder / entry["file"]
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == entry["sha256"]


def _write_shards(
    windows: Augmentation,
    folder: Path,
    request: dict[str, Any],
    state: _State,
    executor: Executor | None,
    progress: Progress | None,
) -> None:
    """Write shards until there are `count` windows, or a pass over all bases gives none."""
    pending, count, n_bases = list[Window](), request["count"], len(windows.bases)
    written = state.n_windows
    if written == count or state.is_exhausted:
        return
    run = partial(Augmentation.run_job, encode=FORMATS[request["format"]].encode)
    jobs = itertools.count(state.job)
    results = call_each(executor, run, windows, itertools.count(state.job))
    for job, result in zip(jobs, results, strict=True):
        state.job, n_known = job, state.offset
        for offset, window in enumerate(result.windows[n_known:], n_known + 1):
            pending.append(window)
            state.offset, state.n_in_pass = offset, state.n_in_pass + 1
            state.n_windows = written + len(pending)
            if len(pending) == SHARD_SIZE or state.n_windows == count:
                _write_shard(folder, request, state, pending)
                written, pending = state.n_windows, []
            if progress is not None:
                progress("windows", state.n_windows, count)
            if state.n_windows == count:
                return
        is_end = (job + 1) % n_bases == 0
        state.job, state.offset = job + 1, 0
        state.n_rejected += result.n_rejected
        if is_end and state.n_in_pass == 0:
            state.is_exhausted = 1
            break
        state.n_in_pass = 0 if is_end else state.n_in_pass
    if pending:
        _write_shard(folder, request, state, pending)


def _write_shard(
    folder: Path, request: dict[str, Any], state: _State, windows: list[Window]
) -> None:
    """Write a shard, its provenance and then the manifest that lists it."""
    number, first = len(state.shards), state.n_windows - len(windows)
    for name, array in windows[0].features.items():
        kind = {"shape": list(array.shape), "dtype": str(array.dtype)}
        state.features[name] = {"summary": FEATURES[name].summary, **kind}
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    for index, window in enumerate(windows, first):
        for row in window.provenance:
            cells = [without_formula(own) if isinstance(own, str) else own for own in row]
            rows.writerow([index, *cells])
    files = FORMATS[request["format"]].files(number, first, windows, request["rate"])
    part = (f"{_PARTS}/{number:05d}.csv", text.getvalue().encode("utf-8", "replace"))
    write_files(folder, [*files, part])
    state.shards.append({"first": first, "windows": len(windows), "files": _entries(files)})
    _write_manifest(folder, request, state)


def _entries(files: Files) -> list[dict[str, Any]]:
    return [
        {"file": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        for name, data in files
    ]


def _write_manifest(
    folder: Path, request: dict[str, Any], state: _State, **more: object
) -> dict[str, Any]:
    document = {"schema": SCHEMA, "request": request, "state": state.as_dict(), **more}
    document |= {"features": state.features, "shards": state.shards}
    write_text(folder / MANIFEST, json.dumps(document, indent=1) + "\n")
    return document


def _finish(
    windows: Augmentation, folder: Path, request: dict[str, Any], state: _State
) -> dict[str, Any]:
    """Join the provenance of the shards, complete the manifest by a report, and remove the parts.

    If the table exists, an earlier run joined it, but may have ended before all parts were removed.
    """
    parts = folder / _PARTS
    if not (folder / TABLE).exists():
        names = [parts / f"{number:05d}.csv" for number in range(len(state.shards))]
        body = b"".join(path.read_bytes() for path in names)
        write_bytes(folder / TABLE, ",".join(PROVENANCE).encode() + b"\n" + body)
    more: dict[str, Any] = {"report": _report(windows, folder, state)}
    if (meta := FORMATS[request["format"]].meta) is not None:
        document = {"request": request, "features": state.features, "shards": state.shards}
        write_files(folder, files := meta(folder, document))
        more["files"] = _entries(files)
    document = _write_manifest(folder, request, state, **more)
    shutil.rmtree(parts, ignore_errors=True)
    return document


def _report(windows: Augmentation, folder: Path, state: _State) -> dict[str, Any]:
    """Return a summary of the provenance: how new the windows are, and how much they use."""
    library, part, donors = windows.library, windows.part, Counter[tuple[str, ...]]()
    measures: dict[str, tuple[float, ...]] = {}
    used: Places = {name: set() for name in library.groups.names}
    bases, n_captured, n_parts = Counter[str](), 0, 0
    with (folder / TABLE).open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            donors[row["clip"], row["clip_start"]] += 1
            used[row["group"]].add((row["clip"], row["clip_start"]))
            used[library.groups.base].add((row["base"], row["start"]))
            n_parts, n_captured = n_parts + 1, n_captured + (row["is_captured"] == "True")
            if row["window"] not in measures:
                bases[row["base"]] += 1
                own = tuple(float(row[name]) for name in ("new", "changed", "gap"))
                measures[row["window"]] = own
    new, changed, gap = np.array(list(measures.values()) or [(0.0,) * 3]).T
    is_ours = part.clips[library.segments.clip]
    n_donors = int((library.is_donor & is_ours).sum())
    return {
        "windows": state.n_windows,
        "seconds": state.n_windows * windows.n_frames / library.rate,
        "bases": len(bases),
        "new_frames": float(new.mean()),
        "degrees_from_base": float(changed.mean()),
        "degrees_at_widest_seam": float(np.median(gap)),
        "captured_parts": n_captured / max(n_parts, 1),
        "segments_used": len(donors),
        "coverage": coverage(windows, used),
        "segments_usable": n_donors,
        "segments_with_faults": int((~library.is_donor & is_ours).sum()),
        "rejected_windows": state.n_rejected,
        "clips_of_part": int(part.clips.sum()),
        "clips_left_out": list(part.shared),
        "clips_of_other_parts": part.n_others,
    }
