"""Laws of the searches: each against all rows of choices, written out."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from mograft.search.viterbi import Trellis, diverse, k_best, sample, viterbi
from tests.oracles import search as oracle
from tests.strategies import SEEDS


def make_chain(seed, *, whole=False, forbidden=0.0, n_positions=None):
    """A chain of up to five positions with up to four choices each."""
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 6) if n_positions is None else n_positions
    counts = rng.integers(1, 5, n)

    def costs(shape):
        # Whole numbers add up exactly, and are often equal.
        drawn = rng.integers(-2, 4, shape).astype(float) if whole else rng.normal(size=shape)
        return np.where(rng.random(shape) < forbidden, math.inf, drawn)

    alone = [costs(count) for count in counts]
    return Trellis(tuple(alone), tuple(costs(pair) for pair in pairwise(counts)))


def cost(chain, row):
    total = sum(costs[at] for costs, at in zip(chain.unary, row, strict=True))
    return total + sum(c[i, j] for c, (i, j) in zip(chain.pairwise, pairwise(row), strict=True))


def all_rows(chain):
    """Every row, the cheapest first, equally cheap ones in order of their choices."""
    rows = product(*(range(len(costs)) for costs in chain.unary))
    return sorted(rows, key=lambda row: (cost(chain, row), row))


@given(SEEDS, st.booleans(), st.sampled_from([0.0, 0.3]))
def test_viterbi_finds_the_cheapest_of_all_rows_and_of_equals_the_first(seed, whole, forbidden):
    chain = make_chain(seed, whole=whole, forbidden=forbidden)
    cheapest = all_rows(chain)[0]
    found = viterbi(chain)
    assert cost(chain, found) == pytest.approx(cost(chain, cheapest), abs=1e-12)
    assert chain.cost(found) == pytest.approx(cost(chain, found), abs=1e-12)
    plainly = oracle.cheapest_sequence(chain.unary, chain.pairwise)
    assert cost(chain, plainly) == pytest.approx(cost(chain, found), abs=1e-12)
    if whole and math.isfinite(cost(chain, cheapest)):
        assert tuple(found) == cheapest


@given(SEEDS, st.integers(1, 60), st.booleans(), st.sampled_from([0.0, 0.3]))
def test_the_best_are_the_cheapest_in_order_and_all_different(seed, count, whole, forbidden):
    chain = make_chain(seed, whole=whole, forbidden=forbidden)
    expected = [row for row in all_rows(chain) if math.isfinite(cost(chain, row))][:count]
    found = k_best(chain, count)
    assert len(found) == len(expected) == len({row.tobytes() for row in found})
    costs = [cost(chain, row) for row in found]
    np.testing.assert_allclose(costs, [cost(chain, row) for row in expected], atol=1e-12)
    assert all(a <= b + 1e-12 for a, b in pairwise(costs))
    if whole:
        assert [tuple(row) for row in found] == expected


@given(SEEDS)
def test_viterbi_is_never_dearer_than_chance_or_the_nearest_next(seed):
    chain = make_chain(seed, n_positions=40)
    rng = np.random.default_rng(seed)
    least = cost(chain, viterbi(chain)) - 1e-9
    for _ in range(10):
        assert least <= cost(chain, [rng.integers(len(costs)) for costs in chain.unary])
    greedy = [int(chain.unary[0].argmin())]
    for alone, after in zip(chain.unary[1:], chain.pairwise, strict=True):
        greedy.append(int((alone + after[greedy[-1]]).argmin()))
    assert least <= cost(chain, greedy)


@pytest.mark.parametrize(("seed", "temperature"), [(1, 0.5), (2, 1.0), (4, 4.0)])
def test_draws_follow_the_gibbs_distribution(seed, temperature):
    chain = make_chain(seed, n_positions=4, forbidden=0.1)
    rows = [row for row in all_rows(chain) if math.isfinite(cost(chain, row))]
    weights = np.exp([-cost(chain, row) / temperature for row in rows])
    rng = np.random.default_rng(seed)
    draws = [tuple(sample(chain, temperature, rng)) for _ in range(4000)]
    counts = np.array([draws.count(row) for row in rows])
    assert counts.sum() == len(draws)
    expected = weights / weights.sum() * len(draws)
    few = expected < 5  # such bins are too small for the test: they are one bin
    counts = np.append(counts[~few], counts[few].sum())
    expected = np.append(expected[~few], expected[few].sum())
    filled = expected > 0
    assert len(expected) > 4
    assert chisquare(counts[filled], expected[filled]).pvalue > 1e-4


@given(SEEDS)
def test_cold_draws_are_the_cheapest_and_hot_ones_are_alike(seed):
    chain = make_chain(seed)
    rng = np.random.default_rng(seed)
    cold = sample(chain, 1e-9, rng)
    assert cost(chain, cold) == pytest.approx(cost(chain, viterbi(chain)), abs=1e-6)
    again = sample(chain, 1e-9, np.random.default_rng(seed))
    np.testing.assert_array_equal(cold, again)


def test_hot_draws_take_every_row_alike():
    chain = make_chain(5, n_positions=3)
    rng = np.random.default_rng(0)
    draws = [tuple(sample(chain, 1e9, rng)) for _ in range(4000)]
    assert chisquare([draws.count(row) for row in all_rows(chain)]).pvalue > 1e-4


def test_costs_far_beyond_floating_point_weights_are_drawn_all_the_same():
    chain = Trellis((np.array([1e5, 1e5 + 1.0]), np.array([-1e5, math.inf])), (np.zeros((2, 2)),))
    rng = np.random.default_rng(0)
    draws = [tuple(sample(chain, 1.0, rng)) for _ in range(2000)]
    share = draws.count((0, 0)) / len(draws)
    assert set(draws) == {(0, 0), (1, 0)}
    assert share == pytest.approx(1 / (1 + math.exp(-1)), abs=0.04)


@given(SEEDS, st.integers(1, 30), st.sampled_from([0.0, 0.5, 100.0]))
def test_diverse_rows_differ_and_start_with_the_cheapest(seed, count, penalty):
    chain = make_chain(seed)
    found = diverse(chain, count, penalty)
    assert len(found) == min(count, len(all_rows(chain)))
    assert len({row.tobytes() for row in found}) == len(found)
    np.testing.assert_array_equal(found[0], viterbi(chain))
    if penalty == 0.0:
        costs = [cost(chain, row) for row in found]
        expected = [cost(chain, row) for row in all_rows(chain)[: len(found)]]
        np.testing.assert_allclose(costs, expected, atol=1e-12)


@given(SEEDS)
def test_a_high_penalty_uses_every_choice_before_any_again(seed):
    chain = make_chain(seed)
    most = max(len(costs) for costs in chain.unary)
    found = diverse(chain, most, 1e6)
    if len(found) == most:
        for position, costs in enumerate(chain.unary):
            uses = np.bincount([row[position] for row in found], minlength=len(costs))
            assert uses.max() - uses.min() <= 1


def test_an_empty_row_has_one_way_through():
    empty = Trellis((), ())
    assert viterbi(empty).shape == (0,)
    assert [row.shape for row in k_best(empty, 3)] == [(0,)]
    assert sample(empty, 1.0, np.random.default_rng(0)).shape == (0,)
    assert [row.shape for row in diverse(empty, 2, 1.0)] == [(0,)]
