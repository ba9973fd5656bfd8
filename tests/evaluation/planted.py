"""Grafts with a planted change, for tests of measures."""

from dataclasses import replace

import numpy as np

from mograft import rotations
from mograft.evaluation import grafts_by


def grafts_of_clips(library, method, count=3):
    """Return for each clip of a library its grafts by a method."""
    names = [clip.name for clip in library.clips]
    return [list(grafts_by(method, library, name, count, seed=2)) for name in names]


def copy_base(graft):
    """Return a graft whose motion is that of its base, with the donors and seams it had."""
    return replace(graft, motion=graft.base)


def add_jitter(graft, joint, angle=0.06, reach=4, seed=0):
    """Return a graft whose joint turns at random by about `angle` radians near each seam."""
    rng = np.random.default_rng(seed)
    quats = graft.motion.rotations.copy()
    seams = np.array([seam.frame for seam in graft.seams])
    near = np.unique((seams[:, None] + np.arange(-reach, reach + 1)).clip(0, len(quats) - 1))
    turns = rotations.exp(rng.normal(scale=angle, size=(len(near), 3)))
    quats[near, joint] = rotations.multiply(quats[near, joint], turns)
    return replace(graft, motion=replace(graft.motion, rotations=quats, channel_values=None))
