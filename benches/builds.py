"""Compare the speed of two builds of mograft: grafts and indexing.

Run as ``python benches/builds.py FOLDER --other PYTHON``: PYTHON is the interpreter of an
environment with another build. Both processes index the BVH files in FOLDER, of one skeleton, and
then make grafts in turns, so that the load of the machine is the same for both. Prints processor
times of this build, and the medians of the ratios to the other one. ``--every K`` takes every K-th
file.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion

CHILD = """
import json, shutil, sys, time, warnings
import mograft as mg
warnings.simplefilter("ignore")
files, folder = json.loads(sys.stdin.readline())
motions = [mg.read_bvh(file) for file in files]
library = mg.Library.build([m.resample(30.0) if m.rate > 35 else m for m in motions])
print(len(library.segments), flush=True)
for line in sys.stdin:
    start, n = time.process_time(), 0
    if line.strip() == "index":
        n = len(mg.Library.index(files, folder).segments)
        shutil.rmtree(folder)
    else:
        n = sum(len(graft.motion) for graft in mg.graft_many(library, count=10, seed=1))
    print(json.dumps([time.process_time() - start, n]), flush=True)
"""
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def start_build(python, files, folder):
    """Start the process of a build; return it and the number of segments of its library."""
    environment = {**os.environ, **ENVIRONMENT}
    if python != sys.executable:
        environment.pop("PYTHONPATH", None)
    pipe = subprocess.PIPE
    child = subprocess.Popen(
        [python, "-c", CHILD], stdin=pipe, stdout=pipe, text=True, env=environment, cwd=folder
    )
    own = Path(folder) / f"library{child.pid}"
    return child, ask(child, json.dumps([files, str(own)]))


def ask(child, line):
    """Write a line to a process, and return its answer."""
    child.stdin.write(f"{line}\n")
    child.stdin.flush()
    return json.loads(child.stdout.readline())


def compare(builds, task, repeats):
    """Do a task `repeats` times with each build, alternating; print the times and their ratio."""
    times = [[] for _ in builds]
    for _ in range(repeats):
        for child, own in zip(builds, times, strict=True):
            seconds, n = ask(child, task)
            own.append(seconds / n)
    ratio = statistics.median(a / b for a, b in zip(*times, strict=True))
    what = {"graft": "frames", "index": "segments"}[task]
    print(f"{task:6} {1 / statistics.median(times[0]):10,.0f} {what}/s of processor time, ", end="")
    print(f"time of this build / the other: {ratio:.3f} (median of {repeats})", flush=True)


def report(options):
    """Print the figures."""
    with tempfile.TemporaryDirectory() as folder:
        files = sorted(map(str, Path(options.folder).resolve().rglob("*.bvh")))[:: options.every]
        if options.tiny:
            files = [f"{folder}/dance.bvh"]
            mg.write_bvh(tiny_motion(), files[0])
        found = [start_build(python, files, folder) for python in (sys.executable, options.other)]
        builds = [child for child, _ in found]
        print(f"{len(files)} files, segments by build: {', '.join(str(n) for _, n in found)}")
        for task, repeats in (("graft", options.repeats), ("index", options.indexings)):
            compare(builds, task, 1 if options.tiny else repeats)
        for child in builds:
            child.communicate()


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", default=".", help="BVH files of one skeleton")
    parser.add_argument("--other", default=sys.executable, help="interpreter of another build")
    parser.add_argument("--every", type=int, default=1, help="take every K-th file")
    parser.add_argument("--repeats", type=int, default=9, help="graft_many of ten, each")
    parser.add_argument("--indexings", type=int, default=2, help="indexing of all files, each")
    run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
