"""Time the reading of GLB files, and the resources of opening and reading their clips.

Run with a release build: ``maturin develop --release && python benches/formats.py FILE...``. Prints
a Markdown table: for each file, its size, number of clips, the time to open it and read all of its
clips, and the throughput. With ``--graft``, a second table has the steps of ``mograft graft FILE...
-n 3 -o new.glb``. Times are the minimum of several runs: other programs only add to it. Processor
time excludes the time for which other programs hold the processor.
"""

import argparse
import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from mograft import formats

N_RUNS = 15
N_GRAFT_RUNS = 3


def time_reading(path, n_runs):
    """Return the number of clips and frames, and the least wall and processor time to read all."""
    walls, processors = [], []
    for _ in range(n_runs):
        start, used = time.perf_counter(), time.process_time()
        clips = mg.read(path)
        frames = [clip.n_frames for clip in clips]
        walls.append(time.perf_counter() - start)
        processors.append(time.process_time() - used)
    return len(frames), sum(frames), min(walls), min(processors)


def time_grafts(files, folder):
    """Return the wall and processor time of each step from glTF files to three grafts in a copy."""
    found, base = {}, None

    def step(name, function):
        start, used = time.perf_counter(), time.process_time()
        result = function()
        found[name] = (time.perf_counter() - start, time.process_time() - used)
        return result

    with warnings.catch_warnings(action="ignore"):  # faults of clips
        library = step("read and build the library", lambda: mg.Library.build(files))
        base = max(library.entries, key=lambda own: own.n_frames).name
        grafts = step("3 grafts on the longest clip", lambda: list(mg.graft_many(library, base, 3)))
        step("write", lambda: mg.write_graft(grafts, Path(folder) / "new.glb"))
    return found


def report_grafts(files, folder):
    """Print a table of the steps of `time_grafts`: of each, the minimum of several runs."""
    runs = [time_grafts(files, folder) for _ in range(N_GRAFT_RUNS)]
    print("\n| grafts into a copy of a GLB file | ms | processor, ms |\n|---|---|---|")
    for name in runs[0]:
        wall, processor = (min(own[name][i] for own in runs) for i in range(2))
        print(f"| {name} | {1e3 * wall:.0f} | {1e3 * processor:.0f} |")


def report(options):
    """Print the tables."""
    with tempfile.TemporaryDirectory() as folder:
        files, n_runs = [Path(name) for name in options.files], N_RUNS
        if options.tiny:
            files, n_runs = [Path(folder) / "tiny.glb"], 1
            formats.write_glb([tiny_motion()[:60], tiny_motion()[60:]], files[0])
        print(
            "| file | MB | clips | frames | open and read, ms | processor, ms | MB/s "
            "| MB/s of processor time |\n|---|---|---|---|---|---|---|---|"
        )
        total = [0.0, 0.0, 0.0]
        for path in files:
            size = os.path.getsize(path) / 1e6
            n_clips, n_frames, wall, processor = time_reading(path, n_runs)
            total = [a + b for a, b in zip(total, (size, wall, processor), strict=True)]
            print(
                f"| {path.name} | {size:.2f} | {n_clips} | {n_frames} | {1e3 * wall:.1f} "
                f"| {1e3 * processor:.1f} | {size / wall:.1f} | {size / processor:.1f} |"
            )
        size, wall, processor = total
        print(
            f"| all | {size:.2f} | | | {1e3 * wall:.1f} | {1e3 * processor:.1f} "
            f"| {size / wall:.1f} | {size / processor:.1f} |"
        )
        if options.graft or options.tiny:
            report_grafts(files, folder)


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("files", nargs="*", help="files of any format that mograft reads")
    parser.add_argument(
        "--graft", action="store_true", help="also time grafts of the files, glTF of one skeleton"
    )
    return run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
