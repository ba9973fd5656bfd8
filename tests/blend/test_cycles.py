"""`cut_cycle` and the join of a loop: periods without a jump, closed ends, refusals."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.blend.loop_join import close_join
from mograft.blend.recombine import Part
from mograft.body.loops import is_loop
from mograft.motion import rotations
from mograft.motion.motion import Motion
from tests.strategies import (
    SEEDS,
    assert_same_rotations,
    few_examples,
    person,
    smooth_rotations,
    transform_motion,
)

RATE, UP = 30.0, np.array([0.0, 1.0, 0.0])


def periodic_walk(seed, period, n_frames, drift=0.0):
    """A figure that walks on a curve and swings every joint; `drift` grows over the periods."""
    rng = np.random.default_rng(seed)
    base = person(0, 2)
    phase = 2 * np.pi * np.arange(n_frames) / period
    size = (base.n_joints, 3)
    swing = [rng.normal(size=size) * 0.25 for _ in range(2)]
    vectors = np.sin(phase)[:, None, None] * swing[0] + np.cos(phase)[:, None, None] * swing[1]
    vectors += drift * np.sin(phase / 7.3)[:, None, None] * rng.normal(size=size)
    quats = rotations.exp(vectors)
    turn = np.cumsum(rng.uniform(-0.02, 0.02) + 0.02 * np.cos(phase))
    yaw = rotations.from_axis_angle(UP, turn)
    root = base.locomotion_root()
    quats[:, root] = rotations.multiply(yaw, quats[:, root])
    steps = np.stack([0.3 * np.sin(phase), np.zeros(n_frames), 4 + np.cos(2 * phase)], axis=1)
    places = np.repeat(base.positions[:1], n_frames, axis=0)
    places[:, root] += np.cumsum(rotations.rotate(yaw, steps), axis=0)
    places[:, root, 1] += 2.0 * np.sin(2 * phase)
    return Motion(base.skeleton, 1 / RATE, quats, places, name="walk")


PERIODS = st.integers(20, 45)


@few_examples(25)
@given(SEEDS, PERIODS, st.integers(1, 3), st.integers(1, 12))
def test_cut_cycle_periodic_motion_gives_unchanged_periods(seed, period, count, more):
    motion = periodic_walk(seed, period, count * period + more)
    cycle, (first, last) = mg.cut_cycle(motion)
    assert last - first == period
    np.testing.assert_allclose(cycle.rotations, motion.rotations[first : last + 1], atol=1e-6)
    np.testing.assert_allclose(cycle.positions, motion.positions[first : last + 1], atol=1e-6)


def step_changes(quats):
    """Changes of the joint velocities from frame to frame, shape (n, n_joints)."""
    steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
    return np.linalg.norm(np.diff(steps, axis=0), axis=-1)


@few_examples(25)
@given(SEEDS, PERIODS)
def test_cut_cycle_repeated_has_no_jump(seed, period):
    motion = periodic_walk(seed, period, 5 * period, drift=0.04)
    cycle, (first, last) = mg.cut_cycle(motion)
    assert is_loop(cycle)
    assert abs(last - first - period) <= 2
    root = motion.locomotion_root()
    others = np.setdiff1d(np.arange(motion.n_joints), root)
    np.testing.assert_array_equal(
        np.abs(cycle.rotations[0, others]), np.abs(cycle.rotations[-1, others])
    )
    # The root of the second round begins where and as the first one ends.
    gap = rotations.multiply(cycle.rotations[-1, root], rotations.inverse(cycle.rotations[0, root]))
    upright = rotations.multiply(rotations.inverse(rotations.twist(gap, 1)), gap)
    assert np.linalg.norm(rotations.log(upright)) < 1e-9
    assert cycle.positions[-1, root, 1] == pytest.approx(cycle.positions[0, root, 1])
    again = cycle.rotations[1:].copy()
    again[:, root] = rotations.multiply(gap, again[:, root])
    twice = np.concatenate([cycle.rotations, again])
    largest = step_changes(motion.rotations).max()
    assert step_changes(twice)[-len(cycle) - 3 : -len(cycle) + 3].max() <= largest * 1.02


@few_examples(15)
@given(SEEDS, PERIODS, st.floats(-3.0, 3.0), st.sampled_from([0.01, 2.0]))
def test_cut_cycle_turned_and_scaled_motion_gives_same_frames(seed, period, yaw, scale):
    motion = periodic_walk(seed, period, 4 * period, drift=0.04)
    moved = transform_motion(motion, scale=scale, yaw=yaw, offset=(5.0, 0.0, -3.0))
    assert mg.cut_cycle(moved)[1] == mg.cut_cycle(motion)[1]


@few_examples(15)
@given(SEEDS, PERIODS, st.integers(1, 3))
def test_cut_cycle_seconds_select_number_of_periods(seed, period, count):
    motion = periodic_walk(seed, period, 4 * period, drift=0.01)
    cycle, _ = mg.cut_cycle(motion, 1.1 * count * period / RATE)
    assert abs(cycle.n_frames - 1 - count * period) <= 2


@few_examples(15)
@given(SEEDS, st.integers(30, 80))
def test_cut_cycle_motion_without_repetition_names_nearest(seed, n_frames):
    rng = np.random.default_rng(seed)
    base = person(0, 2)
    speed = rng.uniform(0.5, 1.0, (base.n_joints, 3)) / n_frames
    quats = rotations.exp(np.arange(n_frames)[:, None, None] * speed)
    motion = Motion(base.skeleton, 1 / RATE, quats, np.repeat(base.positions[:1], n_frames, 0))
    with pytest.raises(ValueError, match="has no cycle") as caught:
        mg.cut_cycle(motion)
    first, last, share = map(
        int, re.findall(r"frames (\d+)-(\d+), differ by (\d+)%", str(caught.value))[0]
    )
    assert 0 <= first < last < n_frames
    assert share > 15


def test_cut_cycle_bad_arguments_are_named():
    motion = periodic_walk(0, 30, 70)
    with pytest.raises(TypeError, match="`motion`"):
        mg.cut_cycle([motion])
    with pytest.raises(ValueError, match="`seconds` must be above 0, got -1"):
        mg.cut_cycle(motion, -1)
    with pytest.raises(ValueError, match=r"no cycle of 2.25 to 3.75 s: it has 0.633 s"):
        mg.cut_cycle(motion[:20], 3.0)
    with pytest.raises(ValueError, match="has no cycle"):
        mg.cut_cycle(motion[:1])
    still = mg.Motion(
        motion.skeleton, 1 / RATE, motion.rotations[[0] * 40], motion.positions[[0] * 40]
    )
    with pytest.raises(ValueError, match="it moves too little"):
        mg.cut_cycle(still)


JOINTS = np.array([1, 2])


def open_loop(seed, n_frames, *, opposite=False):
    """A part whose ends do not meet; quaternions of one joint may change their sign on the way."""
    rng = np.random.default_rng(seed)
    quats = smooth_rotations(rng, n_frames, 2, 0.1)
    if opposite:
        quats[:, 0] = rotations.from_axis_angle(
            np.eye(3)[1], np.linspace(0.0, 2 * np.pi, n_frames) + 0.05
        )
    quats = rotations.continuous_signs(quats)
    return Part(JOINTS, quats, np.cumsum(rng.normal(size=(n_frames, 2, 3)), axis=0))


@few_examples(40)
@given(SEEDS, st.integers(8, 80), st.booleans(), st.floats(0.05, 0.5))
def test_close_join_last_frame_is_first_and_far_frames_stay(seed, n_frames, opposite, blend):
    part = open_loop(seed, n_frames, opposite=opposite)
    closed = close_join(part, RATE, blend)
    middle = (n_frames - 1) // 2
    frames = np.arange(n_frames)
    far = np.minimum(frames, n_frames - 1 - frames) > RATE * blend
    far &= frames != middle
    np.testing.assert_allclose(closed.positions[far], part.positions[far], atol=1e-12)
    assert_same_rotations(closed.rotations[far], part.rotations[far], 1e-12)
    np.testing.assert_array_equal(closed.positions[-1], closed.positions[0])
    assert_same_rotations(closed.rotations[-1], closed.rotations[0])
    assert (np.abs(closed.rotations[-1]) == np.abs(closed.rotations[0])).all()
    np.testing.assert_allclose(np.linalg.norm(closed.rotations, axis=-1), 1.0, atol=1e-12)
    if n_frames >= 30:
        # Else a writer or a player that interpolates would turn the long way round at the join.
        assert ((closed.rotations[-1] * closed.rotations[-2]).sum(axis=-1) > 0.0).all()
