"""Properties of trellises of donors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.donor_choice import cost_model
from mograft.search.trellis import DonorTrellis
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
