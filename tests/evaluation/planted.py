"""Grafts with a planted change, and methods of donor selection, for tests of measures."""

from dataclasses import dataclass, replace

import numpy as np

from mograft import rotations
from mograft.evaluation import Method, grafts_by


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


@dataclass(frozen=True)
class Captured(Method):
    """The only donor is the base segment itself, so that grafts equal the recording."""

    name: str = "captured"

    def candidates(self, library, scenario):  # noqa: ARG002
        return [np.array([segment]) for segment in scenario.tolist()]


@dataclass(frozen=True)
class ByCost(Method):
    """The candidates of the configuration, of which `Config.choice` selects by cost."""

    name: str = "by cost"
    uses_cost: bool = True

    def candidates(self, library, scenario):
        group = next(name for name in library.groups.names if name != library.groups.base)
        return library.pool(group).candidate_lists(scenario, library.config)
