"""Measure how libraries and data sets grow: index, add, open, find and augment.

Run with a release build: ``python benches/growth.py FOLDER``, where FOLDER holds BVH files of one
skeleton. It makes clips of 100 frames from them, each cut at random, warped in time, mirrored by
chance and turned by slow noise, in libraries of 1, 3 and 10 million frames (``--frames``). Each
step runs in a new process. A table has its processor seconds, with imports, and the peak memory of
all its processes; ``find`` and ``augment`` also have the milliseconds of one call in a process that
is warm, and the memory of the process that is not mapped files. A last row has the exponents of
growth. Clips and libraries of 10 million frames take about 25 GB of disk.
"""

import argparse
import shutil
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches import _common
from benches.library import run, write_list
from mograft.body.mirroring import mirror
from mograft.motion import rotations

CLIP_FRAMES = 100
N_ADDED = 10  # clips

STEP = """
import json, re, sys, time, warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import mograft as mg
from mograft import datasets
warnings.simplefilter("ignore")
step, target, listed, jobs = *sys.argv[1:4], int(sys.argv[4])


def own_memory():
    try:
        return int(re.search(r"RssAnon:\\s+(\\d+)", open("/proc/self/status").read())[1]) // 1024
    except (OSError, TypeError):
        return 0


def call(items, function):
    # The median of several calls, in ms of processor time.
    seconds = []
    for item in items:
        start = time.process_time()
        function(item)
        seconds.append(time.process_time() - start)
    return 1000 * sorted(seconds)[len(seconds) // 2]


if __name__ == "__main__":
    files, found = open(listed).read().split("\\n"), {}
    if step in ("index", "add"):
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            if step == "index":
                library = mg.Library.index(files, target, executor=pool)
            else:
                library = mg.Library.open(target).add(files, executor=pool)
    else:
        library = mg.Library.open(target)
    if step == "find":
        names = library.names[:: max(len(library.names) // 12, 1)]
        span = (0, min(60, library.entries[0].n_frames - 1))
        datasets.find(library, names[0], frames=span)
        found["ms"] = call(names[1:], lambda name: datasets.find(library, name, frames=span))
    if step == "augment":
        windows = datasets.augment(library, seconds=2.0)
        windows.run_job(0)
        found["ms"] = call(range(1, min(30, len(windows.bases))), windows.run_job)
    found |= {"own": own_memory(), "segments": len(library.segments)}
    print(json.dumps(found))
"""


def make_clip(job, sources, folder):
    """Write a clip that is made of a random source, unless an earlier run did."""
    path = folder / f"{job // 1000:03d}" / f"{job:06d}.bvh"
    if path.exists():
        return path
    path.parent.mkdir(exist_ok=True)
    rng = np.random.default_rng(job)
    motion = mg.read(sources[int(rng.integers(len(sources)))])[0]
    rate, n_frames = 1.0 / motion.frame_time, motion.n_frames
    speed = max(rng.uniform(0.9, 1.1), (CLIP_FRAMES + 1.0) / (n_frames - 1))
    warped = motion.resample(rate * speed)
    start = int(rng.integers(warped.n_frames - CLIP_FRAMES + 1))
    cut = replace(warped[start : start + CLIP_FRAMES], frame_time=motion.frame_time)
    if rng.random() < 0.5:
        cut = mirror(cut)
    times = np.linspace(0, 1, CLIP_FRAMES)[:, None, None]
    pace, phase, size = rng.uniform([[1], [0], [-0.06]], [[3], [6], [0.06]], (3, cut.n_joints * 3))
    noise = size * np.sin(2 * np.pi * pace * times[:, 0] + phase)
    turns = rotations.exp(noise.reshape(CLIP_FRAMES, cut.n_joints, 3))
    changed = rotations.multiply(cut.rotations, turns)
    motion = mg.Motion(cut.skeleton, cut.frame_time, changed, np.round(cut.positions, 3))
    mg.write_bvh(motion, path, digits=2)
    return path


def report(options):
    with tempfile.TemporaryDirectory() as temporary:
        place = options.scratch or Path(temporary)
        sources = sorted(map(str, options.folder.rglob("*.bvh"))) if options.folder else []
        sizes = options.frames
        if options.tiny:
            sources, sizes = [str(place / "source.bvh")], [2000, 3000]
            mg.write_bvh(_common.tiny_motion(), sources[0])
        (place / "clips").mkdir(exist_ok=True)
        make = partial(make_clip, sources=sources, folder=place / "clips")
        count = max(sizes) // CLIP_FRAMES + N_ADDED
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            files = list(pool.map(make, range(count), chunksize=50))
        measure(files, sizes, place, options.jobs)


def measure(files, sizes, place, jobs):
    steps = ("index", "add", "open", "find", "augment")
    print(
        "| clips | frames | segments | " + " | ".join(f"{own}: CPU s, MB" for own in steps) + " |"
    )
    print("|--:" * (3 + len(steps)) + "|", flush=True)
    rows, target = [], place / "library"
    for size in sizes:
        n, cells = size // CLIP_FRAMES, []
        for step in steps:
            listed = write_list(place, files[: n + N_ADDED * (step == "add")])
            found = run(STEP, step, target, listed, jobs)
            cells.append((found["cpu"], found["peak"], found.get("ms", 0.0), found["own"]))
            print(f"{size} {step}: {found}", file=sys.stderr, flush=True)
        rows.append([value for cpu, peak, ms, _ in cells for value in (cpu, peak, ms or 1.0)])
        texts = [f"{cpu:.1f}, {peak:.0f}" for cpu, peak, _, _ in cells]
        for index in (3, 4):
            texts[index] += f"; {cells[index][2]:.0f} ms, own {cells[index][3]} MB"
        print(f"| {n} | {size} | {found['segments']} | {' | '.join(texts)} |", flush=True)
        shutil.rmtree(target)
    if len(sizes) == 1:
        return
    powers = np.polyfit(np.log(sizes), np.log(rows), 1)[0].reshape(-1, 3)
    texts = [f"{cpu:.2f}, {peak:.2f}" for cpu, peak, _ in powers]
    for index in (3, 4):
        texts[index] += f"; {powers[index][2]:.2f}"
    print(f"| exponents | | | {' | '.join(texts)} |")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("-j", "--jobs", type=int, default=2)
    parser.add_argument(
        "--frames",
        type=lambda text: [int(float(own)) for own in text.split(",")],
        default=[10**6, 3 * 10**6, 10**7],
        help="sizes of the libraries, with commas between them",
    )
    parser.add_argument("--scratch", type=Path, help="folder for libraries and clips; clips remain")
    _common.run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
