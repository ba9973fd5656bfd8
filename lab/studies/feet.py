"""Measure foot skate before and after planting, and print a table for the docs.

``python -m lab feet [FILE...] [--seeds 3]`` grafts every file (default: the built-in dancer)
with the upper body as the base group, so that donors drive legs and root. It prints the share of
feet and frames that skate (`mograft.foot_skate`) in the recording, in grafts without planting, and
in grafts with it. It prints the largest depth of a heel or toe below its floor without planting and
with it, and the largest depth below the lower of its floor and its position in the same frame
without planting. Depths are in skeleton heights; the floor is that of the recording.
Both grafts have the same donors: self-repair, which may replace them in one only, is off.
Files are resampled to 30 frames per second.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import mograft as mg
from lab.common import run, tiny_motion
from lab.studies.seams import read, upper_body_library
from mograft.body.contacts import Ground


def depths(motion, ground):
    """Depths of heels and toes below their floors, in skeleton heights."""
    return -ground.above(ground.points(motion)) / ground.height


def measure_depth(before, after, ground):
    """Largest depth before and after planting, and largest excess over the same frame before."""
    old, new = depths(before, ground), depths(after, ground)
    return old.max(), new.max(), (np.maximum(new, 0.0) - np.maximum(old, 0.0)).max()


def measure_feet(library, seeds):
    """Skate without and with planting, root shift, frames out of reach; depths; over seeds.

    The first four are means, the depths of `measure_depth` maxima.
    """
    library = replace(library, config=replace(library.config, self_repair=False))
    loose = replace(library, config=replace(library.config, feet="never"))
    rows, deepest = [], []
    for seed in range(seeds):
        fallen, planted = mg.graft(loose, seed=seed), mg.graft(library, seed=seed)
        feet = planted.feet
        skates = mg.foot_skate(fallen.motion), mg.foot_skate(planted.motion)
        deepest.append(measure_depth(fallen.motion, planted.motion, Ground.of(planted.base)))
        # Without substitutions of legs, nothing is planted.
        rows.append([*skates, *((feet.moved_root, feet.unreached_frames) if feet else (0.0, 0))])
    return [*np.mean(rows, axis=0), *np.max(deepest, axis=0)]


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    run(parser, report, argv)


def report(options):
    if options.tiny:
        motions, options.seeds = [tiny_motion()], 1
    elif options.files:
        motions = [read(path) for path in options.files]
    else:
        from mograft.dancer import dance

        motions = [dance().motion]
    print(
        "| clip | recording | not planted | planted | root displacement | frames out of reach "
        "| depth, not planted | depth, planted | lowered by |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for motion in motions:
        library = upper_body_library(motion)
        fallen, planted, moved, missed, *deepest = measure_feet(library, options.seeds)
        skate = mg.foot_skate(motion)
        print(
            f"| {motion.name} | {skate:.3f} | {fallen:.3f} | {planted:.3f} | {moved:.3f} | "
            f"{missed:.1f} | {deepest[0]:.3f} | {deepest[1]:.3f} | {deepest[2]:.4f} |",
            flush=True,
        )
