"""Public functions on one library from several threads: the results equal those of one thread."""

import dataclasses
import hashlib
import io
import tempfile
import threading
import warnings
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

import mograft as mg
import mograft.constraints as mc
from mograft import clustering, formats
from tests.weekly.attack.outcome import Outcome

EXEMPT = {
    "write_usd": "needs an optional package",
    "write_video": "runs ffmpeg",
    "write_amass": "needs a file of AMASS",
    "read_offsets": "reads one JSON file, without a library or motion",
    "write_glb_animations": "is run by write_graft on a glTF base only",
    "subtree": "makes a string",
}
"""Public functions that are not called, and why."""


def write_file(write, suffix):
    """Return the bytes of the file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"m{suffix}"
        write(path)
        return path.read_bytes()


def read_back(read, write, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"m{suffix}"
        write(path)
        return read(path)


def replay(library):
    return read_back(
        lambda path: mg.replay(path.with_suffix(".json"), library),
        lambda path: mg.write_graft(mg.graft(library, seed=4), path),
        ".bvh",
    )


def points_of(library):
    return np.array(library.embedding["lower"].points)


FAR = (mc.Avoid(mc.Sphere((0.0, 900.0, 0.0), 5.0)),)
CALLS = {
    "discover_groups": lambda library: mg.discover_groups(library.clips[:2]),
    "graft": lambda library: mg.graft(library, library.names[-1], seed=3),
    "graft_many": lambda library: mg.graft_many(library, count=3, seed=1)[:],
    "advise": lambda library: mg.advise(mg.graft(library, seed=2)),
    "edit": lambda library: mg.edit(mg.graft(library, seed=4), reroll=[2]),
    "graft_record": lambda library: mg.graft_record(mg.graft(library, seed=4)),
    "repair": lambda library: mg.repair(library, constraints=FAR),
    "replay": replay,
    "write_graft": lambda library: write_file(
        lambda path: mg.write_graft(mg.graft(library, seed=5), path), ".bvh"
    ),
    "write": lambda library: write_file(
        lambda path: mg.write(mg.graft(library, seed=5), path), ".bvh"
    ),
    "report_page": lambda library: mg.report_page([mg.graft(library, seed=6)]).html,
    "view": lambda library: mg.view(library.clips[0], groups=library.groups).html,
    "join_pieces": lambda library: mg.join_pieces(stream_pieces(library), "joined"),
    "candidates": lambda library: mg.candidates(library, 3, "upper"),
    "candidates with constraints": lambda library: mg.candidates(library, 2, "upper", FAR),
    "Library.to_dataframe": lambda library: [
        library.to_dataframe(table) for table in ("segments", "clips", "points")
    ],
    "Library.relabelled": lambda library: library.relabelled(mg.Config(sigma_scale=0.7)).labels,
    "Library.with_mirror_images": lambda library: library.with_mirror_images().segments,
    "Library.with_clip": lambda library: library.with_clip(library.clips[0][5:]).boundary_states,
    "Library.find_clip": lambda library: library.find_clip(library.clips[-1]),
    "Library.clips": lambda library: list(library.clips),
    "Library.samples": lambda library: [chunk.rows for chunk in library.samples.chunks()],
    "Library.save": lambda library: read_back(mg.Library.open, library.save, ".mograft").labels,
    "cut": lambda library: clustering.cut(points_of(library), 2.0),
    "linkage": lambda library: clustering.linkage(points_of(library)),
    "linkage_condensed": lambda library: clustering.linkage_condensed(pdist(points_of(library))),
    "threshold": lambda library: clustering.threshold(points_of(library)),
    "segment": lambda library: mg.segment(library.clips[0]),
    "find_faults": lambda library: mg.find_faults(library.clips[0]),
    "foot_skate": lambda library: mg.foot_skate(library.clips[0]),
    "plant_feet": lambda library: mg.plant_feet(library.clips[0]),
    "kinetic_energy": lambda library: mg.kinetic_energy(library.clips[0]),
    "mirror": lambda library: mg.mirror(library.clips[0]),
    "read_bvh": lambda library: mg.read_bvh(bvh_of(library)),
    "scan_bvh": lambda library: formats.scan_bvh(bvh_of(library)).n_frames,
    "write_bvh": lambda library: bvh_of(library).getvalue(),
    "read": lambda library: read_back(
        lambda path: mg.read(path)[0], lambda path: mg.write_bvh(library.clips[0], path), ".bvh"
    ),
    "read_npz": lambda library: read_back(
        formats.read_npz, lambda path: formats.write_npz(library.clips[0], path), ".npz"
    ),
    "write_npz": lambda library: write_file(
        lambda path: formats.write_npz(library.clips[0], path), ".npz"
    ),
    "write_csv": lambda library: write_file(
        lambda path: formats.write_csv(library.clips[0], path), ".csv"
    ),
    "write_glb": lambda library: write_file(
        lambda path: formats.write_glb(library.clips[0], path), ".glb"
    ),
}
"""Calls by the name of the public function, each on a library with several clips."""


def stream_pieces(library):
    stream = mg.Stream(library, seed=2)
    stream.push(library.clips[0])
    stream.close()
    return stream.pieces()


def bvh_of(library):
    file = io.BytesIO()
    mg.write_bvh(library.clips[0], file)
    file.seek(0)
    return file


def fingerprint(value):
    """Return a hash of all numbers and texts in a result."""
    digest = hashlib.sha256()
    _update(digest, value)
    return digest.hexdigest()


def _update(digest, value):
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, mg.Graft):
        _update(digest, [value.motion, value.substitutions, value.seams, value.feet])
    elif isinstance(value, mg.Motion):
        _update(digest, [value.rotations, value.positions, value.channel_numbers(), value.name])
    elif dataclasses.is_dataclass(value):
        _update(digest, {own.name: getattr(value, own.name) for own in dataclasses.fields(value)})
    elif isinstance(value, Mapping):
        _update(digest, list(value.items()))
    elif isinstance(value, Set):
        _update(digest, sorted(value))
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        digest.update(f"{len(value)}[".encode())
        for item in value:
            _update(digest, item)
    else:
        digest.update(value if isinstance(value, bytes) else repr(value).encode())


def run_calls(library, names):
    """Return the `fingerprint` of the result of each call, by name."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {name: fingerprint(CALLS[name](library)) for name in names}


def compare_threads(folder, n_threads=8, rounds=1):
    """Run all calls in several threads on one opened library, each thread in another order."""
    names, outcome = list(CALLS), Outcome()
    expected = run_calls(mg.Library.open(folder), names)
    for _ in range(rounds):
        library, start = mg.Library.open(folder), threading.Barrier(n_threads)

        def work(number, library=library, start=start):
            shift = number * len(names) // n_threads
            for name in names[shift:] + names[:shift]:
                start.wait()
                try:
                    found = fingerprint(CALLS[name](library))
                except Exception as error:  # any error of a thread is a failure
                    outcome.failures.append(f"{name}: {error!r}")
                    continue
                if found != expected[name]:
                    outcome.failures.append(f"{name}: another result")

        threads = [threading.Thread(target=work, args=(i,)) for i in range(n_threads)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        outcome.trials += n_threads * len(names)
    return outcome
