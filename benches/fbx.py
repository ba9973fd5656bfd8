"""Time reading FBX files, compared with the imports of Blender.

``python benches/fbx.py FILE...`` prints a Markdown table with the smallest time to read all takes
of each file as motions. With ``MOGRAFT_BPY_PYTHON``, the Python of an environment that has bpy 4.5
or later, it also prints the smallest times of Blender's importers: `import_scene.fbx`, which is
independent of ufbx, and `wm.fbx_import`, which uses ufbx as mograft does. Both also build meshes
and materials; neither computes poses. The last columns therefore add to `wm.fbx_import` the time to
compute the places of all bones in every frame, as mograft does. Ratios are those of the processor
times of all threads.
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

N_RUNS = 7
IMPORTERS = ("import_scene.fbx", "wm.fbx_import")


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
    heads = ["file", "MB", "takes", "joint poses", "mograft, ms", "processor, ms", "MB/s"]
    if blender is not None:
        heads += [
            cell for name in IMPORTERS for cell in (f"`{name}`, ms", "processor, ms", "ratio")
        ]
        heads += ["and all poses, processor, ms", "ratio"]
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for path in paths:
        runs = [_time(path) for _ in range(N_RUNS)]
        seconds, processor = (min(run[i] for run in runs) for i in range(2))
        clips = runs[0][2]
        n_poses = sum(motion.n_frames * motion.n_joints for motion in clips)
        megabytes = path.stat().st_size / 1e6
        cells = [f"{megabytes:.2f}", f"{len(clips)}", f"{n_poses:,}"]
        cells += [f"{seconds * 1e3:.1f}", f"{processor * 1e3:.1f}", f"{megabytes / processor:.0f}"]
        if blender is not None:
            cells += _time_imports(blender, path, clips, processor)
        print(f"| {path.name} | {' | '.join(cells)} |", flush=True)


def _time_imports(blender, path, clips, processor):
    """Return the cells of both imports by Blender, given the processor time of mograft."""
    cells = []
    times = {own.name: [i * own.frame_time for i in range(own.n_frames)] for own in clips}
    for operator in IMPORTERS:
        is_last = operator == IMPORTERS[-1]
        try:
            found = blender(path, times if is_last else {}, N_RUNS, operator)
        except AssertionError:  # not every version imports lights
            cells += ["fails", "", ""]
            continue
        theirs = min(found["processor_seconds"])
        cells += [f"{min(found['seconds']) * 1e3:.0f}", *_compare(theirs, processor)]
        if is_last:
            cells += _compare(theirs + found["pose_seconds"], processor)
    return cells


def _compare(theirs, processor):
    return [f"{theirs * 1e3:.0f}", f"{theirs / processor:.1f}"]


def _time(path):
    start, used = time.perf_counter(), time.process_time()
    clips = list(mg.read(path))
    return time.perf_counter() - start, time.process_time() - used, clips


def _tiny_file(folder):
    path = folder / "tiny.fbx"
    layer = fbx.Layer({(0, "T"): np.ones((3, 3))})
    scene = fbx.Scene((fbx.Node("hips"),), (fbx.Take("walk", 3, (layer,)),))
    path.write_bytes(fbx.to_binary(scene))
    return path


if __name__ == "__main__":
    sys.exit(main())
