"""Print the peak memory of commands against the number of frames, and how it grows.

Run as ``python benches/memory.py [--frames 10000 30000 ...] [--command graft index ...]``. Each
figure is that of a new process: its largest resident memory, less that of the same command for a
clip of two seconds. The motions are dances of the built-in dancer with several seeds, joined and
repeated, in a file. The exponent is the slope of the line through the logarithms of memory and
frames: 1 is proportional growth. The last columns are the memory per frame over that of the arrays
of the motion, and the processor time.
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run
from mograft.dancer import dance

FRAMES = (10_000, 30_000, 100_000, 300_000, 1_000_000)
TINY_FRAMES = (600,)
BASELINE_FRAMES = 60
N_SEEDS = 4

SPHERE = "sphere:0,190,200,15"
"""An obstacle above the path of the dancer."""

REACH = "25:RightHand:-15,118,22~0.1"
"""A position near that of the hand in this frame."""

COMMANDS = {
    "graft": ("graft", "{file}", "-o", "{folder}/new.bvh"),
    "graft, feet planted": (
        "graft",
        "{file}",
        "--groups",
        "{folder}/groups.toml",
        "-o",
        "{folder}/new.bvh",
    ),
    "graft, obstacle": ("graft", "{file}", "--avoid", SPHERE, "-o", "{folder}/new.bvh"),
    "graft, reach": ("graft", "{file}", "--reach", REACH, "-o", "{folder}/new.bvh"),
    "index": ("index", "{file}", "-o", "{folder}/l.mograft"),
    "view": ("view", "{file}", "-o", "{folder}/page.html"),
    "export glb": ("export", "{file}", "-o", "{folder}/new.glb"),
    "export npz": ("export", "{file}", "-o", "{folder}/new.npz"),
}

# A process in between, whose only children are the command and its children.
_PROGRAM = (
    "import resource, subprocess, sys; "
    "code = subprocess.run(sys.argv[1:], stdout=2).returncode; "
    "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
    "print(code, used.ru_maxrss / 1024, used.ru_utime + used.ru_stime)"
)


def write_motion(motions, n_frames, path):
    """Write the frames of motions, one after the other and repeated, to a BVH file."""
    first = motions[0]
    numbers = np.arange(n_frames) % sum(motion.n_frames for motion in motions)

    def repeat(arrays):
        return np.concatenate(arrays)[numbers]

    joined = replace(
        first,
        rotations=repeat([motion.rotations for motion in motions]),
        positions=repeat([motion.positions for motion in motions]),
        channel_values=repeat([motion.channel_numbers() for motion in motions]),
        path=None,
    )
    mg.write_bvh(joined, path)
    arrays = joined.rotations, joined.positions, joined.channel_values
    return sum(array.nbytes for array in arrays) / 2**20


def write_groups(skeleton, path):
    """Write joint groups whose base is the upper body, so that grafts plant the feet."""
    parts = mg.JointGroups.preset("lower_upper", skeleton)
    path.write_text(replace(parts, base="upper").to_toml())


def measure(words):
    """Return exit code, peak MiB and processor seconds of ``mograft`` in a new process."""
    command = [sys.executable, "-c", _PROGRAM, sys.executable, "-m", "mograft", *words, "--force"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    code, peak, seconds = done.stdout.split()
    if int(code):
        print(f"{' '.join(words)}: exit code {code}: {done.stderr.strip()[-300:]}")
    return int(code), float(peak), float(seconds)


def report(options):
    sizes = TINY_FRAMES if options.tiny else options.frames
    commands = options.command[:1] if options.tiny else options.command
    motions = [dance(seed=seed).motion for seed in range(1 if options.tiny else N_SEEDS)]
    print(f"| command | {' | '.join(f'{n:,}' for n in sizes)} | exponent | motions | CPU s |")
    print("|---|" + "--:|" * (len(sizes) + 3))
    found = {name: [] for name in commands}
    arrays = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "long.bvh"
        write_groups(motions[0].skeleton, folder / "groups.toml")
        for n_frames in (BASELINE_FRAMES, *sizes):
            arrays.append(write_motion(motions, n_frames, file))
            for name in commands:
                words = [word.format(file=file, folder=folder) for word in COMMANDS[name]]
                found[name].append(measure(words))
    for name, runs in found.items():
        baseline = runs[0][1]
        peaks = [peak - baseline if not code else np.nan for code, peak, _ in runs[1:]]
        known = np.isfinite(peaks) & (np.array(peaks) > 0)
        slope = np.nan
        if known.sum() > 1:
            slope = np.polyfit(np.log(np.array(sizes)[known]), np.log(np.array(peaks)[known]), 1)[0]
        cells = [f"{peak:.0f}" for peak in peaks]
        factor = f"{peaks[-1] / arrays[-1]:.1f}"
        print(f"| {name} | {' | '.join(cells)} | {slope:.2f} | {factor} | {runs[-1][2]:.0f} |")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", nargs="+", type=int, default=FRAMES)
    parser.add_argument("--command", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
