"""Measure the processor time per joint of reading, transforming and writing large skeletons.

Run with a release build: ``maturin develop --release && python benches/joints.py``. Prints a
Markdown table: microseconds per joint of the fastest of several runs, and the growth exponent,
which is 1 if the time is proportional to the number of joints.
"""

import argparse
import io
import math
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run
from mograft import formats
from mograft.io.bvh.cursor import open_cursor
from mograft.io.bvh.header import read_header
from mograft.io.bvh.reader import channels_to_transforms, read_frames

MAX_LEVELS = 200
N_RUNS = 3


def make_text(n_joints, n_frames, seed=7):
    """Return a BVH file of a random tree: every joint is below one of the last 20 joints."""
    rng = np.random.default_rng(seed)
    parents, levels = [-1], [0]
    for joint in range(1, n_joints):
        parent = int(rng.integers(max(0, joint - 20), joint))
        parents.append(parent if levels[parent] < MAX_LEVELS else 0)
        levels.append(levels[parents[-1]] + 1)
    children = [[] for _ in parents]
    for joint, parent in enumerate(parents[1:], 1):
        children[parent].append(joint)
    lines, pending = ["HIERARCHY"], [(0, "open")]
    while pending:
        joint, state = pending.pop()
        tab = "\t" * min(levels[joint], 20)
        if state == "close":
            lines.append(tab + "}")
            continue
        x, y, z = rng.uniform(-9, 9, 3)
        positions = "" if joint else "Xposition Yposition Zposition "
        lines += [
            f"{tab}{'JOINT' if joint else 'ROOT'} joint{joint}",
            tab + "{",
            f"{tab}\tOFFSET {x:.6f} {y:.6f} {z:.6f}",
            f"{tab}\tCHANNELS {3 if joint else 6} {positions}Zrotation Xrotation Yrotation",
        ]
        if not children[joint]:
            lines += [tab + "\tEnd Site", tab + "\t{", tab + "\t\tOFFSET 0.0 4.5 0.0", tab + "\t}"]
        pending.append((joint, "close"))
        pending += [(child, "open") for child in children[joint][::-1]]
    lines += ["MOTION", f"Frames: {n_frames}", "Frame Time: 0.0333333"]
    angles = rng.uniform(-90, 90, (n_frames, 3 * n_joints + 3))
    lines += [" ".join(f"{angle:.4f}" for angle in row) for row in angles]
    return "\n".join(lines) + "\n"


def make_stages(text, folder):
    """Return the measured functions by name; they write to files in a folder."""
    data = text.encode()
    motion = mg.read_bvh(io.BytesIO(data))
    cursor = open_cursor(io.BytesIO(data), strict=False)
    header = read_header(cursor)
    values = read_frames(cursor, header)
    changed = mg.Motion(
        motion.skeleton, motion.frame_time, motion.rotations.copy(), motion.positions.copy()
    )

    glb, npz = folder / "a.glb", folder / "a.npz"
    formats.write_glb(motion, glb)
    formats.write_npz(motion, npz)

    def new(motion):
        # Skeletons keep what is computed from them: children, body parts and masses.
        return replace(motion, skeleton=replace(motion.skeleton))

    return {
        "hierarchy": lambda: read_header(open_cursor(io.BytesIO(data), strict=False)),
        "channels to rotations": lambda: channels_to_transforms(header.skeleton, values),
        "`read_bvh`": lambda: mg.read_bvh(io.BytesIO(data)),
        "`Motion.world_transforms`": motion.world_transforms,
        "`write_bvh`": lambda: mg.write_bvh(new(motion), io.BytesIO()),
        "`write_bvh`, new angles": lambda: mg.write_bvh(new(changed), io.BytesIO()),
        "`read`, GLB": lambda: mg.read(glb)[0],
        "`write_glb`": lambda: formats.write_glb(new(motion), glb),
        "`read`, NPZ": lambda: mg.read(npz)[0],
        "`write_npz`": lambda: formats.write_npz(new(motion), npz),
        "`find_faults`": lambda: mg.find_faults(new(motion)),
    }


def measure(function):
    """Return the seconds of processor time of the fastest run."""
    seconds = []
    for _ in range(N_RUNS):
        start = time.process_time()
        function()
        seconds.append(time.process_time() - start)
    return min(seconds)


def report(options):
    """Print the table."""
    counts = [50, 100] if options.tiny else options.joints
    heads = [f"{n:,} joints" for n in counts]
    print(f"| µs per joint, {options.frames} frames | {' | '.join(heads)} | exponent |")
    print("|---|" + "--:|" * (len(counts) + 1))
    seconds_of = {}
    for n in counts:
        with tempfile.TemporaryDirectory() as folder:
            for name, function in make_stages(make_text(n, options.frames), Path(folder)).items():
                seconds_of.setdefault(name, []).append(measure(function))
    for name, seconds in seconds_of.items():
        ends = max(seconds[0], 1e-9), max(seconds[-1], 1e-9)
        exponent = math.log(ends[1] / ends[0]) / math.log(counts[-1] / counts[0])
        cells = [f"{1e6 * own / n:.1f}" for own, n in zip(seconds, counts, strict=True)]
        print(f"| {name} | {' | '.join(cells)} | {exponent:.2f} |")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--joints", type=int, nargs="+", default=[10_000, 50_000])
    parser.add_argument("--frames", type=int, default=4)
    run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
