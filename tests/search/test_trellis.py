"""Trellises of donors, and the searches through them, checked against all enumerated paths."""

import math
from itertools import islice, pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.donor_choice import cost_model
from mograft.search.trellis import DonorTrellis, Trellis, diverse, k_best, sample, viterbi
from tests.oracles import balance as balance_oracle
from tests.oracles import search as oracle
from tests.strategies import SEEDS, few_examples


def build(pool, config):
    scenario = np.arange(len(pool.segments))
    lists = pool.candidate_lists(scenario, config)
    return DonorTrellis.build(pool, scenario, lists, cost_model(config, pool))


@few_examples(20)
@given(SEEDS, st.sampled_from([1, 3, 100]))
def test_trellis_costs_match_the_formula_and_keep_the_cheapest(make_pool, seed, most):
    pool = make_pool(seed)
    weights = {"length_weight": 2.0, "distance_weight": 0.5, "novelty": 1.5}
    config = Config(max_stretch=2.0, max_candidates=most, max_angle=0.5, **weights)
    trellis = build(pool, config)
    lengths, scales = pool.segments.lengths, cost_model(config, pool).scales
    lists = pool.candidate_lists(trellis.scenario, config)

    def unary(i, k):
        ratio = min(lengths[i], lengths[k]) / max(lengths[i], lengths[k])
        distance = np.linalg.norm(pool.points[i] - pool.points[k]) / pool.sigma
        offsets = pool.balance.mass_offsets([[i], [k]])
        shift = balance_oracle.zero_moment_shifts(*offsets, np.array([lengths[i] / pool.rate]))
        margins = pool.balance.support_margins([i])
        added = balance_oracle.added_imbalances(shift, margins, np.array([0]))[0]
        if i == k:
            return 0.0
        ends = pool.boundary.first, pool.boundary.last
        angle = np.mean([oracle.seam_angle(end[i], end[k]) for end in ends])
        novelty = 1.5 * (1 + min(1, np.degrees(angle) / 5)) / 2
        return 2 * (1 - ratio) + 0.5 * distance + config.balance_weight * added - novelty

    for i, (kept, costs) in enumerate(zip(trellis.candidates, trellis.costs.unary, strict=True)):
        np.testing.assert_allclose(costs, [unary(i, k) for k in kept], atol=1e-12)
        dropped = np.setdiff1d(lists[i], kept)
        assert i in kept
        assert len(kept) == min(most, len(lists[i]))
        others = [unary(i, k) for k in kept if k != i]
        assert all(unary(i, k) >= max(others, default=-np.inf) - 1e-12 for k in dropped)
    boundary = pool.boundary
    for p, costs in enumerate(trellis.costs.pairwise):
        for a, left in enumerate(trellis.candidates[p]):
            for b, right in enumerate(trellis.candidates[p + 1]):
                angle = oracle.seam_angle(boundary.last[left], boundary.first[right])
                jump = boundary.last_velocity[left] - boundary.first_velocity[right]
                expected = (angle / scales.angle) ** 2
                expected += (np.linalg.norm(jump, axis=1).mean() / scales.velocity) ** 2
                expected += INFEASIBLE_PENALTY * (angle > 0.5)
                assert costs[a, b] == pytest.approx(expected, abs=1e-9)


def make_trellis(seed, *, is_integer=False, forbidden=0.0, n_positions=None):
    """Return a trellis of up to five positions with up to four candidates each."""
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 6) if n_positions is None else n_positions
    counts = rng.integers(1, 5, n)

    def costs(shape):
        # Integers sum exactly, and ties are frequent.
        values = rng.integers(-2, 4, shape).astype(float) if is_integer else rng.normal(size=shape)
        return np.where(rng.random(shape) < forbidden, math.inf, values)

    unary = tuple(costs(count) for count in counts)
    return Trellis(unary, tuple(costs(pair) for pair in pairwise(counts)))


def path_cost(trellis, path):
    total = sum(costs[index] for costs, index in zip(trellis.unary, path, strict=True))
    pairs = zip(trellis.pairwise, pairwise(path), strict=True)
    return total + sum(costs[i, j] for costs, (i, j) in pairs)


def all_paths(trellis):
    """Return every path, the cheapest first, ties in lexicographic order."""
    paths = product(*(range(len(costs)) for costs in trellis.unary))
    return sorted(paths, key=lambda path: (path_cost(trellis, path), path))


@given(SEEDS, st.booleans(), st.sampled_from([0.0, 0.3]))
def test_viterbi_returns_the_first_cheapest_path(seed, is_integer, forbidden):
    trellis = make_trellis(seed, is_integer=is_integer, forbidden=forbidden)
    cheapest = all_paths(trellis)[0]
    path = viterbi(trellis)
    assert path_cost(trellis, path) == pytest.approx(path_cost(trellis, cheapest), abs=1e-12)
    if is_integer and math.isfinite(path_cost(trellis, cheapest)):
        assert tuple(path) == cheapest


@few_examples(20)
@given(SEEDS, st.integers(1, 60), st.booleans(), st.sampled_from([0.0, 0.3]))
def test_k_best_returns_the_cheapest_paths_in_order(seed, count, is_integer, forbidden):
    trellis = make_trellis(seed, is_integer=is_integer, forbidden=forbidden)
    finite = [path for path in all_paths(trellis) if math.isfinite(path_cost(trellis, path))]
    expected = finite[:count]
    paths = k_best(trellis, count)
    assert len(paths) == len(expected) == len({path.tobytes() for path in paths})
    costs = [path_cost(trellis, path) for path in paths]
    np.testing.assert_allclose(costs, [path_cost(trellis, p) for p in expected], atol=1e-12)
    assert all(a <= b + 1e-12 for a, b in pairwise(costs))
    if is_integer:
        assert [tuple(path) for path in paths] == expected


@given(SEEDS, st.sampled_from([0.3, 1.0, 5.0]))
def test_sample_matches_the_oracle(seed, temperature):
    trellis = make_trellis(seed)
    draws = np.random.default_rng(seed).random(len(trellis))
    path = sample(trellis, temperature, np.random.default_rng(seed))
    expected = oracle.sampled_sequence(trellis.unary, trellis.pairwise, temperature, draws)
    np.testing.assert_array_equal(path, expected)


def test_sample_costs_that_overflow_as_weights_keep_their_probabilities():
    unary = (np.array([1e5, 1e5 + 1.0]), np.array([-1e5, math.inf]))
    trellis = Trellis(unary, (np.zeros((2, 2)),))
    rng = np.random.default_rng(0)
    draws = [tuple(sample(trellis, 1.0, rng)) for _ in range(2000)]
    share = draws.count((0, 0)) / len(draws)
    assert set(draws) == {(0, 0), (1, 0)}
    assert share == pytest.approx(1 / (1 + math.exp(-1)), abs=0.04)


def charges(trellis, penalty):
    """Return the function that charges `penalty` for the candidates on a path."""
    counts = [len(own) for own in trellis.unary]
    return lambda path: [penalty * (np.arange(n) == i) for n, i in zip(counts, path, strict=True)]


@given(SEEDS, st.integers(1, 30), st.sampled_from([0.0, 0.5, 100.0]))
def test_diverse_paths_differ_and_start_with_the_cheapest(seed, count, penalty):
    trellis = make_trellis(seed)
    before = [own.copy() for own in trellis.unary]
    paths = list(islice(diverse(trellis, charges(trellis, penalty)), count))
    for own, unchanged in zip(trellis.unary, before, strict=True):
        np.testing.assert_array_equal(own, unchanged)
    assert len(paths) == min(count, len(all_paths(trellis)))
    assert len({path.tobytes() for path in paths}) == len(paths)
    np.testing.assert_array_equal(paths[0], viterbi(trellis))
    if penalty == 0.0:
        costs = [path_cost(trellis, path) for path in paths]
        expected = [path_cost(trellis, path) for path in all_paths(trellis)[: len(paths)]]
        np.testing.assert_allclose(costs, expected, atol=1e-12)


@given(SEEDS, st.data())
def test_slice_within_costs_differ_from_the_whole_path_by_a_constant(seed, data):
    trellis = make_trellis(seed, n_positions=6)
    path = np.array([data.draw(st.integers(0, len(own) - 1)) for own in trellis.unary])
    start = data.draw(st.integers(0, 5))
    stop = data.draw(st.integers(start + 1, 6))
    window = trellis.slice_within(path, start, stop)
    differences = []
    for inner in all_paths(window):
        whole = path.copy()
        whole[start:stop] = inner
        differences.append(path_cost(trellis, whole) - path_cost(window, inner))
    np.testing.assert_allclose(differences, differences[0], atol=1e-9)
