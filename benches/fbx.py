"""Time reading FBX files, compared with the import of Blender.

``python benches/fbx.py FILE...`` prints a Markdown table with the smallest time to read all takes
of each file as motions. With ``MOGRAFT_BPY_PYTHON``, the Python of an environment that has bpy, it
also prints the smallest time in which Blender's own FBX importer imports the file. Blender builds
meshes and materials, too.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft_fbx
import numpy as np

import mograft as mg
from benches._common import run
from tests.clients import blender_fbx
from tests.io import fbx_scenes as fbx

N_RUNS = 5


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="*", metavar="FILE")
    return run(parser, report, argv, is_timing=True)


def report(options):
    if mograft_fbx.BUILD_PROFILE != "release" and not options.tiny:
        sys.exit(f"refusing to time a {mograft_fbx.BUILD_PROFILE} build: pip install ./python-fbx")
    if options.tiny:
        with tempfile.TemporaryDirectory() as folder:
            _print_table([_tiny_file(Path(folder))])
        return 0
    if not options.files:
        sys.exit("name at least one FBX file")
    _print_table([Path(name) for name in options.files])
    return 0


def _print_table(paths):
    blender = blender_fbx() if os.environ.get("MOGRAFT_BPY_PYTHON") else None
    print("| file | MB | takes | joint poses | mograft, ms | MB/s | Blender, ms | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for path in paths:
        seconds, clips = min((_time(path) for _ in range(N_RUNS)), key=lambda pair: pair[0])
        n_poses = sum(motion.n_frames * motion.n_joints for motion in clips)
        megabytes = path.stat().st_size / 1e6
        cells = [f"{megabytes:.2f}", f"{len(clips)}", f"{n_poses:,}"]
        cells += [f"{seconds * 1e3:.1f}", f"{megabytes / seconds:.0f}"]
        if blender is not None:
            theirs = min(blender(path, {}, N_RUNS)["seconds"])
            cells += [f"{theirs * 1e3:.0f}", f"{theirs / seconds:.1f}"]
        print(f"| {path.name} | {' | '.join(cells)} |" + (" | |" if blender is None else ""))


def _time(path):
    start = time.perf_counter()
    clips = list(mg.read(path))
    return time.perf_counter() - start, clips


def _tiny_file(folder):
    path = folder / "tiny.fbx"
    layer = fbx.Layer({(0, "T"): np.ones((3, 3))})
    scene = fbx.Scene((fbx.Node("hips"),), (fbx.Take("walk", 3, (layer,)),))
    path.write_bytes(fbx.to_binary(scene))
    return path


if __name__ == "__main__":
    sys.exit(main())
