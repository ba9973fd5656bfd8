"""Measure how well "pca", "ppca" and "gmm" find known behaviours, and "beats" a known tempo.

``python -m lab behaviours [DATA] [--seeds 50]`` prints two tables:

- precision and recall of the cuts between behaviours, for motions of six known pieces (below).
  Neighbours are of different kinds. A cut is correct if it is at most the tolerance away from
  the middle of a change; each change counts once.
- the largest error of the interval between beats, and the share of motions within 2 %: motions
  from pose to pose, of 6 to 20 s, at 30, 60 and 120 frames per second; and walks of the dancer,
  whose steps are known.

The pieces:

- "walk, jump, wave: dancer": eight strides of the dancer, who jumps by bending both knees;
- "walk, jump, wave: captured": one person, in DATA/skel_animated_drawings, without the standing
  before and after each action;
- "walk, jump, wave: animated": clips of the KayKit packs in DATA/glb;
- "dancer": eight strides each of successive combinations of leg style and arm pattern;
- "recordings": the Bandai-Namco clips in the folders DATA/bandai_ds1 and DATA/bandai_ds2 (walk,
  wave, punch, dance);
- "other recordings": walks, runs, waves and raised arms from the archive of both sets, without the
  clips of the folders.

Pieces of clips last 5 to 8 s and are cross-faded over 0.5 s; a clip that is shorter is continued
backwards in time. The defaults were chosen with "dancer" and "recordings" in view.
"""

import argparse
import functools
import tempfile
from pathlib import Path

import numpy as np

from lab.common import run
from lab.experiments.sources import ARCHIVE, SOURCES, find_files
from lab.segmentations import METHODS
from lab.segmentations.beats import BeatParameters, beat_interval
from lab.studies.behaviour_pieces import (
    animated_actions,
    captured_actions,
    dance_of,
    dancer_pieces,
    dancer_who_jumps,
    metronome,
    read_clips,
    recorded_pieces,
)

NAMES = ("pca", "ppca", "gmm")
TOLERANCES = (0.5, 1.0)  # seconds
KINDS = ("walk", "run", "wave", "raise")  # first words of actions of other recordings
MAX_OTHER = 60  # clips of the archive


def count_correct(cuts, changes, tolerance):
    """How many changes have a cut within `tolerance` frames; each cut serves one change."""
    free = list(cuts)
    for change in changes:
        near = [cut for cut in free if abs(cut - change) <= tolerance]
        if near:
            free.remove(min(near, key=lambda cut: abs(cut - change)))
    return len(cuts) - len(free)


def print_behaviours(sets, seeds):
    print("| motions | method | cuts | changes |", end="")
    print("".join(f" precision ±{t:g} s | recall ±{t:g} s |" for t in TOLERANCES))
    print("|---|---|---|---|" + "---|---|" * len(TOLERANCES))
    for title, make in sets.items():
        motions = [make(seed) for seed in range(seeds)]
        for name in NAMES:
            module, kind = METHODS[name]
            found = [module.cut_frames(motion, kind()) for motion, _ in motions]
            n_cuts = sum(len(cuts) for cuts in found)
            n_changes = sum(len(changes) for _, changes in motions)
            cells = [str(n_cuts), str(n_changes)]
            for tolerance in TOLERANCES:
                n_correct = sum(
                    count_correct(cuts, changes, tolerance * motion.rate)
                    for cuts, (motion, changes) in zip(found, motions, strict=True)
                )
                cells += [f"{n_correct / max(n_cuts, 1):.2f}", f"{n_correct / n_changes:.2f}"]
            print(f"| {title} | `{name}` | {' | '.join(cells)} |", flush=True)


def print_tempo(seeds):
    parameters = BeatParameters()
    errors = {"pose to pose": [], "walks of the dancer": []}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        interval, rate = rng.uniform(0.35, 1.3), float(rng.choice([30, 60, 120]))
        motion = metronome(seed, interval, rate, rng.uniform(6, 20))
        errors["pose to pose"].append(beat_interval(motion, parameters) / interval - 1)
        made = dance_of(seed, 8)
        is_walk = made.legs == "walk"
        start = int(np.argmax(is_walk))
        stop = start + int(np.argmin(is_walk[start:])) if not is_walk[start:].all() else len(made)
        strides = np.flatnonzero(np.diff(made.phase[start:stop]) < -0.5)
        step = 0.5 * np.mean(np.diff(strides)) * made.motion.frame_time
        found = beat_interval(made.motion[start:stop], parameters)
        errors["walks of the dancer"].append(found / step - 1)
    print("| motions | within 2 % | median error | largest error |")
    print("|---|---|---|---|")
    for title, own in errors.items():
        sizes = np.abs(own)
        share, median = np.mean(sizes <= 0.02), np.median(sizes)
        largest = f"{100 * sizes.max():.1f} %"
        print(f"| {title} | {100 * share:.0f} % | {100 * median:.1f} % | {largest} |")


def report(options):
    """Print the tables."""
    seeds = 1 if options.tiny else options.seeds
    strides = 1 if options.tiny else 8
    sets = {"walk, jump, wave: dancer": functools.partial(dancer_who_jumps, strides=strides)}
    if options.data and not options.tiny:
        data = Path(options.data)
        for title, actions in (("captured", captured_actions), ("animated", animated_actions)):
            sets[f"walk, jump, wave: {title}"] = functools.partial(recorded_pieces, **actions(data))
    sets["dancer"] = functools.partial(dancer_pieces, strides=strides)
    if options.data and not options.tiny:
        paths = sorted(data.glob("bandai_ds*/*.bvh"))
        sets["recordings"] = functools.partial(recorded_pieces, **clips_of(paths))
        if (data / ARCHIVE).exists():
            with tempfile.TemporaryDirectory() as unpacked:
                names = {path.name for path in paths}
                others = [
                    path
                    for name in ("locomotion", "gestures")
                    for path in find_files(SOURCES[name], data, Path(unpacked))
                    if path.name not in names
                ]
                kinds = [path for path in others if path.name.split("_")[1].startswith(KINDS)]
                chosen = clips_of(kinds[:: max(len(kinds) // MAX_OTHER, 1)])
            sets["other recordings"] = functools.partial(recorded_pieces, **chosen)
    print_behaviours(sets, seeds)
    print_tempo(seeds)


def clips_of(paths):
    clips, sample = read_clips(paths)
    return {"clips": clips, "sample": sample}


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="?", help="folder of the recordings of the experiments")
    parser.add_argument("--seeds", type=int, default=50)
    return run(parser, report, argv)
