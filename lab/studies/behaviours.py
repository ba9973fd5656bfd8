"""Measure how well "pca", "ppca" and "gmm" find known behaviours, and "beats" a known tempo.

The tables:

- ``cuts``: precision and recall of the cuts between behaviours, for motions of six known pieces
  (below). Neighbours are of different kinds. A cut is correct if it is at most the tolerance away
  from the middle of a change; each change counts once.
- ``tempo``: the errors of the interval between beats, and the share of motions within 2 %: motions
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

import functools
from pathlib import Path

import numpy as np

import lab.segmentations
from lab.experiments.sources import SOURCES, find_files
from lab.experiments.tables import Table
from lab.segmentations import METHODS
from lab.segmentations.beats import BeatParameters, beat_interval
from lab.studies import behaviour_pieces
from lab.studies.behaviour_pieces import (
    ANIMATED,
    CAPTURED,
    animated_actions,
    captured_actions,
    dance_of,
    dancer_pieces,
    dancer_who_jumps,
    metronome,
    read_clips,
    recorded_pieces,
)

NAME = "behaviours"
CODE = (
    *sorted(Path(lab.segmentations.__file__).parent.glob("*.py")),
    Path(behaviour_pieces.__file__),
)
N_SEEDS = 50
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


def find_inputs(data, unpacked):
    """Return the files of the recordings."""
    files = [*data.glob(f"{CAPTURED}/*.bvh"), *(data / own for own in ANIMATED)]
    return [own for own in sorted(files) if own.exists()] + [
        *folder_clips(data),
        *archive_clips(data, unpacked),
    ]


def folder_clips(data):
    """Return the Bandai-Namco clips in the two folders."""
    return sorted(data.glob("bandai_ds*/*.bvh"))


def archive_clips(data, unpacked):
    """Return clips of the kinds from the archive, without those in the folders."""
    known = {path.name for path in folder_clips(data)}
    found = [
        path
        for name in ("locomotion", "gestures")
        for path in find_files(SOURCES[name], data, unpacked)
        if path.name not in known and path.name.split("_")[1].startswith(KINDS)
    ]
    return found[:: max(len(found) // MAX_OTHER, 1)]


def read_inputs(data, unpacked, *, is_quick):
    """Return the functions that make a motion of a seed, by kind of motion, and how many seeds."""
    strides = 1 if is_quick else 8
    sets = {"walk, jump, wave: dancer": functools.partial(dancer_who_jumps, strides=strides)}
    recorded = functools.partial(functools.partial, recorded_pieces)
    if not is_quick and (data / CAPTURED).exists():
        sets["walk, jump, wave: captured"] = recorded(**captured_actions(data))
    if not is_quick and all((data / own).exists() for own in ANIMATED):
        sets["walk, jump, wave: animated"] = recorded(**animated_actions(data))
    sets["dancer"] = functools.partial(dancer_pieces, strides=strides)
    if not is_quick:
        others = archive_clips(data, unpacked)
        for title, paths in (("recordings", folder_clips(data)), ("other recordings", others)):
            if paths:
                clips, sample = read_clips(paths)
                sets[title] = recorded(clips=clips, sample=sample)
    return sets, 1 if is_quick else N_SEEDS


def cuts(inputs):
    """Return the precision and recall of the cuts between behaviours."""
    sets, n_seeds = inputs
    head = ("motions", "method", "cuts", "changes")
    head += tuple(f"{what} ±{own:g} s" for own in TOLERANCES for what in ("precision", "recall"))
    rows = []
    for title, make in sets.items():
        motions = [make(seed) for seed in range(n_seeds)]
        for name in NAMES:
            module, kind = METHODS[name]
            found = [module.cut_frames(motion, kind()) for motion, _ in motions]
            n_cuts = sum(len(own) for own in found)
            n_changes = sum(len(changes) for _, changes in motions)
            cells = [str(n_cuts), str(n_changes)]
            for tolerance in TOLERANCES:
                n_correct = sum(
                    count_correct(own, changes, tolerance * motion.rate)
                    for own, (motion, changes) in zip(found, motions, strict=True)
                )
                cells += [f"{n_correct / max(n_cuts, 1):.2f}", f"{n_correct / n_changes:.2f}"]
            rows.append((title, name, *cells))
    return Table(head, rows)


def tempo(inputs):
    """Return the errors of the interval between beats."""
    _, n_seeds = inputs
    parameters = BeatParameters()
    errors = {"pose to pose": [], "walks of the dancer": []}
    for seed in range(n_seeds):
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
    rows = []
    for title, own in errors.items():
        sizes = 100 * np.abs(own)
        share = 100 * np.mean(sizes <= 2)
        rows.append((title, f"{share:.0f}", f"{np.median(sizes):.1f}", f"{sizes.max():.1f}"))
    return Table(("motions", "within 2 %, %", "median error, %", "largest error, %"), rows)


PARTS = {"cuts": cuts, "tempo": tempo}
