"""Fixtures that the tests of solve, synthesis, provenance and stream share."""

from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
import mograft.constraints as mc
from mograft.dancer import dance
from mograft.solve.search_problem import SearchProblem


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
def make_problem():
    """Return a function that makes the search problem of a library's first clip."""

    def make(library, constraints=(), groups=("lower",)):
        scenario = library.segments.of_clip(0)
        segments = library.segments[scenario]
        base = library.clips[0]
        return SearchProblem.build(library, base, scenario, segments, list(groups), constraints)

    return make


@pytest.fixture(scope="session")
def make_wall():
    """Return a function that makes a wall across part of the hips' path in a graft."""

    def make(library, share=0.5):
        motion = mg.graft(library).motion
        hips = motion.world_positions()[:, motion.skeleton.index("Hips")] * [1, 0, 1]
        farthest = hips[np.linalg.norm(hips - hips[0], axis=1).argmax()]
        point = hips[0] + share * (farthest - hips[0])
        return mc.KeepOut("Hips", mc.HalfSpace(tuple(point), tuple(hips[0] - farthest)))

    return make


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
