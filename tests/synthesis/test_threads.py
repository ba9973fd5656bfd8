"""Grafts of one library in many threads have the bytes of serial grafts."""

import json
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

import mograft as mg
from mograft.dancer import dance
from mograft.stream.stream import join_pieces

pytestmark = pytest.mark.usefixtures("quick_switches")

N_THREADS = 8


@pytest.fixture
def quick_switches():
    """Let threads take turns as often as possible; without a GIL they run at the same time."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


@pytest.fixture(scope="module")
def library_folder(tmp_path_factory):
    """Return the folder of a library with two clips."""
    folder = tmp_path_factory.mktemp("threads") / "dance.mograft"
    clips = [dance(seed=seed, strides=1).motion[:500] for seed in (0, 1)]
    mg.Library.build(clips, groups="lower_torso_arms").save(folder)
    return folder


def bytes_of(graft):
    """Return the motion and the provenance of a graft as bytes."""
    motion = graft.motion
    text = json.dumps(mg.graft_record(graft), sort_keys=True).encode()
    return motion.rotations.tobytes() + motion.positions.tobytes() + text


def graft_plainly(seed, library, **options):
    return bytes_of(mg.graft(library, seed=seed, **options))


def graft_with_constraint(seed, library):
    return graft_plainly(seed, library, constraints=[mg.constraints.MaxStretch(1.3)])


def stream_base(seed, library):
    stream = mg.Stream(library, seed=seed)
    base = library.clips[seed % 2][:200]
    for frame in range(0, 200, 20):
        stream.push(base[frame : frame + 20])
    stream.close()
    return join_pieces(stream.pieces()).rotations.tobytes()


def list_candidates(seed, library):
    found = mg.candidates(library, segment=10 + seed, group="torso")
    return repr([(c.segment, c.cost) for c in found.allowed]).encode()


def run_together(tasks):
    """Return the results of tasks that begin at the same time, one thread for each."""
    barrier = threading.Barrier(len(tasks))

    def run(task):
        barrier.wait()
        return task()

    with ThreadPoolExecutor(len(tasks)) as pool:
        return list(pool.map(run, tasks))


def test_threads_with_different_work_give_serial_bytes(library_folder):
    works = [graft_plainly] * 5 + [stream_base, list_candidates, graft_with_constraint]
    assert len(works) == N_THREADS
    alone = mg.Library.open(library_folder)
    serial = [work(seed, alone) for seed, work in enumerate(works)]
    shared = mg.Library.open(library_folder)
    tasks = [partial(work, seed, shared) for seed, work in enumerate(works)]
    assert run_together(tasks) == serial


def test_threads_that_build_libraries_give_serial_bytes():
    clips = [dance(seed=seed, strides=1).motion[:500] for seed in (0, 1)]

    def build(seed):
        library = mg.Library.build(clips[seed % 2])
        return library.labels["lower"].tobytes() + library.embedding["lower"].points.tobytes()

    serial = [build(seed) for seed in range(4)]
    assert run_together([partial(build, seed) for seed in range(4)]) == serial
    assert serial[0] != serial[1]
