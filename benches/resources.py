"""Print processor time, wall time and peak memory of `mograft graft` and of a film.

Run as ``python benches/resources.py FILE...``; without files, the built-in dancer is used. The
files have the same skeleton and frame rate. Each row is a new process: ten grafts with their
report page; one graft of a motion of ten minutes, made of the frames of all files, joined and
repeated; and an MP4 film of the first file beside its first graft.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from mograft.dancer import dance

LONG_SECONDS = 600.0


def join(motions, seconds):
    """Return a motion of a duration: the frames of motions, one after the other, repeated."""
    first = motions[0]
    n_frames = round(seconds * first.rate)

    def repeat(arrays):
        joined = np.concatenate(arrays)
        return joined[np.arange(n_frames) % len(joined)]

    return replace(
        first,
        rotations=repeat([motion.rotations for motion in motions]),
        positions=repeat([motion.positions for motion in motions]),
        channel_values=repeat([motion.channel_numbers() for motion in motions]),
        name="long",
        path=None,
    )


def measure(name, words):
    """Run ``mograft`` in a new process, and print its time and peak memory."""
    # A process in between, whose only children are this command and its children.
    program = (
        "import resource, subprocess, sys; "
        "subprocess.run(sys.argv[1:], check=True, stdout=2); "
        "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
        "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)"
    )
    command = [sys.executable, "-m", "mograft", *map(str, words)]
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", program, *command], check=True, capture_output=True, text=True
    )
    wall = time.perf_counter() - start
    cpu, peak = map(float, done.stdout.split())
    print(f"{name:<44} {cpu:7.1f} s CPU {wall:7.1f} s {peak:7.0f} MB")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*")
    run(parser, report, argv, is_timing=True)


def report(options):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = options.files
        if options.tiny or not files:
            files = [folder / "dance.bvh"]
            mg.write_bvh(tiny_motion() if options.tiny else dance().motion, files[0])
        motions = [mg.read_bvh(file) for file in files]
        seconds = 12.0 if options.tiny else LONG_SECONDS
        long, made = folder / "long.bvh", folder / "made"
        mg.write_bvh(join(motions, seconds), long)
        del motions
        count = 2 if options.tiny else 10
        measure(
            f"{count} grafts and page", ["graft", *files, "--count", count, "--report", "-o", made]
        )
        measure(f"graft of {seconds:.0f} s", ["graft", long, "-o", folder / "new.bvh"])
        graft = next(iter(sorted(made.glob("*_graft0.bvh"))))
        size = ["--size", "64x64"] if options.tiny else []
        measure("film of two figures", ["export", files[0], graft, *size, "-o", folder / "m.mp4"])


if __name__ == "__main__":
    main()
