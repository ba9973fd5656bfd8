"""Segmentation of a growing motion: final bounds, length limits, agreement with `segment`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.online_segmentation import OnlineSegmenter, WindowSegmenter
from mograft.analysis.segmentation import extrema
from mograft.analysis.segmentations import METHODS
from mograft.dancer import dance
from mograft.motion import rotations
from tests.analysis.behaviours import behaviours
from tests.strategies import SEEDS, few_examples, star_skeleton

DANCES = [dance(seed=seed, strides=1).motion for seed in range(2)]
CAUSAL = [name for name, own in METHODS.entries.items() if own and own.look_ahead is not None]


def segment_bounds(energies, config):
    """Return the bounds after all energies are pushed at once."""
    segmenter = OnlineSegmenter(30.0, config)
    segmenter.push(energies)
    segmenter.close()
    return segmenter.bounds


@given(SEEDS, st.integers(1, 300), st.lists(st.integers(1, 50), min_size=1, max_size=5))
def test_online_segmenter_any_chunks_bounds_are_final_and_within_length_limits(seed, n, chunks):
    rng = np.random.default_rng(seed)
    energies = np.abs(np.cumsum(rng.normal(size=n + 1)))
    energies[rng.integers(n) :][:80] = 1.0  # a constant interval, without extrema
    config = mg.Config(max_length=1.0)
    segmenter, final = OnlineSegmenter(30.0, config), []
    first, n_pushes = 0, 0
    while first < len(energies):
        size = chunks[n_pushes % len(chunks)]
        segmenter.push(energies[first : first + size])
        assert segmenter.bounds[: len(final)] == final
        final, first, n_pushes = list(segmenter.bounds), first + size, n_pushes + 1
    segmenter.close()
    assert segmenter.bounds[: len(final)] == final
    assert segmenter.bounds == segment_bounds(energies, config)
    bounds = np.array(segmenter.bounds)
    assert bounds[0] == 0
    assert bounds[-1] == n
    if n >= 3:
        assert np.diff(bounds).min() >= 3
    assert np.diff(bounds).max() <= 30


@given(SEEDS, st.integers(40, 300))
def test_online_segmenter_without_merges_cuts_at_all_extrema(seed, n):
    rng = np.random.default_rng(seed)
    phase, pace = rng.uniform(0, 6), rng.uniform(0.15, 0.4)
    energies = 2.0 + np.cos(phase + pace * np.arange(n)) + 0.3 * np.sin(0.05 * np.arange(n))
    config = mg.Config(min_length=1 / 30, max_length=100.0)
    inner = extrema(gaussian_filter(energies, config.smoothing * 30.0))
    expected = [0, *(int(frame) for frame in inner if 0 < frame < n - 1), n - 1]
    assert segment_bounds(energies, config) == expected


@pytest.mark.parametrize("seed", [0, 4])
def test_online_segmenter_dance_equals_segment(seed):
    motion = dance(seed=seed, strides=1).motion
    segmenter = OnlineSegmenter(motion.rate, mg.Config())
    segmenter.push(mg.kinetic_energy(motion))
    segmenter.close()
    assert segmenter.bounds == [0, *mg.segment(motion).stop.tolist()]


def test_online_segmenter_without_extrema_cuts_at_max_length():
    segmenter = OnlineSegmenter(30.0, mg.Config(max_length=1.0))
    segmenter.push(np.linspace(1.0, 2.0, 200))
    assert segmenter.bounds[:5] == [0, 30, 60, 90, 120]


def test_online_segmenter_max_length_below_one_interval_cuts_at_all_frames():
    segmenter = OnlineSegmenter(1.0, mg.Config(max_length=0.5))
    segmenter.push(np.linspace(1.0, 2.0, 20))
    segmenter.close()
    assert segmenter.bounds == list(range(20))


def test_online_segmenter_long_dance_holds_limited_history():
    motion = dance(seed=3, strides=1).motion
    segmenter = OnlineSegmenter(motion.rate, mg.Config())
    n_held = 0
    for energy in mg.kinetic_energy(motion):
        segmenter.push(np.array([energy]))
        n_held = max(n_held, len(segmenter._energies))
    assert n_held < 400 < motion.n_frames


def window_bounds(motion, config, chunks):
    """Return the bounds after a motion is pushed in chunks, and check that bounds stay final."""
    segmenter, final, first = WindowSegmenter(motion.rate, config), [], 0
    while first < motion.n_frames:
        size = chunks[first % len(chunks)]
        segmenter.push(motion[first : first + size])
        assert segmenter.bounds[: len(final)] == final
        final, first = list(segmenter.bounds), first + size
    segmenter.close()
    assert segmenter.bounds[: len(final)] == final
    return segmenter.bounds


@pytest.mark.parametrize("name", CAUSAL)
@few_examples(6)
@given(
    n=st.integers(2, 400),
    chunks=st.lists(st.integers(1, 40), min_size=1, max_size=5),
    max_length=st.sampled_from([0.4, 2.0, np.inf]),
)
def test_window_segmenter_any_chunks_bounds_are_final_and_within_length_limits(
    name, n, chunks, max_length
):
    motion = DANCES[n % 2][:n]
    config = mg.Config(segmentation=name, max_length=max_length)
    bounds = window_bounds(motion, config, chunks)
    assert bounds == window_bounds(motion, config, [n])
    assert (bounds[0], bounds[-1]) == (0, n - 1)
    if n > 3:
        assert np.diff(bounds).min() >= 3
    if not METHODS.get(name).has_long_segments:
        assert np.diff(bounds).max() <= max_length * 30


@pytest.mark.parametrize("name", [name for name in CAUSAL if METHODS.get(name).restarts])
@few_examples(5)
@given(seed=SEEDS, chunks=st.lists(st.integers(1, 200), min_size=1, max_size=3))
def test_window_segmenter_of_a_method_that_restarts_equals_segment(name, seed, chunks):
    motion, _ = behaviours(seed, [5.0, 4.0, 6.0])
    config = mg.Config(segmentation=name)
    assert window_bounds(motion, config, chunks) == [0, *mg.segment(motion, config).stop.tolist()]


@pytest.mark.parametrize("name", [name for name in CAUSAL if METHODS.get(name).restarts])
def test_window_segmenter_of_a_method_that_restarts_cuts_constant_motion_after_30_seconds(name):
    skeleton = star_skeleton(2)
    still = np.tile(rotations.IDENTITY, (2000, 2, 1))
    motion = mg.Motion(skeleton, 1 / 30, still, np.tile(skeleton.offsets, (2000, 1, 1)))
    assert window_bounds(motion, mg.Config(segmentation=name), [500]) == [0, 900, 1800, 1999]


@pytest.mark.parametrize("name", CAUSAL)
def test_window_segmenter_within_its_window_cuts_like_segment(name):
    motion = DANCES[0][:240]
    config = mg.Config(segmentation=name, min_length=1 / 30, max_length=np.inf)
    expected = [0, *mg.segment(motion, config).stop.tolist()]
    found = window_bounds(motion, config, [240])
    assert found[-1] == expected[-1]
    if METHODS.get(name).restarts:
        assert found == expected
    # The floor is that of all frames in `segment`, and of those so far here.
    assert set(found[:-1]) >= {f for f in expected[:-1] if f > 120}


@pytest.mark.parametrize("name", CAUSAL)
def test_window_segmenter_long_motion_holds_limited_history(name):
    motion = DANCES[1][:400]
    segmenter = WindowSegmenter(motion.rate, mg.Config(segmentation=name))
    for first in range(0, motion.n_frames, 50):
        segmenter.push(motion[first : first + 50])
        assert segmenter._window.n_frames <= (30 if segmenter._method.restarts else 8) * 30 + 15
