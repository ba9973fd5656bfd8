"""Fixtures that the tests of solve, synthesis, provenance and stream share."""

from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
import mograft.constraints as mc
from mograft.dancer import dance
from mograft.solve.plan import GraftPlan


@pytest.fixture(scope="session")
def root_library():
    """Return a library of two clips in which the grafted group holds root and legs."""
    motion = dance(seed=1, strides=2).motion
    preset = mg.JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    members = {group: [int(joint) for joint in joints] for group, joints in preset.items()}
    clips = [motion[:900], replace(motion[900:], name="second")]
    library = mg.Library.build(clips, mg.JointGroups(members, base="upper"))
    return replace(library, config=replace(library.config, feet="never"))


@pytest.fixture(scope="session")
def wall(root_library):
    """Return a wall across the middle of the hips' path in a graft of `root_library`."""
    motion = mg.graft(root_library).motion
    hips = motion.world_positions()[:, motion.skeleton.index("Hips")] * [1, 0, 1]
    farthest = hips[np.linalg.norm(hips - hips[0], axis=1).argmax()]
    point = hips[0] + 0.5 * (farthest - hips[0])
    return mc.KeepOut("Hips", mc.HalfSpace(tuple(point), tuple(hips[0] - farthest)))


def make_problem(library, constraints=(), groups=None):
    """Return the search problem of a library's first clip."""
    return GraftPlan.build(library, 0, groups, constraints).problem


@pytest.fixture(scope="session")
def two_dances():
    """Return a library of two clips, ``clip0`` and ``clip1``, for streams."""
    clips = [dance(seed=seed, strides=1).motion for seed in (0, 1)]
    # Streams have no balance costs.
    named = [replace(clip, name=f"clip{i}") for i, clip in enumerate(clips)]
    return mg.Library.build(named, config=mg.Config(balance_weight=0.0))


@pytest.fixture(scope="session")
def short_base():
    """Return a motion of 260 frames that is not in `two_dances`."""
    return replace(dance(seed=2, strides=1).motion[:260], name="base")
