"""Cuts at contacts, lowest points of the centre of mass and flights that are planted."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.segmentations import METHODS, method
from mograft import Config, Motion, rotations, segment
from mograft._util.runs import find_runs
from mograft.body.mass import mass_model
from mograft.dancer import dance
from tests.strategies import SEEDS, few_examples

WHOLE = Config(max_length=np.inf)
DANCER = dance(strides=1, seed=3).motion


def flight(n_frames, rate):
    """The heights of a jump, in statures."""
    time = np.arange(n_frames) / rate
    return 0.5 * 5.6 * time * (time[-1] - time)


def still_motion(n_frames, heights=0.0, rate=30.0):
    """A figure in its rest pose, raised by `heights` statures."""
    skeleton = DANCER.skeleton
    quats = np.tile(rotations.IDENTITY, (n_frames, skeleton.n_joints, 1))
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    positions[:, 0, 1] += np.asarray(heights) * mass_model(skeleton).height
    return Motion(skeleton, 1.0 / rate, quats, positions, name="still")


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("n_frames", [2, 30, 400])
def test_constant_motion_has_no_cut_frames(name, n_frames):
    assert len(segment(still_motion(n_frames), method=method(name, WHOLE))) == 1


@pytest.mark.parametrize("name", METHODS)
def test_segments_of_every_method_are_within_the_length_limits(name):
    segments = segment(DANCER, method=method(name))
    assert segments.lengths.min() >= 3
    if name in ("com", "contacts"):
        assert segments.lengths.max() <= 60


@few_examples(20)
@given(lengths=st.lists(st.integers(6, 30), min_size=1, max_size=6))
def test_contacts_finds_the_frames_in_which_a_figure_is_lifted_and_put_down(lengths):
    # At least one frame in ten stands, so that the 5th percentile is the floor.
    lengths = [max(sum(lengths), 10), *lengths]
    is_up = np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)
    motion = still_motion(len(is_up), 0.2 * is_up)
    changes = np.flatnonzero(np.diff(is_up)) + 1
    both, downs = (
        segment(motion, method=method("contacts", WHOLE, events=events)).start[1:]
        for events in ("both", "touchdown")
    )
    # A foot in the frame beside a change has a high speed, and is not in contact.
    assert all(np.abs(changes[:, None] - both).min(axis=0) <= 1)
    assert len(downs) == len(changes) // 2


@few_examples(4)
@given(SEEDS)
def test_com_finds_jumps_planted_into_a_dance(seed):
    rng = np.random.default_rng(seed)
    motion = dance(seed=seed, strides=1).motion[:900]
    height = mass_model(motion.skeleton).height
    positions, planted = motion.positions.copy(), []
    for start in np.arange(100, 800, 120) + rng.integers(60, size=6):
        n = int(rng.integers(12, 18))  # 0.4 to 0.57 s
        positions[start : start + n + 1, 0, 1] += flight(n + 1, 30.0) * height
        planted += [start, start + n]
    found = segment(replace(motion, positions=positions), method=method("com", WHOLE)).start
    # Feet pass 0.03 statures within two frames of take-off and landing.
    assert np.abs(found[:, None] - planted).min(axis=0).max() <= 3


@few_examples(20)
@given(
    jumps=st.lists(st.floats(0.3, 0.6), min_size=1, max_size=3),
    rate=st.sampled_from([30.0, 60.0, 120.0]),
)
def test_com_finds_planted_jumps(jumps, rate):
    pieces = [np.zeros(int(rate))]
    for seconds in jumps:
        pieces += [flight(round(seconds * rate) + 1, rate), np.zeros(int(rate))]
    heights = np.concatenate(pieces)
    motion = still_motion(len(heights), heights, rate=rate)
    found = segment(motion, method=method("com", WHOLE, min_depth=1))
    flights = find_runs(heights >= 0.03) - [0, 1]  # feet are in contact below 0.03 statures
    np.testing.assert_array_equal(found.start[1:], flights.ravel())
