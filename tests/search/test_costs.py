"""Properties of the cost model: lengths, seams, similarity and constraints."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mograft import Config
from mograft.constraints import Reach
from mograft.search.costs import (
    INFEASIBLE_PENALTY,
    ConstraintViolations,
    CostModel,
    SeamScales,
    length_fits,
)
from mograft.search.donor_choice import DONOR_CHOICES
from tests.strategies import SEEDS

ROBUST = Config()
SCALES = SeamScales(0.3, 2.0)


@given(st.integers(1, 500), st.integers(1, 500), st.floats(0.01, 0.5))
@example(20, 23, 0.15)  # a difference of exactly the limit
@example(18, 21, 0.15)
def test_length_fits_is_relative_to_the_base_and_strict_without_slack(base, donor, stretch):
    """The slack is one frame of the paper's rate."""
    strict, config = (Config(max_stretch=stretch, length_slack=own) for own in (0.0, 1 / 30))
    gap, limit = abs(base - donor), stretch * base
    lengths = np.array(base), np.array(donor)
    assert length_fits(*lengths, 30.0, strict) == (gap < limit * (1 - 1e-9))
    fits = gap <= max(limit + 1e-9 * base, 1)
    assert length_fits(*lengths, 30.0, config) == fits
    assert length_fits(*(4 * own for own in lengths), 120.0, config) == fits


def test_unary_similarity_costs_are_distances_and_a_penalty_for_the_base():
    model = DONOR_CHOICES["nearest"].cost_model(ROBUST, SCALES)
    lengths, longer = np.array([4, 4]), np.array([7, 4])
    costs = model.unary(lengths, longer, np.array([0.7, 0.0]), np.array([False, True]))
    assert costs.tolist() == [0.7, INFEASIBLE_PENALTY]
    for other in (model.balance, model.similarity):
        assert other(np.array([0.0, 0.3])).tolist() == [0.0, 0.0]


@given(SEEDS, st.lists(st.integers(0, 12), min_size=1, max_size=8), st.integers(1, 4))
def test_keep_cheapest_of_each_is_keep_cheapest_at_each_position(seed, counts, factor):
    rng = np.random.default_rng(seed)
    model, scenario = CostModel(Config(max_candidates=2), SCALES), rng.integers(0, 12, len(counts))
    candidates = [np.sort(rng.permutation(12)[:count]) for count in counts]
    costs = [rng.choice([-np.inf, -0.5, -0.0, 0.0, 1.0, np.inf], count) for count in counts]
    joined = np.concatenate(costs)
    kept, kept_costs = model.keep_cheapest_of_each(scenario, candidates, joined, factor)
    assert len(kept) == len(kept_costs) == len(counts)
    for position, (segments, own) in enumerate(zip(candidates, costs, strict=True)):
        order = np.lexsort((own, segments != scenario[position]))[: 2 * factor]
        order.sort()
        np.testing.assert_array_equal(kept[position], segments[order])
        np.testing.assert_array_equal(kept_costs[position], own[order])
        is_base = segments == scenario[position]
        np.testing.assert_array_equal(model.keep_cheapest(own, is_base, factor), order)


@given(st.floats(1e-6, 1.0), st.just(0.5) | st.floats(0.0, 1.0), st.floats(0.0, 1e3))
def test_pairwise_costs_are_squares_up_to_a_limit_and_penalties_above_max_angle(
    scale, angle, velocity
):
    """Two seams within the limit cost less than half a violated limit."""
    arguments = Config(max_angle=0.5), SeamScales(scale, scale)
    nearest = DONOR_CHOICES["nearest"].cost_model(*arguments)
    squares = min((angle / scale) ** 2 + (velocity / scale) ** 2, INFEASIBLE_PENALTY / 8)
    penalty = INFEASIBLE_PENALTY * (angle > 0.5)
    for model, expected in ((CostModel(*arguments), squares), (nearest, 0.0)):
        costs = model.pairwise(np.array([angle]), np.array([velocity]))
        assert costs[0] == pytest.approx(expected + penalty)


@pytest.mark.parametrize("gap", [0.0, 1e-15, np.inf])
def test_seam_scales_without_typical_gaps_are_the_configured_ones(gap):
    scales = SeamScales.from_typical_gaps(gap, gap, ROBUST)
    assert scales == SeamScales(ROBUST.angle_scale, ROBUST.velocity_scale)


def test_constraint_costs_are_one_penalty_for_the_greatest_hard_amount_and_all_soft_squares():
    hard, soft = Reach("a", (0, 0, 0), 0), Reach("a", (0, 0, 0), 0, weight=0.5)
    amounts = [np.array([2.0, 0.5]), np.array([3.0, 1.0]), np.array([3.0, 2.0])]
    found = ConstraintViolations.from_amounts([hard, hard, soft], amounts, 2)
    assert found.is_feasible.tolist() == [False, True]
    assert found.costs().tolist() == [4 * INFEASIBLE_PENALTY + 4.5, 2.0]
    assert ConstraintViolations.from_amounts([], [], 2).costs().tolist() == [0.0, 0.0]


def test_constraint_costs_of_nan_are_0_but_the_candidate_is_not_feasible():
    """One NaN in a cost would change the donors of all positions."""
    hard = Reach("a", (0, 0, 0), 0)
    found = ConstraintViolations.from_amounts([hard], [np.array([np.nan, np.inf, 0.5])], 3)
    assert found.costs().tolist() == [0.0, np.inf, 0.0]
    assert found.is_feasible.tolist() == [False, False, True]
