"""Time the reading of GLB files, and the resources of opening and reading their clips.

Run with a release build: ``maturin develop --release && python benches/formats.py FILE...``. Prints
a Markdown table: for each file, its size, number of clips, the time to open it and read all of its
clips, and the throughput. Times are the minimum of several runs: other programs only add to it.
Processor time excludes the time for which other programs hold the processor.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion

N_RUNS = 15


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


def report(options):
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        files, n_runs = [Path(name) for name in options.files], N_RUNS
        if options.tiny:
            files, n_runs = [Path(folder) / "tiny.glb"], 1
            mg.write_glb([tiny_motion()[:60], tiny_motion()[60:]], files[0])
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


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("files", nargs="*", help="files of any format that mograft reads")
    return run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
