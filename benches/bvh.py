"""Time BVH reading and writing against pybvh, pymotion, bvhio and numpy.loadtxt.

Run with a release build: ``maturin develop --release && python benches/bvh.py``. Prints a
Markdown table. The readers of a file run alternately, so that their ratios hold on a busy machine.
A reader that has used its time budget is not run again.
"""

import argparse
import os
import platform
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run

N_JOINTS = 31
SMALL, LARGE = 2_700, 98_000
N_RUNS = 9
# Seconds after which a reader is not run again on the same file.
BUDGET_SECONDS = 15.0


def make_clip(path, n_frames):
    """Write a clip of smooth angles with four decimals, typical of motion capture."""
    rng = np.random.default_rng(7)
    block = 2_700
    steps = rng.normal(size=(block, 3 + 3 * N_JOINTS))
    smooth = np.cumsum(np.cumsum(steps, axis=0) * 0.02, axis=0)
    values = 60.0 * np.sin(smooth / (1.0 + np.abs(smooth).max(axis=0)) * 20.0)
    rows = "\n".join(" ".join(f"{number:.4f}" for number in row) for row in values).split("\n")
    lines = ["HIERARCHY"]
    for joint in range(N_JOINTS):
        kind, tab = ("ROOT" if joint == 0 else "JOINT"), "\t" * joint
        positions = "Xposition Yposition Zposition " if joint == 0 else ""
        lines += [
            f"{tab}{kind} joint{joint}",
            f"{tab}{{",
            f"{tab}\tOFFSET 0.0 {5.0 if joint else 0.0} 0.0",
            f"{tab}\tCHANNELS {6 if joint == 0 else 3} {positions}Zrotation Xrotation Yrotation",
        ]
    tab = "\t" * N_JOINTS
    lines += [f"{tab}End Site", f"{tab}{{", f"{tab}\tOFFSET 0.0 5.0 0.0", f"{tab}}}"]
    lines += ["\t" * joint + "}" for joint in reversed(range(N_JOINTS))]
    lines += ["MOTION", f"Frames: {n_frames}", "Frame Time: 0.0083333"]
    with path.open("w") as file:
        file.write("\n".join(lines) + "\n")
        for frame in range(n_frames):
            file.write(rows[frame % block] + "\n")
    return len(lines)


def run_alternately(tasks, n_runs):
    """Return the seconds of each run of each task; the tasks alternate."""
    seconds = {name: [] for name in tasks}
    for _ in range(n_runs):
        for name, task in tasks.items():
            if sum(seconds[name]) > BUDGET_SECONDS:
                continue
            start = time.perf_counter()
            task()
            seconds[name].append(time.perf_counter() - start)
    return seconds


def peers():
    """Return the other BVH libraries that are installed, by name."""
    found = {}
    try:
        import pybvh

        found["pybvh"] = pybvh
    except ImportError:
        pass
    try:
        import pymotion.io.bvh

        found["pymotion"] = pymotion.io.bvh
    except ImportError:
        pass
    try:
        import bvhio

        found["bvhio"] = bvhio
    except ImportError:
        pass
    return found


def readers(path, n_head, installed):
    """Return functions that read the file to numbers, and to quaternions."""
    numbers = {
        "mograft read_bvh": lambda: mg.read_bvh(path),
        "numpy.loadtxt (numbers only)": lambda: np.loadtxt(path, skiprows=n_head),
    }
    quaternions = {"mograft read_bvh": lambda: mg.read_bvh(path)}
    if "pybvh" in installed:
        read = installed["pybvh"].read_bvh_file
        numbers["pybvh"] = lambda: read(path, world_up="+y")
        quaternions["pybvh"] = lambda: read(path, world_up="+y").to_quat()
    if "pymotion" in installed:

        def load(*, to_quaternions=False):
            clip = installed["pymotion"].BVH()
            clip.load(str(path))
            return clip.get_data() if to_quaternions else clip

        numbers["pymotion"] = load
        quaternions["pymotion"] = lambda: load(to_quaternions=True)
    if "bvhio" in installed:
        numbers["bvhio"] = lambda: installed["bvhio"].readAsBvh(str(path))
    return numbers, quaternions


def writers(path, folder, installed):
    """Return functions that write the motion of the file."""
    motion = mg.read_bvh(path)
    recomputed = mg.Motion(motion.skeleton, motion.frame_time, motion.rotations, motion.positions)
    tasks = {
        "mograft write_bvh": lambda: mg.write_bvh(motion, folder / "a.bvh"),
        "mograft write_bvh, all angles recomputed": lambda: mg.write_bvh(
            recomputed, folder / "b.bvh"
        ),
    }
    if "pybvh" in installed:
        clip = installed["pybvh"].read_bvh_file(path, world_up="+y")
        tasks["pybvh"] = lambda: installed["pybvh"].write_bvh_file(clip, folder / "c.bvh")
    if "pymotion" in installed:
        other = installed["pymotion"].BVH()
        other.load(str(path))
        tasks["pymotion"] = lambda: other.save(str(folder / "d.bvh"))
    return tasks


def print_table(title, tasks, size, ours, n_runs):
    seconds = run_alternately(tasks, n_runs)
    medians = {name: statistics.median(runs) for name, runs in seconds.items()}
    print(f"\n| {title} | runs | median ms | MB/s | times {ours} |")
    print("|---|--:|--:|--:|--:|")
    for name, median in medians.items():
        ratio = median / medians[ours]
        row = f"{len(seconds[name])} | {median * 1e3:.1f} | {size / median / 1e6:.0f}"
        print(f"| {name} | {row} | {ratio:.2f} |", flush=True)


def main(argv=None):
    run(argparse.ArgumentParser(description=__doc__), report, argv, is_timing=True)


def report(options):
    n_runs = 1 if options.tiny else N_RUNS
    installed = peers()
    versions = [f"Python {platform.python_version()}", f"NumPy {np.__version__}"]
    print(f"{platform.machine()}, {os.cpu_count()} cores, {', '.join(versions)}, release build")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for n_frames in (20, 40) if options.tiny else (SMALL, LARGE):
            path = folder / f"{n_frames}.bvh"
            n_head = make_clip(path, n_frames)
            size = path.stat().st_size
            label = f"{size / 1e6:.1f} MB, {n_frames} frames of {N_JOINTS} joints"
            numbers, quaternions = readers(path, n_head, installed)
            print_table(f"read, {label}", numbers, size, "mograft read_bvh", n_runs)
            print_table(
                f"read to quaternions, {label}", quaternions, size, "mograft read_bvh", n_runs
            )
            tasks = writers(path, folder, installed)
            print_table(f"write, {label}", tasks, size, "mograft write_bvh", n_runs)


if __name__ == "__main__":
    main()
