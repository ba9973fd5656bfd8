"""Loops: bases whose last frame continues in their first, and grafts on them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.body.loops import is_loop
from mograft.dancer import dance
from mograft.motion import rotations
from tests.hierarchies import human
from tests.strategies import SEEDS, few_examples

RATE = 30.0


def cyclic_motion(seed, n_frames=33, name="cycle", gap=0.0, base=None):
    """Return a motion of a human whose joints swing once or twice in its duration.

    The last frame repeats the first; `gap` turns every joint of the last frame by an angle. The
    lower body is that of `base`, if there is one, but for small differences.
    """
    rng, skeleton = np.random.default_rng(seed), human()
    time = np.linspace(0.0, 2.0 * np.pi, n_frames)[:, None, None]
    size = rng.uniform(-0.5, 0.5, (skeleton.n_joints, 3))
    pace = rng.integers(1, 3, (skeleton.n_joints, 3))
    phase = rng.uniform(0.0, 2.0 * np.pi, (skeleton.n_joints, 3))
    vectors = size * np.sin(pace * time + phase)
    vectors[:, 0] = 0.0
    vectors[-1] += gap * np.array([0.0, 0.0, 1.0])
    positions = np.repeat(skeleton.offsets[None], n_frames, axis=0)
    motion = mg.Motion(skeleton, 1.0 / RATE, rotations.exp(vectors), positions, name=name)
    if base is None:
        return motion
    quats = motion.rotations.copy()
    groups = mg.JointGroups.preset("lower_upper", skeleton).groups
    lower = [skeleton.index(joint) for joint in groups["lower"]]
    near = rotations.exp(0.03 * np.sin(time + rng.uniform(0.0, 2.0 * np.pi, (len(lower), 3))))
    quats[:, lower] = rotations.multiply(base.rotations[:, lower], near)
    return replace(motion, rotations=quats)


def join_gap(motion):
    """Return the angles of all joints between the last and the first frame."""
    return rotations.angle(motion.rotations[-1], motion.rotations[0])


def joint_steps(motion):
    """Return the rotation vectors from each frame to the next, and over the join at the end."""
    quats = np.concatenate([motion.rotations, motion.rotations[1:2]])
    return rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))


def library_of_cycles(seed, count=5):
    base = cyclic_motion(seed)
    others = [
        cyclic_motion(seed + own, name=f"other{own}", base=base) for own in range(1, count + 1)
    ]
    return mg.Library.build([base, *others], rate=RATE)


@given(SEEDS, st.integers(4, 60))
def test_is_loop_cyclic_motion_is_one_and_its_half_is_none(seed, n_frames):
    motion = cyclic_motion(seed % 1000, 2 * n_frames + 1)
    assert is_loop(motion)
    assert not is_loop(motion[: n_frames - n_frames // 3])
    assert is_loop(replace(motion, frame_time=900.0))  # longer than the longest frame time


def test_is_loop_turned_and_travelling_root_is_one_and_gap_is_none():
    motion = cyclic_motion(3)
    time = np.linspace(0.0, 1.0, motion.n_frames)
    quats, positions = motion.rotations.copy(), motion.positions.copy()
    quats[:, 0] = rotations.from_axis_angle([0.0, 1.0, 0.0], time)
    positions[:, 0, 2] += 150.0 * time
    assert is_loop(replace(motion, rotations=quats, positions=positions))
    positions[:, 0, 1] += 10.0 * time
    assert not is_loop(replace(motion, rotations=quats, positions=positions))
    assert not is_loop(cyclic_motion(3, gap=0.2))
    assert not is_loop(motion[:3])


@few_examples(12)
@given(st.integers(0, 1000))
def test_graft_loop_base_closes_within_the_gap_of_the_base(seed):
    library = library_of_cycles(seed)
    grafts = mg.graft_many(library, "cycle", 3, seed=seed)
    limit = join_gap(library.clips[0]).max() + 1e-6
    for graft in grafts:
        assert join_gap(graft.motion).max() <= limit
        steps = joint_steps(graft.motion)
        changes = np.linalg.norm(np.diff(steps, axis=0), axis=-1)
        assert changes[-1].max() <= 2.5 * max(changes[:-1].max(), 0.02)
    assert any(not own.is_own for graft in grafts for own in graft.substitutions)


def test_graft_loop_off_leaves_the_join_open_and_on_closes_it():
    library = library_of_cycles(7)
    opened = replace(library, config=replace(library.config, loop="off"))
    gaps = [join_gap(own.motion).max() for own in mg.graft_many(opened, "cycle", 3)]
    assert max(gaps) > 0.1
    part = dance(strides=2).motion
    build = mg.Library.build([part[:200], part[200:]], config=mg.Config(loop="on"))
    graft = mg.graft(build)
    joints = np.concatenate([build.joints(group) for group in graft.alternatives])
    assert join_gap(part[:200])[joints].max() > 0.1
    assert join_gap(graft.motion)[joints].max() < 1e-6


def test_graft_scenario_of_several_cycles_closes_at_the_end():
    library = library_of_cycles(5)
    segments = library.segments.of_clip(0).tolist()
    graft = mg.graft(library, scenario=[*segments, *segments])
    assert join_gap(graft.motion).max() < 1e-6
    assert graft.motion.n_frames == 2 * library.clips[0].n_frames - 1


@pytest.mark.parametrize("choice", ["viterbi", "sample"])
def test_graft_loop_prefers_donors_that_meet_at_the_join(choice):
    library = library_of_cycles(2)
    gaps = {}
    for loop in ("auto", "off"):
        config = replace(library.config, loop=loop, choice=choice, self_repair=False)
        pool = library.pool("upper")
        gaps[loop] = [
            pool.seam_angles(
                *(np.array([graft.substitutions[own].donor]) for own in (-1, 0))
            ).item()
            for graft in mg.graft_many(replace(library, config=config), "cycle", 4)
        ]
    assert np.mean(gaps["auto"]) < np.mean(gaps["off"])
