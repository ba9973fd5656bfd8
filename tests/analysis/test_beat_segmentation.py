"""Beats of motions whose tempo is known."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from lab.studies.behaviour_pieces import metronome
from mograft import Motion
from mograft.analysis import beats
from mograft.dancer import dance
from mograft.motion import rotations
from tests.analysis.behaviours import behaviours
from tests.strategies import SEEDS, few_examples, quaternions, star_skeleton

DEFAULT = beats.BeatParameters()


@few_examples(25)
@given(SEEDS, st.floats(0.35, 1.3), st.sampled_from([30.0, 60.0, 120.0]))
def test_beats_known_tempo_is_found_within_two_percent(seed, interval, rate):
    motion = metronome(seed, interval, rate)
    assert beats.beat_interval(motion, DEFAULT) == pytest.approx(interval, rel=0.02)
    # The acceleration is zero in the middle between two poses.
    seconds = beats.cut_frames(motion, DEFAULT) / rate
    offsets = (seconds / interval) % 1.0 - 0.5
    assert np.abs(offsets).max() <= 0.2
    assert abs(len(seconds) - 16.0 / interval) <= 2


@pytest.mark.parametrize("seed", range(3))
def test_beats_of_the_dancer_are_its_steps(seed):
    sample = dance(seed, strides=4)
    is_walk = sample.legs == "walk"
    first = int(np.argmax(is_walk))
    stop = first + int(np.argmin(is_walk[first:]))
    stride = np.mean(np.diff(np.flatnonzero(np.diff(sample.phase[first:stop]) < -0.5))) / 30.0
    found = beats.beat_interval(sample.motion[first:stop], DEFAULT)
    assert stride / found == pytest.approx(2.0, rel=0.05)


@few_examples(20)
@given(st.floats(0.5, 2.0), st.floats(0.0, 6.0), st.floats(0.2, 1.0))
def test_candidate_beats_of_an_oscillation_are_its_fastest_moments(period, phase, amplitude):
    times = np.arange(600) / 60.0
    angle = amplitude * np.sin(2 * np.pi * times / period + phase)
    skeleton = star_skeleton(2)
    quats = np.tile(rotations.IDENTITY, (600, 2, 1))
    quats[:, 1] = rotations.from_axis_angle([0, 1, 0], angle)
    motion = Motion(skeleton, 1 / 60, quats, np.tile(skeleton.offsets, (600, 1, 1)))
    found, weights = beats.candidate_beats(motion, beats.BeatParameters(smoothing=1e-3))
    expected = (np.arange(-1, 60) * 0.5 - phase / (2 * np.pi)) * period
    expected = expected[(expected > 0.05) & (expected < times[-1] - 0.05)]
    inner = np.sort(found[(found > 0.05) & (found < times[-1] - 0.05)])
    np.testing.assert_allclose(inner, expected, atol=0.01)
    speed = 2 * np.pi / period * amplitude
    assert weights.max() <= 2.02 * speed


@few_examples(10)
@given(SEEDS, quaternions(()))
def test_beats_ignore_root_and_quaternion_signs(seed, turn):
    motion = metronome(seed, 0.6, 30.0)
    rng = np.random.default_rng(seed)
    quats = motion.rotations.copy()
    quats[:, 0] = rotations.multiply(turn, rotations.exp(rng.normal(size=(len(motion), 3))))
    quats *= rng.choice([-1.0, 1.0], size=quats.shape[:2])[..., None]
    positions = motion.positions + rng.normal(size=(len(motion), 1, 3))
    positions[:, 1:] = motion.positions[:, 1:]
    moved = Motion(motion.skeleton, motion.frame_time, quats, positions)
    np.testing.assert_array_equal(
        beats.cut_frames(moved, DEFAULT), beats.cut_frames(motion, DEFAULT)
    )


@few_examples(10)
@given(SEEDS, st.integers(2, 300))
def test_beats_short_or_constant_motion_has_none(seed, n_frames):
    motion, _ = behaviours(seed, [4.0])
    short = motion[: min(n_frames, 89)]
    assert not len(beats.cut_frames(short, DEFAULT))
    jitter = np.random.default_rng(seed).normal(size=(n_frames, motion.n_joints, 3)) * 1e-4
    quats = rotations.multiply(motion.rotations[:1], rotations.exp(jitter))
    positions = np.repeat(motion.positions[:1], n_frames, axis=0)
    still = Motion(motion.skeleton, motion.frame_time, quats, positions)
    assert not len(beats.cut_frames(still, DEFAULT))


@few_examples(60)
@given(
    npst.arrays(np.float64, st.integers(8, 13), elements=st.floats(0, 5)),
    st.floats(2.0, 4.0),
    st.floats(0.1, 20.0),
)
def test_fit_beats_equals_search_of_all_sequences(strength, interval, tightness):
    def total(chosen):
        gaps = np.diff(chosen)
        return strength[list(chosen)].sum() - tightness * (np.log(gaps / interval) ** 2).sum()

    shortest, longest = max(round(interval / 2), 1), round(2 * interval)
    n = len(strength)
    best = max(
        total(chosen)
        for count in range(1, n + 1)
        for chosen in itertools.combinations(range(n), count)
        if all(shortest <= gap <= longest for gap in np.diff(chosen))
        and chosen[0] < interval
        and chosen[-1] >= n - int(np.ceil(interval))
    )
    found = beats.fit_beats(strength, interval, tightness)
    assert total(found) == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"shortest": 0.05}, "`shortest` must be at least 0.1, got 0.05"),
        ({"shortest": 0.8}, "`longest` must be at least twice `shortest`, 1.6, got 1.5"),
        ({"fundamental": 1.5}, "`fundamental` must be at most 1, got 1.5"),
        ({"tightness": 0.0}, "`tightness` must be above 0, got 0.0"),
    ],
)
def test_beat_parameters_out_of_range_raise_value_error(values, message):
    with pytest.raises(ValueError, match=message):
        beats.BeatParameters(**values)
