"""Measure how well "pca", "ppca" and "gmm" find known behaviours, and "beats" a known tempo.

``python benches/behaviours.py [DATA] [--seeds 50]`` prints two tables:

- precision and recall of the cuts between behaviours, for motions put together from known pieces.
  "dancer": six successive combinations of leg style and arm pattern of the dancer, each of eight
  strides. "recordings": six pieces of 5 to 8 s of the Bandai-Namco clips in the folders
  DATA/bandai_ds1 and DATA/bandai_ds2 (walk, wave, punch, dance), cross-faded over 0.5 s;
  neighbours are of different kinds. "other recordings": the same with walks, runs, waves and
  raised arms from the archive of both sets, without the clips of the folders. A clip that is
  shorter than its piece is continued backwards in time. A cut is correct if it is at most the
  tolerance away from the middle of a change; each change counts once.
- the largest error of the interval between beats, and the share of motions within 2 %: motions
  from pose to pose, of 6 to 20 s, at 30, 60 and 120 frames per second; and walks of the dancer,
  whose steps are known.

The defaults were chosen with the dancer and "recordings" in view.
"""

import argparse
import functools
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run
from benches.evidence.sources import ARCHIVE, SOURCES, find_files
from mograft.analysis.segmentations import METHODS, beats
from mograft.dancer import dance
from mograft.motion import rotations

NAMES = ("pca", "ppca", "gmm")
TOLERANCES = (0.5, 1.0)  # seconds
N_PIECES = 6
PIECE_SECONDS = (5.0, 8.0)
FADE_SECONDS = 0.5
MIN_CLIP_SECONDS = 3.0
MARGIN = 0.12  # share of a clip at each end, in which people stand before and after an action
KINDS = ("walk", "run", "wave", "raise")  # first words of actions of other recordings
MAX_OTHER = 60  # clips of the archive


@functools.lru_cache(maxsize=1)
def dance_of(seed, strides):
    return dance(seed, strides=strides)


def dancer_pieces(seed, strides=8):
    """A part of a dance of six combinations, and the frames at which they change."""
    made = dance_of(seed, strides)
    is_change = (made.legs[1:] != made.legs[:-1]) | (made.arms[1:] != made.arms[:-1])
    bounds = np.concatenate([[0], np.flatnonzero(is_change) + 1, [len(made)]])
    first = int(np.random.default_rng(seed).integers(len(bounds) - 1 - N_PIECES))
    start, *changes, stop = bounds[first : first + N_PIECES + 1]
    return made.motion[start:stop], np.array(changes) - start


def read_clips(paths):
    """The rotations of clips by kind of action, without their ends; and one of the motions."""
    clips, sample = {}, None
    for path in sorted(paths):
        motion = mg.read_bvh(path)
        if motion.duration >= MIN_CLIP_SECONDS:
            margin = round(MARGIN * motion.n_frames)
            kind = path.name.split("_")[1]
            clips.setdefault(kind, []).append(motion.rotations[margin:-margin])
            sample = sample or motion
    return clips, sample


def recorded_pieces(seed, clips, sample):
    """A motion of six pieces of clips, and the frames in the middle of the cross-fades."""
    rng = np.random.default_rng(seed)
    fade = round(FADE_SECONDS * sample.rate)
    joined, changes, last = None, [], None
    for _ in range(N_PIECES):
        last = str(rng.choice([kind for kind in clips if kind != last]))
        clip = clips[last][rng.integers(len(clips[last]))]
        length = round(rng.uniform(*PIECE_SECONDS) * sample.rate)
        while len(clip) < length:
            clip = np.concatenate([clip, clip[-2::-1]])
        start = rng.integers(len(clip) - length + 1)
        piece = clip[start : start + length]
        if joined is None:
            joined = piece
            continue
        changes.append(len(joined) - fade // 2)
        joined = cross_fade(joined, piece, fade)
    positions = np.repeat(sample.positions[:1], len(joined), axis=0)
    root = sample.locomotion_root()
    positions[:, root] = np.resize(sample.positions[:, root], (len(joined), 3))
    quats = joined / np.linalg.norm(joined, axis=-1, keepdims=True)
    return mg.Motion(sample.skeleton, sample.frame_time, quats, positions), np.array(changes)


def cross_fade(before, after, n_frames):
    """The rotations of two pieces, of which `n_frames` frames overlap."""
    share = np.arange(1, n_frames + 1) / (n_frames + 1)
    share = (3 * share**2 - 2 * share**3)[:, None, None]
    gaps = rotations.multiply(rotations.inverse(before[-n_frames:]), after[:n_frames])
    mixed = rotations.multiply(before[-n_frames:], rotations.exp(rotations.log(gaps) * share))
    return np.concatenate([before[:-n_frames], mixed, after[n_frames:]])


def count_correct(cuts, changes, tolerance):
    """How many changes have a cut within `tolerance` frames; each cut serves one change."""
    free = list(cuts)
    for change in changes:
        near = [cut for cut in free if abs(cut - change) <= tolerance]
        if near:
            free.remove(min(near, key=lambda cut: abs(cut - change)))
    return len(cuts) - len(free)


def metronome(seed, interval, rate, seconds, n_joints=6):
    """A motion from one random pose to the next, one per `interval`, at rest in each pose."""
    rng = np.random.default_rng(seed)
    phase = np.arange(round(seconds * rate)) / rate / interval
    poses = rng.uniform(-0.8, 0.8, size=(int(phase[-1]) + 2, n_joints, 3))
    pose = phase.astype(int)
    share = (phase - pose)[:, None, None]
    share = share**3 * (10 - 15 * share + 6 * share**2)
    offsets = np.arange(3.0 * n_joints).reshape(n_joints, 3)
    skeleton = mg.Skeleton([f"j{i}" for i in range(n_joints)], [-1] + [0] * (n_joints - 1), offsets)
    quats = rotations.exp(poses[pose] * (1 - share) + poses[pose + 1] * share)
    return mg.Motion(skeleton, 1 / rate, quats, np.tile(offsets, (len(quats), 1, 1)))


def print_behaviours(sets, seeds):
    print("| motions | method | cuts | changes |", end="")
    print("".join(f" precision ±{t:g} s | recall ±{t:g} s |" for t in TOLERANCES))
    print("|---|---|---|---|" + "---|---|" * len(TOLERANCES))
    for title, make in sets.items():
        motions = [make(seed) for seed in range(seeds)]
        for name in NAMES:
            method = METHODS.get(name)
            found = [method.cut_frames(motion, method.parameters()) for motion, _ in motions]
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
    parameters = beats.BeatParameters()
    errors = {"pose to pose": [], "walks of the dancer": []}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        interval, rate = rng.uniform(0.35, 1.3), float(rng.choice([30, 60, 120]))
        motion = metronome(seed, interval, rate, rng.uniform(6, 20))
        errors["pose to pose"].append(beats.beat_interval(motion, parameters) / interval - 1)
        made = dance_of(seed, 8)
        is_walk = made.legs == "walk"
        start = int(np.argmax(is_walk))
        stop = start + int(np.argmin(is_walk[start:])) if not is_walk[start:].all() else len(made)
        strides = np.flatnonzero(np.diff(made.phase[start:stop]) < -0.5)
        step = 0.5 * np.mean(np.diff(strides)) * made.motion.frame_time
        found = beats.beat_interval(made.motion[start:stop], parameters)
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
    sets = {"dancer": functools.partial(dancer_pieces, strides=1 if options.tiny else 8)}
    if options.data and not options.tiny:
        data = Path(options.data)
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


if __name__ == "__main__":
    sys.exit(main())
