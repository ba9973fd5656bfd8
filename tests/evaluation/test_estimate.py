"""Intervals: against SciPy, by their coverage, and by what they must not pretend."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from mograft import Segments
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, blocks, bootstrap, mean, rogan_gladen, share
from tests.strategies import SEEDS

RATES = st.floats(0.55, 1.0)


@given(st.integers(1, 300), st.data())
def test_shares_have_wilsons_interval(n, data):
    hits = data.draw(st.integers(0, n))
    own = share(hits, n, "x")
    want = binomtest(hits, n).proportion_ci(method="wilson")
    assert own.low == pytest.approx(want.low, abs=1e-12)
    assert own.high == pytest.approx(want.high, abs=1e-12)
    assert own.low <= own.value <= own.high
    assert own.n == n


@given(st.floats(0, 1), RATES, RATES)
def test_the_correction_undoes_a_classifiers_errors(truth, sensitivity, specificity):
    seen = truth * sensitivity + (1 - truth) * (1 - specificity)
    assert rogan_gladen(seen, sensitivity, specificity) == pytest.approx(truth, abs=1e-9)


def test_no_correction_by_a_classifier_that_knows_nothing():
    assert math.isnan(rogan_gladen(0.7, 0.5, 0.5))
    assert math.isnan(rogan_gladen(0.7, 0.3, 0.4))


@given(st.lists(st.integers(1, 60), min_size=1, max_size=14), st.integers(1, 20))
def test_blocks_are_neighbours_of_one_clip(counts, size):
    clip = np.repeat(np.arange(len(counts)), counts)
    start = np.arange(len(clip))
    own = blocks(Segments(start, start + 1, clip), size)
    assert sorted(set(own.tolist())) == list(range(own.max() + 1))
    for block in range(own.max() + 1):
        members = np.flatnonzero(own == block)
        assert len(set(clip[members].tolist())) == 1
        assert (np.diff(members) == 1).all()
        if len(counts) < estimate.CLIPS:
            assert len(members) <= size
    if len(counts) >= estimate.CLIPS:
        assert own.tolist() == clip.tolist()


@given(SEEDS)
def test_a_mean_is_the_mean_and_its_interval_holds_it(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=80)
    values[::9] = np.nan
    own = mean(values, np.arange(80) // 4, "x", seed)
    assert own.value == pytest.approx(np.nanmean(values))
    assert own.n == int(np.isfinite(values).sum())
    assert own.low <= own.value <= own.high
    assert own == mean(values, np.arange(80) // 4, "x", seed)


def test_intervals_cover_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(0)
    held = 0
    for trial in range(200):
        hidden = rng.normal(size=40)  # what a block's five values share
        values = np.repeat(hidden, 5) + 0.3 * rng.normal(size=200)
        own = mean(values, np.arange(200) // 5, "x", trial)
        held += own.low <= 0 <= own.high
        if trial % 20:
            continue
        alone = mean(values, np.arange(200), "x", trial)
        # Taken one by one, what hangs together looks surer than it is.
        assert alone.high - alone.low < 0.7 * (own.high - own.low)
    assert 0.88 <= held / 200 <= 1.0  # seven standard errors about 0.95, less the bootstrap's bias


def test_few_blocks_have_no_interval():
    own = mean(np.arange(40.0), np.arange(40) // 10, "x")
    assert own.value == 19.5
    assert math.isnan(own.low)
    assert own.as_dict()["interval"] is None
    assert "no interval" in own.text()
    nothing = mean([np.nan, np.nan], [0, 1], "x")
    assert nothing.n == 0
    assert nothing.as_dict()["value"] is None
    assert nothing.text() == "none"
    low, _ = bootstrap(lambda drawn: np.full(len(drawn), np.nan), 30)
    assert np.isnan(low).all()


def test_numbers_in_words():
    own = Estimate(0.5, 0.25, 0.75, 8, "x", "y")
    assert own.text(0, 100, " %") == "50 % (25 to 75)"
    assert str(own) == "0.500 (0.250 to 0.750)"
