"""Time indexing, adding to and opening a library, and watch its memory.

Run with a release build: ``python benches/library.py FOLDER``, where FOLDER holds BVH files of
one skeleton. Prints machine, build profile and Markdown tables: seconds, processor seconds,
peak memory of all processes together (the sum of their resident sets, sampled, which counts
shared pages twice), growth over 10, 30 and 100 % of the clips with its exponent. With
``--kill N`` it kills N runs of index and add at random moments instead and checks what is left.
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

from mograft import _core

INDEX = """
import json, sys, time, warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from mograft import Library
warnings.simplefilter("ignore")
stages = {}
last = ["start", time.perf_counter()]
def tell(stage, done, whole):
    now = time.perf_counter()
    stages[last[0]] = stages.get(last[0], 0.0) + now - last[1]
    last[:] = [stage, now]
way, target, jobs = sys.argv[1], sys.argv[2], int(sys.argv[4])
files = open(sys.argv[3]).read().split("\\n")
if __name__ == "__main__":
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) if jobs > 1 else None
    start = time.perf_counter()
    if way == "add":
        library = Library.open(target).add(files, executor=pool, progress=tell)
    else:
        library = Library.index(files, target, "lower_torso_arms", executor=pool, progress=tell)
    seconds = time.perf_counter() - start
    tell("end", 0, 0)
    print(json.dumps({"seconds": seconds, "segments": len(library.segments), "stages": stages}))
    if pool is not None:
        pool.shutdown()
"""

QUERY = """
import time
begin = time.perf_counter()
import sys
from mograft import Library
start = time.perf_counter()
library = Library.open(sys.argv[1])
found = library.candidates(len(library.segments) // 2, "arms")
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
    """Run a script in processes of their own; return what it says, CPU seconds and peak MB."""
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


def listed(folder, files):
    path = Path(folder) / "files.txt"
    path.write_text("\n".join(map(str, files)))
    return path


def measure(files, jobs):
    print("\n| clips | segments | seconds | CPU s | reading | comparing | clustering | peak MB |")
    print("|--:|--:|--:|--:|--:|--:|--:|--:|")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for share in (0.1, 0.3, 1.0):
            some = files[:: round(1 / share)]
            target = Path(folder) / f"{share}"
            got = run(INDEX, "index", target, listed(folder, some), jobs)
            rows.append((len(some), got["seconds"], got["peak"]))
            stages = " | ".join(
                f"{got['stages'].get(n, 0):.1f}" for n in ("reading", "comparing", "clustering")
            )
            print(
                f"| {len(some)} | {got['segments']} | {got['seconds']:.1f} | {got['cpu']:.1f} "
                f"| {stages} | {got['peak']:.0f} |",
                flush=True,
            )
        clips, seconds, _ = (np.log([row[i] for row in rows]) for i in range(3))
        print(f"\nseconds grow as clips^{np.polyfit(clips, seconds, 1)[0]:.2f}")
        most = Path(folder) / "most"
        run(INDEX, "index", most, listed(folder, files[:-10]), jobs)
        got = run(INDEX, "add", most, listed(folder, files), 1)
        beyond = got["seconds"] - got["stages"].get("clustering", 0.0)
        print(
            f"adding 10 clips: {got['seconds']:.1f} s, {beyond:.1f} s beyond clustering, "
            f"{got['cpu']:.1f} CPU s, peak {got['peak']:.0f} MB"
        )
        got = run(QUERY, Path(folder) / "1.0")
        print(
            f"opening and listing {got['found']} candidates: {got['query'] * 1e3:.0f} ms in a new "
            f"process (import {got['import'] * 1e3:.0f} ms before), peak {got['MB']:.0f} MB"
        )


def kill(files, times, seed=0):
    """Kill index and add at random moments; what is left must open and be whole."""
    from mograft import Library
    from mograft.library import storage as store

    chance = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        some, more = files[:12], files[:18]
        old = Path(folder) / "old"
        run(INDEX, "index", old, listed(folder, some), 1)
        start = time.perf_counter()
        run(INDEX, "index", Path(folder) / "timed", listed(folder, more), 1)
        span = time.perf_counter() - start
        counts = {"none": 0, "old": 0, "new": 0}
        for number in range(times):
            target = Path(folder) / f"l{number}"
            way = ("index", "add")[number % 2]
            if way == "add":
                shutil.copytree(old, target)
            command = [sys.executable, "-c", INDEX, way, target, listed(folder, more), "1"]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            time.sleep(chance.uniform(0.2 * span, span))
            process.send_signal(signal.SIGKILL)
            process.wait()
            if not target.exists():
                counts["none"] += 1
                continue
            library = Library.open(target)
            wrong = store.verify(target)
            if wrong or len(library.entries) not in (len(some), len(more)):
                sys.exit(f"{target} opens wrongly: {wrong}, {library}")
            counts["new" if len(library.entries) == len(more) else "old"] += 1
            shutil.rmtree(target)
    print(f"{times} kills of index and add: {counts}; none opens wrongly")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-j", "--jobs", type=int, default=2)
    parser.add_argument("--kill", type=int, metavar="N")
    options = parser.parse_args()
    if _core.BUILD_PROFILE != "release":
        sys.exit(f"refusing to time a {_core.BUILD_PROFILE} build: maturin develop --release")
    files = sorted(options.folder.rglob("*.bvh"))
    load = os.getloadavg()[0]
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f}, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, "
        f"{_core.BUILD_PROFILE} build, {len(files)} clips, {options.jobs} processes"
    )
    if load > math.ceil((os.cpu_count() or 1) / 4):
        print("the machine is busy with other work: CPU seconds tell more than seconds")
    if options.kill:
        kill(files, options.kill)
    else:
        measure(files, options.jobs)


if __name__ == "__main__":
    main()
