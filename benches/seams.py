"""Measure what the ways to close seams do to motions, and print a table for the docs.

``python benches/seams.py [FILE...] [--seeds 10]`` grafts every file (default: the built-in
dancer) with each treatment and the same donors, and compares with the file's own motion:
acceleration and jerk of the grafted joints as ratios to the original's, what the gaps were,
and how much of the motion was changed to close them. Files are cut at 30 frames a second.
"""

import argparse
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from mograft import rotations
from mograft.anatomy import feature_joints
from mograft.seams import TURNS
from mograft.transplant import _Laid, transplant

RATE = 30.0
TREATMENTS = ("none", "offset", "paper", "displacement", "inertial", "dead")


def read(path):
    """A motion at 30 fps, without a rest pose before it."""
    motion = mg.read_bvh(path)
    root = motion.positions[:3, motion.locomotion_root()]
    steps = np.abs(np.diff(root, axis=0)).max(axis=1)
    motion = motion[1:] if steps[0] > 5 * max(steps[1], 1e-9) else motion
    return motion.resample(RATE)


def derivatives(quats, rate):
    """Mean angular acceleration and jerk of all joints, rad/s² and rad/s³."""
    steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:])) * rate
    bends = np.diff(steps, axis=0) * rate
    jerks = np.diff(bends, axis=0) * rate
    return [np.linalg.norm(values, axis=-1).mean() for values in (bends, jerks)]


def raw(laid, track):
    """The donors side by side, nothing done to their seams."""
    segment, step = laid.frames()
    return laid.unpack(segment, step, laid.sample(TURNS, [track], segment, step))


def measured(motion, seeds, blend):
    """Rows of numbers by treatment, means over seeds."""
    library = mg.Library.build(motion)
    joints = feature_joints(motion.skeleton, library.joints("upper"))
    track = np.ascontiguousarray(motion.rotations[:, joints])
    own = derivatives(track, RATE)
    rows = {name: [] for name in TREATMENTS}
    gaps, kinks = [], []
    for seed in range(seeds):
        chosen = np.array([s.donor for s in mg.graft(library, seed=seed).substitutions])
        cut = library.segments
        donors = mg.Segments(cut.start[chosen], cut.stop[chosen], cut.clip[chosen])
        laid = _Laid(cut, donors, RATE)
        bare = raw(laid, track)
        ends = laid.ends(TURNS, [track], np.flatnonzero(laid.true_seams([track])))
        gaps.append(np.linalg.norm(ends.ways(TURNS), axis=-1).ravel())
        kinks.append(np.linalg.norm(ends.arriving - ends.leaving, axis=-1).ravel())
        for name in TREATMENTS:
            if name == "none":
                quats = bare
            else:
                config = replace(library.config, seam=name, seam_blend=blend)
                quats = transplant(motion, cut, donors, [motion], joints, config).rotations
            off = rotations.angle(quats, bare)
            rows[name].append(
                [
                    *(a / b for a, b in zip(derivatives(quats, RATE), own, strict=True)),
                    np.degrees(off.mean()),
                    100.0 * (off > 1e-9).any(axis=1).mean(),
                ]
            )
    told = {name: np.mean(values, axis=0) for name, values in rows.items()}
    return told, own, np.degrees(np.concatenate(gaps)), np.degrees(np.concatenate(kinks))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--blend", type=float, default=mg.Config().seam_blend)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.files:
        motions = [read(path) for path in options.files]
    else:
        from mograft.dancer import dance

        motions = [dance().motion]
    for motion in motions:
        told, own, gaps, kinks = measured(motion, options.seeds, options.blend)
        print(f"\n{motion.name}: {motion.n_frames} frames, {options.seeds} seeds")
        print(f"original: acceleration {own[0]:.1f} rad/s², jerk {own[1]:.0f} rad/s³")
        for what, values, unit in (("gap", gaps, "°"), ("velocity gap", kinks, "°/s")):
            mean, high = values.mean(), np.percentile(values, 95)
            print(f"{what} at seams: mean {mean:.1f}{unit}, 95th percentile {high:.1f}{unit}")
        print("| seam | acceleration | jerk | changed by | frames changed |")
        print("|---|---|---|---|---|")
        for name, (bend, jerk, off, share) in told.items():
            print(f"| {name} | {bend:.2f} | {jerk:.2f} | {off:.2f}° | {share:.0f} % |")


if __name__ == "__main__":
    main()
