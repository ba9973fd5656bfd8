"""Estimates and intervals: block bootstrap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, block_mean, bootstrap_estimate, segment_blocks
from tests.strategies import SEEDS


@given(st.lists(st.integers(1, 60), min_size=1, max_size=14), st.integers(1, 20))
def test_segment_blocks_are_neighbours_of_one_clip(counts, size):
    clip = np.repeat(np.arange(len(counts)), counts)
    blocks = segment_blocks(clip, size)
    assert sorted(set(blocks.tolist())) == list(range(blocks.max() + 1))
    for block in range(blocks.max() + 1):
        members = np.flatnonzero(blocks == block)
        assert len(set(clip[members].tolist())) == 1
        assert (np.diff(members) == 1).all()
        if len(counts) < estimate.MIN_CLIPS_AS_BLOCKS:
            assert len(members) <= size
    if len(counts) >= estimate.MIN_CLIPS_AS_BLOCKS:
        assert blocks.tolist() == clip.tolist()


@given(SEEDS)
def test_block_mean_with_nan_ignores_nan_and_is_reproducible(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=80)
    values[::9] = np.nan
    found = block_mean(values, np.arange(80) // 4, "x", seed)
    assert found.value == pytest.approx(np.nanmean(values))
    assert found.n == int(np.isfinite(values).sum())
    assert found.low <= found.value <= found.high
    assert found == block_mean(values, np.arange(80) // 4, "x", seed)


def test_block_mean_correlated_values_covers_truth_in_95_percent():
    rng = np.random.default_rng(0)
    n_covered = 0
    for trial in range(200):
        common = rng.normal(size=40)  # one for the five values of each block
        values = np.repeat(common, 5) + 0.3 * rng.normal(size=200)
        found = block_mean(values, np.arange(200) // 5, "x", trial)
        n_covered += found.low <= 0 <= found.high
        if trial % 20:
            continue
        independent = block_mean(values, np.arange(200), "x", trial)
        # Without blocks the interval is too narrow.
        assert independent.high - independent.low < 0.7 * (found.high - found.low)
    # Seven standard errors below 0.95 for the bias of the bootstrap.
    assert 0.88 <= n_covered / 200 <= 1.0


def test_estimates_of_few_values_have_no_interval():
    four_blocks = block_mean(np.arange(40.0), np.arange(40) // 10, "x")
    assert four_blocks.value == 19.5
    statistic = bootstrap_estimate(1, lambda draws: draws[:, 0] * np.nan, 30, n=1, unit="x", seed=0)
    for found in (four_blocks, statistic):
        assert np.isnan([found.low, found.high]).all()
        assert found.as_dict()["interval"] is None
        assert "no interval" in found.text()
    nothing = block_mean([np.nan, np.nan], [0, 1], "x")
    assert (nothing.n, nothing.as_dict()["value"], nothing.text()) == (0, None, "none")


def test_estimate_text_scales_and_rounds():
    found = Estimate(value=0.5, low=0.25, high=0.75, n=8, unit="x", interval_method="y")
    assert found.text(0, 100, " %") == "50 % (25 to 75)"
    assert found.text() == "0.500 (0.250 to 0.750)"
