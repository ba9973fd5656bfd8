"""Measure time and memory of indexing, extending and opening a library.

Run with a release build: ``python benches/library.py FOLDER``, where FOLDER holds BVH files of
one skeleton. Prints the machine, the build profile and Markdown tables with seconds, processor
seconds and peak memory for 10, 30 and 100 % of the clips, and the exponent of growth. Peak memory
is the sum of the resident sets of all processes; it counts shared pages several times. With
``--kill N`` it kills N runs of index and add at random moments and checks the folders.
"""

import argparse
import json
import math
import os
import platform
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches import _common
from mograft import _core

INDEX = """
import json, sys, time, warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from mograft import Library, candidates
warnings.simplefilter("ignore")
stages = {}
last = ["start", time.perf_counter()]
def record(stage, done, total):
    now = time.perf_counter()
    stages[last[0]] = stages.get(last[0], 0.0) + now - last[1]
    last[:] = [stage, now]
action, target, jobs = sys.argv[1], sys.argv[2], int(sys.argv[4])
files = open(sys.argv[3]).read().split("\\n")
if __name__ == "__main__":
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) if jobs > 1 else None
    start = time.perf_counter()
    if action == "add":
        library = Library.open(target).add(files, executor=pool, progress=record)
    else:
        library = Library.index(files, target, "lower_torso_arms", executor=pool, progress=record)
    seconds = time.perf_counter() - start
    record("end", 0, 0)
    print(json.dumps({"seconds": seconds, "segments": len(library.segments), "stages": stages}))
    if pool is not None:
        pool.shutdown()
"""

QUERY = """
import time
begin = time.perf_counter()
import sys
from mograft import Library, candidates
start = time.perf_counter()
library = Library.open(sys.argv[1])
found = candidates(library, len(library.segments) // 2, "arms")
end = time.perf_counter()
import json, resource
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps({"import": start - begin, "query": end - start, "MB": peak, "found": len(found)}))
"""


def resident(group):
    """Return the resident MB of all processes of a group."""
    pages = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[2]) == group:
                pages += int(fields[21])
        except (OSError, IndexError, ValueError):
            continue
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def run(script, *arguments):
    """Run a script in a new process; return its JSON output, CPU seconds and peak MB."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.NamedTemporaryFile("w", suffix=".py", delete=False) as file:
        file.write(script)
    process = subprocess.Popen(
        [sys.executable, file.name, *map(str, arguments)],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # as in `mograft index`
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    peak, done = [0.0], threading.Event()

    def watch():
        while not done.wait(0.05):
            peak[0] = max(peak[0], resident(process.pid))

    watcher = threading.Thread(target=watch)
    watcher.start()
    text = process.communicate()[0]
    done.set()
    watcher.join()
    os.unlink(file.name)
    if process.returncode:
        sys.exit(f"failed with {process.returncode}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**json.loads(text.splitlines()[-1]), "cpu": cpu, "peak": peak[0]}


def write_list(folder, files):
    """Write the paths of files to a file."""
    path = Path(folder) / "files.txt"
    path.write_text("\n".join(map(str, files)))
    return path


def measure(files, jobs):
    print("\n| clips | segments | seconds | CPU s | reading | comparing | clustering | peak MB |")
    print("|--:|--:|--:|--:|--:|--:|--:|--:|")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for share in (0.1, 0.3, 1.0):
            subset = files[:: round(1 / share)]
            target = Path(folder) / f"{share}"
            result = run(INDEX, "index", target, write_list(folder, subset), jobs)
            rows.append((len(subset), result["seconds"], result["peak"]))
            stages = " | ".join(
                f"{result['stages'].get(n, 0):.1f}" for n in ("reading", "comparing", "clustering")
            )
            print(
                f"| {len(subset)} | {result['segments']} | {result['seconds']:.1f} "
                f"| {result['cpu']:.1f} | {stages} | {result['peak']:.0f} |",
                flush=True,
            )
        clips, seconds, _ = (np.log([row[i] for row in rows]) for i in range(3))
        print(f"\nseconds grow as clips^{np.polyfit(clips, seconds, 1)[0]:.2f}")
        target = Path(folder) / "all but 10"
        run(INDEX, "index", target, write_list(folder, files[:-10]), jobs)
        result = run(INDEX, "add", target, write_list(folder, files), 1)
        other = result["seconds"] - result["stages"].get("clustering", 0.0)
        print(
            f"adding 10 clips: {result['seconds']:.1f} s, {other:.1f} s without clustering, "
            f"{result['cpu']:.1f} CPU s, peak {result['peak']:.0f} MB"
        )
        result = run(QUERY, Path(folder) / "1.0")
        print(
            f"opening and listing {result['found']} candidates: {result['query'] * 1e3:.0f} ms "
            f"in a new process (import {result['import'] * 1e3:.0f} ms before), "
            f"peak {result['MB']:.0f} MB"
        )


def kill(files, times, seed=0):
    """Kill index and add at random moments; the library must be the old or the new one."""
    from mograft import Library
    from mograft.library.files import storage

    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        old_files, new_files = files[:12], files[:18]
        old = Path(folder) / "old"
        run(INDEX, "index", old, write_list(folder, old_files), 1)
        start = time.perf_counter()
        run(INDEX, "index", Path(folder) / "timed", write_list(folder, new_files), 1)
        span = time.perf_counter() - start
        counts = {"none": 0, "old": 0, "new": 0}
        for number in range(times):
            target = Path(folder) / f"l{number}"
            action = ("index", "add")[number % 2]
            if action == "add":
                shutil.copytree(old, target)
            paths = write_list(folder, new_files)
            command = [sys.executable, "-c", INDEX, action, target, paths, "1"]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            time.sleep(rng.uniform(0.2 * span, span))
            process.send_signal(signal.SIGKILL)
            process.wait()
            if not target.exists():
                counts["none"] += 1
                continue
            library = Library.open(target)
            problems = storage.verify(target)
            if problems or len(library.entries) not in (len(old_files), len(new_files)):
                sys.exit(f"{target} is damaged: {problems}, {library}")
            counts["new" if len(library.entries) == len(new_files) else "old"] += 1
            shutil.rmtree(target)
    print(f"{times} kills of index and add: {counts}; no library is damaged")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("-j", "--jobs", type=int, default=2)
    parser.add_argument("--kill", type=int, metavar="N")
    _common.run(parser, report, argv, is_timing=True)


def report(options):
    if options.tiny:
        with tempfile.TemporaryDirectory() as folder:
            files = [Path(folder) / f"{seed}.bvh" for seed in range(18)]
            for seed, path in enumerate(files):
                mg.write_bvh(_common.tiny_motion(seed, 60), path)
            measure(files, jobs=1)
            kill(files, times=1)
        return
    if options.folder is None:
        sys.exit("FOLDER is missing: a folder of BVH files of one skeleton")
    files = sorted(options.folder.rglob("*.bvh"))
    load = os.getloadavg()[0]
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f}, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, "
        f"{_core.BUILD_PROFILE} build, {len(files)} clips, {options.jobs} processes"
    )
    if load > math.ceil((os.cpu_count() or 1) / 4):
        print("other processes are running: compare CPU seconds instead of seconds")
    if options.kill:
        kill(files, options.kill)
    else:
        measure(files, options.jobs)


if __name__ == "__main__":
    main()
