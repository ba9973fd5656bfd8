"""Segmentation of a growing motion: final bounds, length limits, agreement with `segment`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import OnlineSegmenter, extrema
from mograft.dancer import dance
from tests.strategies import SEEDS

DANCES = [dance(seed=seed, strides=1).motion for seed in range(2)]


def segment_bounds(energies, config, rate=30.0):
    """Return the bounds after all energies are pushed at once."""
    segmenter = OnlineSegmenter(rate, config)
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
    bounds = segment_bounds(mg.kinetic_energy(motion), mg.Config(), motion.rate)
    assert bounds == [0, *mg.segment(motion).stop.tolist()]


def test_online_segmenter_max_length_below_one_interval_cuts_at_all_frames():
    energies = np.linspace(1.0, 2.0, 20)
    assert segment_bounds(energies, mg.Config(max_length=0.5), 1.0) == list(range(20))
