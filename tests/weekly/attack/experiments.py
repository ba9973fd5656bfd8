"""Experiments with cut files, several processes and repeated calls.

Each yields the defects of every trial as a message, "" if there are none.
"""

import concurrent.futures
import ctypes
import io
import itertools
import multiprocessing
import random
import subprocess
import sys
import warnings

import numpy as np

import mograft as mg
from mograft import Library, clustering, write_bvh
from mograft.dancer import dance
from tests.fingerprint import fingerprint
from tests.weekly.attack.concurrency import compare_threads

MOTION = dance(seed=5, strides=1).motion


def write_clips(folder, n_frames, n_clips=2):
    """Write parts of the built-in dancer to a folder ``clips``, and return its path."""
    clips = folder / "clips"
    clips.mkdir()
    for number in range(n_clips):
        write_bvh(MOTION[number * 90 : number * 90 + n_frames], clips / f"{number}.bvh")
    return clips


def make_library(folder, n_clips=2):
    """Index a library of clips of 160 frames in a folder and return its path."""
    Library.index(write_clips(folder, 160, n_clips), folder / "l")
    return folder / "l"


def cut_texts(folder, count):  # noqa: ARG001
    """Cut BVH texts anywhere: an error, or exactly the frames whose lines are complete."""
    rng, file = random.Random(0), io.BytesIO()
    write_bvh(MOTION[:40], file)
    text = file.getvalue()
    numbers = mg.read_bvh(io.BytesIO(text)).channel_numbers()
    for _ in range(count):
        cut = text[: rng.randrange(text.index(b"Frame Time"), len(text))]
        try:
            found = mg.read_bvh(io.BytesIO(cut)).channel_numbers()
        except mg.BvhError:
            found = numbers[:0]
        is_same = np.array_equal(found, numbers[: len(found)])
        yield "" if is_same else f"cut at {len(cut)}: other numbers"


_WRITER = """
import sys, warnings
from mograft import Library
warnings.simplefilter("ignore")
library, one, both = sys.argv[1:]
print("ready", flush=True)
while True:
    Library.index(one, library, force=True)
    Library.open(library).add(both)
"""


def opens_during_rewrites(folder, count):
    """Open and read a library that another process adds to and replaces all the time."""
    clips, path = write_clips(folder, 90), folder / "l"
    expected = {}
    for sources in (clips / "0.bvh", clips):
        library = Library.index(sources, path, force=True)
        expected[len(library.entries)] = _contents(library)
        mg.graft(library)
    command = [sys.executable, "-c", _WRITER, str(path), str(clips / "0.bvh"), str(clips)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
        try:
            writer.stdout.readline()
            held = Library.open(path)  # is read again and again, and never opened again
            first = _contents(held)
            for _ in range(count):
                try:
                    library = Library.open(path)
                    is_known = _contents(library) == expected[len(library.entries)]
                    yield "" if is_known and _contents(held) == first else "other contents"
                except Exception as error:  # any error is a failure
                    yield repr(error)
        finally:
            writer.kill()


def _contents(library):
    """Return a hash of clips, samples, labels and a graft."""
    graft = mg.graft(library, seed=1).motion
    rows = [chunk.rows for chunk in library.samples.chunks()]
    return fingerprint([list(library.clips), rows, library.labels, graft])


def _graft(folder, seed):
    """Return the `fingerprint` of a graft, in any process or thread."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fingerprint(mg.graft(Library.open(folder), seed=seed))


def grafts_in_workers(folder, count):
    """Make the same grafts in threads, in forked and in new processes."""
    library, seeds = make_library(folder), range(-(-count // 3))
    expected = [_graft(library, seed) for seed in seeds]
    pools = {"threads": concurrent.futures.ThreadPoolExecutor(8)}
    for method in set(multiprocessing.get_all_start_methods()) - {"forkserver"}:
        context = multiprocessing.get_context(method)
        pools[method] = concurrent.futures.ProcessPoolExecutor(2, mp_context=context)
    for name, pool in pools.items():
        with pool:
            found = pool.map(_graft, itertools.repeat(library), seeds)
            for seed, one, other in zip(seeds, found, expected, strict=False):
                yield "" if one == other else f"{name}, seed {seed}"


def public_functions_in_threads(folder, count):
    """Call every public function from 8 threads on one library."""
    library, n_trials = make_library(folder), 0
    while n_trials < count:
        found = compare_threads(library)
        n_trials += len(found)
        yield from found


def repeated_calls(folder, count):
    """Repeat calls; their memory must not grow by a twentieth of what one leaked result needs."""
    library, file = Library.open(make_library(folder)), io.BytesIO()
    write_bvh(MOTION, file)
    points = np.random.default_rng(0).normal(size=(2000, 4))
    calls = {
        "graft": (lambda: mg.graft(library).motion.rotations, 0.2),
        "read_bvh": (lambda: mg.read_bvh(io.BytesIO(file.getvalue())).rotations, 0.3),
        "linkage": (lambda: clustering.linkage(points), 0.1),
        "open": (lambda: Library.open(library.folder).clips[0].rotations, 0.4),
    }
    for name, (call, share) in calls.items():
        n = int(share * count)
        n_bytes = call().nbytes
        for _ in range(n // 5):
            call()
        before = _used_bytes()
        for _ in range(n - n // 5):
            call()
            yield ""
        grown = _used_bytes() - before
        # One result in twenty, and 8 MB of caches.
        if grown > n_bytes * n / 20 + 8e6:
            yield f"{name}: {grown / n:.0f} bytes per call"


class _MallocState(ctypes.Structure):
    """The result of ``mallinfo2`` of glibc 2.33 or later."""

    _names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = tuple((name, ctypes.c_size_t) for name in _names.split())


def _used_bytes():
    """Return the bytes that are allocated. Resident memory would also hold freed arrays."""
    read = ctypes.CDLL(None).mallinfo2
    read.restype = _MallocState
    state = read()
    return state.uordblks + state.hblkhd
