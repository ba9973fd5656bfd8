"""Experiments with damaged files and several processes; see its package."""

import concurrent.futures
import ctypes
import io
import multiprocessing
import random
import resource
import shutil
import subprocess
import sys
import warnings

import numpy as np
from scipy.spatial.distance import pdist

import mograft as mg
from mograft import Library, LibraryError, clustering, write_bvh
from mograft.dancer import dance
from mograft.library.files import storage
from tests.fuzz import bvh as fuzz_bvh
from tests.library.checks import list_files
from tests.linkage.test_adversarial import assert_is_complete_linkage
from tests.weekly.attack.concurrency import compare_threads, fingerprint
from tests.weekly.attack.outcome import Outcome

MOTION = dance(seed=5, strides=1).motion


def damaged_texts(folder, count):  # noqa: ARG001 - all experiments have these arguments
    """Read damaged BVH texts: a motion or `BvhError`, whole and in chunks."""
    outcome = Outcome()
    for seed in range(count):
        outcome.trials += 1
        try:
            fuzz_bvh.check(seed)
        except Exception as error:  # whatever the reader raises is a failure
            outcome.failures.append(f"seed {seed}: {error!r}")
    return outcome


def cut_texts(folder, count):  # noqa: ARG001
    """Cut BVH texts anywhere: an error, or exactly the frames whose lines are complete."""
    outcome, rng = Outcome(), random.Random(0)
    motion = MOTION[:40]
    file = io.BytesIO()
    write_bvh(motion, file)
    text = file.getvalue()
    numbers = mg.read_bvh(io.BytesIO(text)).channel_numbers()
    start = text.index(b"Frame Time")
    for _ in range(count):
        outcome.trials += 1
        cut = text[: rng.randrange(start, len(text))]
        try:
            found = mg.read_bvh(io.BytesIO(cut)).channel_numbers()
        except mg.BvhError:
            continue
        if not np.array_equal(found, numbers[: len(found)]):
            outcome.failures.append(f"cut at {len(cut)}: other numbers")
    return outcome


def damaged_libraries(folder, count):
    """Change, cut and remove files of libraries: `verify` finds each."""
    outcome, rng = Outcome(), random.Random(0)
    library = _make_library(folder, 70)
    paths = list_files(library)
    for _ in range(count):
        path = rng.choice([path for path in paths if path.name != ".lock"])
        content = path.read_bytes()
        damage = rng.randrange(3)
        if damage == 0:
            path.unlink()
        elif damage == 1:
            path.write_bytes(content[: rng.randrange(len(content))])
        else:
            place = rng.randrange(len(content))
            changed = bytes([content[place] ^ rng.randint(1, 255)])
            path.write_bytes(content[:place] + changed + content[place + 1 :])
        outcome.trials += 1
        try:
            is_found = bool(storage.verify(library))
        except LibraryError:
            is_found = True
        is_manifest = path.name == storage.MANIFEST
        if not is_found and not (is_manifest and damage == 2):  # white space is not content
            outcome.failures.append(f"{path.name}, damage {damage}: not found")
        path.write_bytes(content)
    return outcome


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
    outcome = Outcome()
    clips = folder / "clips"
    clips.mkdir()
    for number in range(2):
        write_bvh(MOTION[number * 90 : number * 90 + 90], clips / f"{number}.bvh")
    path = folder / "l"
    expected = {}
    for sources in (clips / "0.bvh", clips):
        library = Library.index(sources, path, force=True)
        expected[len(library.entries)] = _contents(library)
        mg.graft(library)
    command = [sys.executable, "-c", _WRITER, str(path), str(clips / "0.bvh"), str(clips)]
    writer = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        writer.stdout.readline()
        held = Library.open(path)  # is read again and again, and never opened again
        first = _contents(held)
        while outcome.trials < count:
            outcome.trials += 1
            try:
                library = Library.open(path)
                if _contents(library) != expected[len(library.entries)]:
                    outcome.failures.append("a library with other contents")
                if _contents(held) != first:
                    outcome.failures.append("an open library changed")
            except Exception as error:  # any error is a failure
                outcome.failures.append(repr(error))
    finally:
        writer.kill()
        writer.wait()
        writer.stdout.close()
    return outcome


def _contents(library):
    """Return a hash of clips, samples, labels and a graft."""
    graft = mg.graft(library, seed=1).motion
    rows = [chunk.rows for chunk in library.samples.chunks()]
    return fingerprint([list(library.clips), rows, library.labels, graft])


def _graft(arguments):
    """Return the `fingerprint` of a graft, in any process or thread."""
    folder, seed = arguments
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fingerprint(mg.graft(Library.open(folder), seed=seed))


def grafts_in_workers(folder, count):
    """Make the same grafts in threads, in forked and in new processes."""
    outcome = Outcome()
    library = _make_library(folder, 160)
    seeds = range(-(-count // 3))
    expected = [_graft((library, seed)) for seed in seeds]
    pools = {"threads": concurrent.futures.ThreadPoolExecutor(8)}
    for method in multiprocessing.get_all_start_methods():
        if method != "forkserver":
            context = multiprocessing.get_context(method)
            pools[method] = concurrent.futures.ProcessPoolExecutor(2, mp_context=context)
    for name, pool in pools.items():
        with pool:
            found = list(pool.map(_graft, [(library, seed) for seed in seeds]))
        outcome.trials += len(found)
        outcome.failures += [
            f"{name}, seed {seed}"
            for seed, a, b in zip(seeds, found, expected, strict=True)
            if a != b
        ]
    return outcome


def public_functions_in_threads(folder, count):
    """Call every public function from 8 threads on one library."""
    library = _make_library(folder, 160)
    outcome = Outcome()
    while outcome.trials < count:
        outcome.add(compare_threads(library))
    return outcome


def small_linkages(folder, count):  # noqa: ARG001
    """Compute trees of small sets of points, half of them with ties."""
    outcome, rng = Outcome(), np.random.default_rng(0)
    for number in range(count):
        points = rng.normal(size=(rng.integers(2, 24), rng.integers(1, 5)))
        if number % 2:
            points = np.round(points)
        outcome.trials += 1
        try:
            tree = clustering.linkage(points, memory_limit=rng.choice([0, None]))
            assert_is_complete_linkage(tree, pdist(points), 1e-12, 0.0)
        except AssertionError:
            outcome.failures.append(f"number {number}: not a complete linkage")
    return outcome


def repeated_calls(folder, count):
    """Repeat calls; their memory must not grow by a twentieth of what one leaked result needs."""
    outcome = Outcome()
    library, file = Library.open(_make_library(folder, 160)), io.BytesIO()
    write_bvh(MOTION, file)
    points = np.random.default_rng(0).normal(size=(2000, 4))

    def read():
        file.seek(0)
        return mg.read_bvh(file).rotations

    calls = {
        "graft": (lambda: mg.graft(library).motion.rotations, 0.2),
        "read_bvh": (read, 0.3),
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
        grown = _used_bytes() - before
        outcome.trials += n
        # One result in twenty, and 8 MB of caches.
        if grown > n_bytes * n / 20 + 8e6:
            outcome.failures.append(f"{name}: {grown / n:.0f} bytes per call")
    return outcome


class _MallocState(ctypes.Structure):
    """The result of ``mallinfo2`` of glibc."""

    _names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = tuple((name, ctypes.c_size_t) for name in _names.split())


def _used_bytes():
    """Return the bytes that are allocated; without glibc 2.33, the resident bytes.

    Resident memory also holds freed arrays, as many as earlier calls of the process have left.
    """
    read = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if read is None:
        with open("/proc/self/statm") as stream:
            return int(stream.read().split()[1]) * resource.getpagesize()
    read.restype = _MallocState
    state = read()
    return state.uordblks + state.hblkhd


def _make_library(folder, n_frames):
    """Index a library of two clips in a folder and return its path."""
    clips = folder / "clips"
    clips.mkdir()
    for number in range(2):
        write_bvh(MOTION[number * 90 : number * 90 + n_frames], clips / f"{number}.bvh")
    Library.index(clips, folder / "l")
    shutil.rmtree(folder / "l" / ".lock", ignore_errors=True)
    return folder / "l"
