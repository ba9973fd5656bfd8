"""Normalised compatibility κ against its definition."""

import numpy as np
import pytest
from hypothesis import given

from lab.donors.kappa import Kappas
from tests.strategies import SEEDS, few_examples


@few_examples(40)
@given(SEEDS)
def test_kappas_random_rates_equal_definition(seed):
    rng = np.random.default_rng(seed)
    n = 60
    captured, random = rng.uniform(0.5, 1, (3, n)), rng.uniform(0, 0.4, (3, n))
    accepted = rng.uniform(0, 1, (3, n))
    accepted[rng.random((3, n)) < 0.4] = np.nan
    by_method = {"x": accepted, "captured": captured, "random": random}
    kappas = Kappas(captured, random, by_method, np.arange(n) // 5, seed)
    expected = (np.nanmean(accepted) - random.mean()) / (captured.mean() - random.mean())
    assert kappas.kappa("x").value == pytest.approx(expected)
    has_donor = np.isfinite(accepted)
    low, high = random[has_donor].mean(), captured[has_donor].mean()
    matched = (accepted[has_donor].mean() - low) / (high - low)
    assert kappas.kappa("x", is_matched=True).value == pytest.approx(matched)
    assert kappas.kappa("captured").value == pytest.approx(1)
    assert kappas.kappa("random").value == pytest.approx(0)
    found = kappas.difference("x", "random")
    assert found.accepted.value == pytest.approx(accepted[has_donor].mean() - low)
    assert found.kappa.value == pytest.approx(matched)
    assert found.kappa.low <= found.kappa.value <= found.kappa.high
    assert found.kappa.n == kappas.kappa("x").n == has_donor.any(axis=0).sum()
    assert kappas.mean(accepted, "segments").value == pytest.approx(np.nanmean(accepted))


def test_kappas_splits_that_differ_widen_interval():
    rng = np.random.default_rng(0)
    captured, random = np.ones((3, 200)), np.zeros((3, 200))
    equal = np.tile(rng.uniform(0.4, 0.6, 200), (3, 1))
    different = equal + np.array([[-0.3], [0.0], [0.3]])
    blocks = np.arange(200) // 5
    narrow, wide = (
        Kappas(captured, random, {"x": accepted}, blocks, 0).kappa("x")
        for accepted in (equal, different)
    )
    assert narrow.value == pytest.approx(wide.value)
    assert wide.low < narrow.low - 0.1
    assert wide.high > narrow.high + 0.1
