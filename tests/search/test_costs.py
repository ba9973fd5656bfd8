"""Properties of the cost model: lengths, seams, similarity and constraints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config
from mograft.constraints import Reach
from mograft.search.costs import (
    INFEASIBLE_PENALTY,
    ConstraintViolations,
    CostModel,
    SeamScales,
    SimilarityCostModel,
    length_fits,
)
from tests.strategies import SEEDS

ROBUST, PAPER = Config(), Config.paper()
SCALES = SeamScales(0.3, 2.0)


def test_length_fits_paper_rule_is_strict_and_relative_to_the_base():
    def fits(base, donor, config):
        return bool(length_fits(np.array(base), np.array(donor), 30.0, config))

    assert fits(20, 22, PAPER)
    assert not fits(20, 23, PAPER)  # 0.15 is not below 0.15
    assert fits(21, 18, PAPER)
    assert not fits(18, 21, PAPER)  # the same lengths with base and donor exchanged
    assert not fits(6, 7, PAPER)
    assert fits(6, 7, ROBUST)
    assert not fits(6, 8, ROBUST)
    assert fits(20, 23, ROBUST)


@given(st.integers(1, 500), st.integers(1, 500))
def test_length_fits_slack_allows_one_paper_frame_at_any_rate(base, donor):
    at_30 = length_fits(np.array(base), np.array(donor), 30.0, ROBUST)
    at_120 = length_fits(np.array(4 * base), np.array(4 * donor), 120.0, ROBUST)
    assert at_30 == at_120
    assert at_30 == (abs(base - donor) <= max(0.15 * base + 1e-9, 1))


@given(st.integers(1, 50), st.integers(1, 50), st.floats(0, 2), st.booleans())
def test_unary_weighted_costs_match_the_formula(base, donor, distance, is_base):
    config = Config(length_weight=2.0, distance_weight=0.5, novelty=1.5)
    lengths = np.array([base]), np.array([donor])
    costs = CostModel(config, SCALES).unary(*lengths, np.array([distance]), np.array([is_base]))
    expected = 2.0 * (1 - min(base, donor) / max(base, donor)) + 0.5 * distance
    assert costs[0] == pytest.approx(expected - (0.0 if is_base else 1.5))


def test_unary_similarity_costs_are_distances_and_a_penalty_for_the_base():
    model = SimilarityCostModel(ROBUST, SCALES)
    lengths = np.array([4, 4])
    costs = model.unary(lengths, lengths, np.array([0.7, 0.0]), np.array([False, True]))
    assert costs.tolist() == [0.7, INFEASIBLE_PENALTY]


@pytest.mark.parametrize("model", [CostModel, SimilarityCostModel])
def test_pairwise_penalty_applies_above_the_limit_only(model):
    config = Config(max_angle=0.5)
    angles, velocities = np.array([0.0, 0.5, 0.5000001]), np.array([0.0, 1.0, 1.0])
    costs = model(config, SCALES).pairwise(angles, velocities)
    assert (costs >= INFEASIBLE_PENALTY).tolist() == [False, False, True]
    gaps = (angles / 0.3) ** 2 + (velocities / 2.0) ** 2
    rest = np.zeros(3) if model is SimilarityCostModel else gaps
    np.testing.assert_allclose(costs - [0.0, 0.0, INFEASIBLE_PENALTY], rest, atol=1e-9)


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


@given(st.floats(1e-6, 1.0), st.floats(0.0, 0.5), st.floats(0.0, 1e3))
def test_two_seams_within_the_limits_cost_less_than_half_a_violated_limit(scale, angle, velocity):
    model = CostModel(Config(max_angle=0.5), SeamScales(scale, scale))
    costs = model.pairwise(np.array([angle]), np.array([velocity]))
    assert 2 * costs[0] < INFEASIBLE_PENALTY / 2
    squares = (angle / scale) ** 2 + (velocity / scale) ** 2
    assert costs[0] == pytest.approx(min(squares, INFEASIBLE_PENALTY / 8))


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
