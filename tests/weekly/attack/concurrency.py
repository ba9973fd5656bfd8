"""Public functions on one library from several threads: the results equal those of one thread."""

import tempfile
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

import mograft as mg
import mograft.constraints as mc
from mograft import clustering, formats
from mograft.dancer import dance
from tests.fingerprint import fingerprint

EXEMPT = {
    "write_usd": "needs an optional package",
    "write_video": "runs ffmpeg",
    "write_amass": "needs a file of AMASS",
    "write_glb_animations": "is run by write_graft on a glTF base only",
    "subtree": "makes a string",
    **dict.fromkeys(("read_model", "write_table", "write_tracker"), "needs the model of a robot"),
}
"""Public functions that are not called, and why."""


def through_file(write, suffix, read=Path.read_bytes):
    """Return what `read` returns for the file that `write` makes; by default its bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"m{suffix}"
        write(path)
        return read(path)


def replay(library):
    return through_file(
        lambda path: mg.write_graft(mg.graft(library, seed=4), path),
        ".bvh",
        lambda path: mg.replay(path.with_suffix(".json"), library),
    )


def stream_pieces(library):
    stream = mg.Stream(library, seed=2)
    stream.push(library.clips[0])
    stream.close()
    return stream.pieces()


def on_clip(function):
    """Return a call of a function with the first clip of a library."""
    return lambda library: function(library.clips[0])


def on_points(function):
    """Return a call of a function with the points of a library."""
    return lambda library: function(np.array(library.embedding["lower"].points))


def on_file(write, suffix, read=Path.read_bytes):
    """Return a call that writes the first clip of a library to a file and reads it."""
    return on_clip(lambda clip: through_file(lambda path: write(clip, path), suffix, read))


STEPS = dance(seed=0, strides=2).motion[:400]
FAR = (mc.Avoid(mc.Sphere((0.0, 900.0, 0.0), 5.0)),)
CALLS = {
    "discover_groups": lambda own: mg.discover_groups(own.clips[:2]),
    "graft": lambda own: mg.graft(own, own.names[-1], seed=3),
    "graft_many": lambda own: mg.graft_many(own, count=3, seed=1)[:],
    "advise": lambda own: mg.advise(mg.graft(own, seed=2)),
    "newness": lambda own: mg.newness(mg.graft(own, seed=2)),
    "edit": lambda own: mg.edit(mg.graft(own, seed=4), mg.constraints.Ban(2)),
    "change": lambda own: mg.change(mg.graft(own, seed=4), "upper", (40, 90)),
    "graft_record": lambda own: mg.graft_record(mg.graft(own, seed=4)),
    "repair": lambda own: mg.repair(own, constraints=FAR),
    "replay": replay,
    "write_graft": lambda own: through_file(lambda p: mg.write_graft(mg.graft(own), p), ".bvh"),
    "write": lambda own: through_file(lambda p: mg.write(mg.graft(own), p), ".bvh"),
    "report_page": lambda own: mg.report_page([mg.graft(own, seed=6)]).html,
    "view": lambda own: mg.view(own.clips[0], groups=own.groups).html,
    "join_pieces": lambda own: mg.join_pieces(stream_pieces(own), "joined"),
    "candidates": lambda own: [mg.candidates(own, 3, "upper", far) for far in ((), FAR)],
    "to_dataframe": lambda own: [own.to_dataframe(t) for t in ("segments", "clips", "points")],
    "relabelled": lambda own: own.relabelled(mg.Config(sigma_scale=0.7)).labels,
    "with_mirror_images": lambda own: own.with_mirror_images().segments,
    "with_clip": lambda own: own.with_clip(own.clips[0][5:]).boundary_states,
    "find_clip": lambda own: own.find_clip(own.clips[-1]),
    "clips": lambda own: list(own.clips),
    "samples": lambda own: [chunk.rows for chunk in own.samples.chunks()],
    "save": lambda own: through_file(own.save, ".mograft", mg.Library.open).labels,
    "cut_cycle": lambda _: mg.cut_cycle(STEPS),  # the clips have no cycle
    **{own.__name__: on_clip(own) for own in (mg.segment, mg.find_faults, mg.foot_skate)},
    **{own.__name__: on_clip(own) for own in (mg.plant_feet, mg.kinetic_energy, mg.mirror)},
    "read": on_file(mg.write_bvh, ".bvh", lambda path: mg.read(path)[0]),
    "read_bvh": on_file(mg.write_bvh, ".bvh", mg.read_bvh),
    "write_bvh": on_file(mg.write_bvh, ".bvh"),
    "write_npz": on_file(formats.write_npz, ".npz"),
    "write_csv": on_file(formats.write_csv, ".csv"),
    "write_glb": on_file(formats.write_glb, ".glb"),
    "cut": on_points(lambda points: clustering.cut(points, 2.0)),
    "linkage": on_points(clustering.linkage),
    "linkage_condensed": on_points(lambda points: clustering.linkage_condensed(pdist(points))),
    "threshold": on_points(clustering.threshold),
}
"""Calls with a library, by the name of the public function or method of libraries."""


def compare_threads(folder, n_threads=8):
    """Make all calls in several threads on one opened library, each thread in another order."""
    names = list(CALLS)

    def work(number):
        shift, found = number * len(names) // n_threads, []
        for name in names[shift:] + names[:shift]:
            start.wait()
            try:
                is_same = fingerprint(CALLS[name](library)) == expected[name]
                found.append("" if is_same else f"{name}: another result")
            except Exception as error:  # any error of a thread is a failure
                found.append(f"{name}: {error!r}")
        return found

    with warnings.catch_warnings(), ThreadPoolExecutor(n_threads) as pool:
        warnings.simplefilter("ignore")
        library = mg.Library.open(folder)
        expected = {name: fingerprint(call(library)) for name, call in CALLS.items()}
        library, start = mg.Library.open(folder), threading.Barrier(n_threads)
        return [message for found in pool.map(work, range(n_threads)) for message in found]
