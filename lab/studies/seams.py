"""Measure the effect of seam treatments on motions, and print a table for the docs.

``python -m lab seams [FILE...] [--seeds 10]`` grafts every file (default: the built-in
dancer) with each seam treatment and the same donors. The first table compares the grafted joints
with the file: acceleration and jerk as ratios; and, with the legs grafted, foot skate. The second
table compares the values of `Config.torso`. Files are resampled to 30 frames per second.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import mograft as mg
from lab.common import run, tiny_motion
from mograft import rotations
from mograft.body.anatomy import anatomy, feature_joints
from mograft.body.mass import center_of_mass, mass_model

RATE = 30.0
TREATMENTS = ("gradient", "offset", "paper", "displacement", "inertial")
TORSOS = ("pelvis", "world")


def read(path):
    """A motion at 30 fps, without a leading rest pose."""
    motion = mg.read_bvh(path)
    root = motion.positions[:3, motion.locomotion_root()]
    steps = np.abs(np.diff(root, axis=0)).max(axis=1)
    motion = motion[1:] if steps[0] > 5 * max(steps[1], 1e-9) else motion
    return motion.resample(RATE)


def upper_body_library(motion):
    """A library whose base group is the upper body."""
    parts = mg.JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    members = {group: [int(joint) for joint in joints] for group, joints in parts.items()}
    return mg.Library.build(motion, mg.JointGroups(members, base="upper"))


def derivatives(quats, rate):
    """Mean angular acceleration and jerk of all joints, rad/s² and rad/s³."""
    steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:])) * rate
    bends = np.diff(steps, axis=0) * rate
    jerks = np.diff(bends, axis=0) * rate
    return [np.linalg.norm(values, axis=-1).mean() for values in (bends, jerks)]


def measure_treatments(motion, seeds, blend):
    """Ratios of acceleration and jerk by treatment, those of the recording, and seam gaps."""
    library = mg.Library.build(motion, config=mg.Config(seam_blend=blend, self_repair=False))
    joints = feature_joints(motion.skeleton, library.joints("upper"))
    original = derivatives(np.ascontiguousarray(motion.rotations[:, joints]), RATE)
    rows, gaps = {}, []
    for name in TREATMENTS:
        configured = replace(library, config=replace(library.config, seam=name))
        grafts = [mg.graft(configured, seed=seed) for seed in range(seeds)]
        found = [derivatives(graft.motion.rotations[:, joints], RATE) for graft in grafts]
        rows[name] = np.mean(found, axis=0) / original
        gaps = [seam.gap for graft in grafts for seam in graft.seams]
    return rows, original, np.degrees(gaps)


def mean_foot_skate(motion, seeds, blend):
    """Mean foot skate by treatment, with legs grafted on the upper body and planted feet."""
    library = upper_body_library(motion)
    skate = {}
    for name in TREATMENTS:
        configured = replace(library, config=replace(library.config, seam=name, seam_blend=blend))
        skate[name] = np.mean(
            [mg.foot_skate(mg.graft(configured, seed=s).motion) for s in range(seeds)]
        )
    return skate


def trunk(motion):
    """The parent of the trunk's first joint, and the trunk's last joint."""
    body, parents = anatomy(motion.skeleton), motion.skeleton.parents
    column = [j for j in body.joints("trunk") if body.parts[parents[j]] != "trunk"]
    first = last = max(
        column, key=lambda j: sum(_hangs(parents, k, j) for k in range(len(parents)))
    )
    while below := [j for j in motion.skeleton.children[last] if body.parts[j] == "trunk"]:
        last = below[0]
    return int(parents[first]), last


def _hangs(parents, joint, above):
    while joint > above:
        joint = parents[joint]
    return joint == above


def stance(motion, up):
    """Horizontal distance from the centre of mass to the midpoint of the ankles, in heights."""
    found = mass_model(motion.skeleton)
    ankles = motion.world_positions()[:, [foot.ankle for foot in found.feet]].mean(axis=1)
    offsets = np.delete(center_of_mass(motion) - ankles, up, axis=1)
    return np.linalg.norm(offsets, axis=1).mean() / found.height


def head_jerk(motion):
    """Median magnitude of the third difference of the head's position in the world."""
    head = anatomy(motion.skeleton).joints("head")[0]
    path = motion.world_positions()[:, head]
    return np.median(np.linalg.norm(np.diff(path, 3, axis=0), axis=-1)) * RATE**3


def measure_torso(motion, seeds):
    """Rows of numbers by `Config.torso`, as ratios to the recording's."""
    hips, last = trunk(motion)

    def figures(one, up):
        turned = one.world_transforms()[0]
        waist = rotations.multiply(rotations.inverse(turned[:, hips]), turned[:, last])
        numbers = [*derivatives(turned[:, [last]], RATE), *derivatives(waist[:, None], RATE)]
        return np.array([head_jerk(one), *numbers, stance(one, up)])

    rows = {}
    for torso in TORSOS:
        library = mg.Library.build(motion, config=mg.Config(torso=torso))
        original = figures(motion, library.up)
        rows[torso] = np.mean(
            [
                figures(mg.graft(library, seed=s).motion, library.up) / original
                for s in range(seeds)
            ],
            axis=0,
        )
    return rows


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--blend", type=float, default=mg.Config().seam_blend)
    run(parser, report, argv)


def report(options):
    if options.tiny:
        motions, options.seeds = [tiny_motion()], 1
    elif options.files:
        motions = [read(path) for path in options.files]
    else:
        from mograft.dancer import dance

        motions = [dance().motion]
    for motion in motions:
        treatments, original, gaps = measure_treatments(motion, options.seeds, options.blend)
        print(f"\n{motion.name}: {motion.n_frames} frames, {options.seeds} seeds")
        print(f"original: acceleration {original[0]:.1f} rad/s², jerk {original[1]:.0f} rad/s³")
        mean, high = gaps.mean(), np.percentile(gaps, 95)
        print(f"gap at seams: mean {mean:.1f}°, 95th percentile {high:.1f}°")
        slides = mean_foot_skate(motion, min(options.seeds, 3), options.blend)
        print(f"foot skate of the recording: {mg.foot_skate(motion):.3f}")
        print("| seam | acceleration | jerk | foot skate |")
        print("|---|---|---|---|")
        for name, (bend, jerk) in treatments.items():
            print(f"| {name} | {bend:.2f} | {jerk:.2f} | {slides[name]:.3f} |")
        columns = "head: jerk | chest: acceleration | jerk | waist: acceleration | jerk | stance"
        print(f"\n| torso | {columns} |\n|---|---|---|---|---|---|---|")
        for name, numbers in measure_torso(motion, options.seeds).items():
            print(f"| {name} | {' | '.join(f'{number:.3f}' for number in numbers)} |", flush=True)
