"""Properties of the strategies that choose donor sequences."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from mograft import Config
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.donor_choice import (
    DONOR_CHOICES,
    charges,
    cost_model,
    draw_uniform,
    interleaved_combinations,
    prune_dead_ends,
    unique_sequences,
)
from mograft.search.trellis import DonorTrellis, Trellis
from tests.oracles import search as oracle
from tests.strategies import SEEDS, few_examples

ROBUST = Config()


@dataclass
class Source:
    """Candidates of one or more groups without constraints."""

    pools: dict
    config: Config

    @property
    def scenario(self):
        return np.arange(len(next(iter(self.pools.values())).segments))

    @property
    def trellises(self):
        return {
            group: DonorTrellis.build(
                pool, self.scenario, self.feasible_candidates(group), cost_model(self.config, pool)
            )
            for group, pool in self.pools.items()
        }

    def feasible_candidates(self, group):
        return self.pools[group].candidate_lists(self.scenario, self.config)


@few_examples(30)
@pytest.mark.parametrize("name", tuple(DONOR_CHOICES))
@given(SEEDS, st.integers(1, 8), st.sampled_from([3, 12]))
def test_draw_returns_different_sequences_of_candidates(make_pool, name, seed, count, n):
    """By cost, only the first may be the captured one."""
    config = Config(choice=name, max_stretch=2.0, novelty=0.0, temperature=5.0)
    pools = {"arms": make_pool(seed, n, n_labels=2), "head": make_pool(seed + 1, n, n_labels=2)}
    source = Source(pools, config)
    drawn = DONOR_CHOICES[name].draw(source, count, np.random.default_rng(seed))
    assert 1 <= len(drawn) <= count
    assert len(unique_sequences(drawn)) == len(drawn)
    for donors in drawn:
        assert list(donors) == ["arms", "head"]
        for group, sequence in donors.items():
            lists = source.feasible_candidates(group)
            assert all(donor in own for donor, own in zip(sequence, lists, strict=True))
    if name != "random":
        for donors in drawn[1:]:
            assert any((own != source.scenario).any() for own in donors.values())


@few_examples(20)
@pytest.mark.parametrize("name", ["sample", "viterbi", "nearest"])
@given(SEEDS, st.floats(0.0, 5.0))
def test_draw_diversity_changes_only_later_motions(make_pool, name, seed, diversity):
    pools = {"upper": make_pool(seed, n_labels=1)}
    config = Config(choice=name, diversity=diversity, max_stretch=2.0)
    draw = DONOR_CHOICES[name].draw
    drawn, shorter, indifferent = (
        draw(Source(pools, own), count, np.random.default_rng(seed))
        for own, count in ((config, 5), (config, 3), (replace(config, diversity=0.0), 1))
    )
    np.testing.assert_array_equal(drawn[0]["upper"], indifferent[0]["upper"])
    for one, other in zip(drawn, shorter, strict=False):
        np.testing.assert_array_equal(one["upper"], other["upper"])


@given(SEEDS, st.floats(0.0, 5.0))
def test_charges_fall_with_pose_difference_and_are_full_for_the_base(make_pool, seed, diversity):
    pool = make_pool(seed, n_labels=1)
    config = Config(diversity=diversity, max_stretch=2.0)
    trellis = Source({"upper": pool}, config).trellises["upper"]
    rng = np.random.default_rng(seed)
    path = np.array([rng.integers(len(own)) for own in trellis.candidates])
    ends = pool.boundary.first, pool.boundary.last
    for base, (index, own, found) in enumerate(
        zip(path, trellis.candidates, charges(pool, trellis, config)(path), strict=True)
    ):
        angles = [
            np.mean([oracle.seam_angle(end[own[index]], end[k]) for end in ends]) for k in own
        ]
        expected = [
            diversity * (k == base or max(1 - np.degrees(angle) / 20, 0))
            for k, angle in zip(own, angles, strict=True)
        ]
        np.testing.assert_allclose(found, expected, atol=1e-6)


@few_examples(40)
@given(SEEDS, st.floats(5.0, 50.0))
def test_draw_sample_almost_without_chance_charges_donors_as_viterbi(make_pool, seed, diversity):
    pools = {"arms": make_pool(seed, n_labels=1)}
    limits = {"max_stretch": 2.0, "max_angle": np.pi}
    config = Config(choice="sample", diversity=diversity, temperature=1e-6, **limits)
    drawn, expected = (
        DONOR_CHOICES[name].draw(Source(pools, config), 4, np.random.default_rng(seed))
        for name in ("sample", "viterbi")
    )
    assert len(drawn) > 1
    for one, other in zip(drawn, expected, strict=False):
        np.testing.assert_array_equal(one["arms"], other["arms"])


def test_choose_path_random_ignores_costs_and_avoids_penalties():
    infeasible = INFEASIBLE_PENALTY * 3
    trellis = Trellis((np.array([0.0, 5.0, infeasible]), np.zeros(1)), (np.zeros((3, 1)),))
    rng, choice = np.random.default_rng(0), DONOR_CHOICES["random"]
    counts = np.zeros(3, int)
    for _ in range(600):
        counts[choice.choose_path(trellis, ROBUST, rng)[0]] += 1
    assert counts[2] == 0
    assert chisquare(counts[:2]).pvalue > 1e-6


@few_examples(20)
@given(SEEDS)
def test_draw_uniform_takes_each_donor_from_those_that_reach_the_end_within_max_angle(
    make_pool, seed
):
    config = Config(neighbourhood="cluster", max_angle=0.6, max_stretch=2.0)
    pool = make_pool(seed, n_labels=2)
    lists = pool.candidate_lists(np.arange(len(pool.segments)), config)
    kept, angles = prune_dead_ends(pool, lists, config)
    np.testing.assert_array_equal(kept[-1], lists[-1])
    for own, left, right, found in zip(lists, kept, kept[1:], angles, strict=False):
        seams = pool.seam_angles(own, right)
        can_continue = (seams <= 0.6).any(axis=1)
        np.testing.assert_array_equal(left, own[can_continue] if can_continue.any() else own)
        np.testing.assert_array_equal(found, seams[np.isin(own, left)])
    draws, rng = np.random.default_rng(seed), np.random.default_rng(seed)
    donors = draw_uniform(kept, angles, config, draws)
    index = rng.integers(len(kept[0]))
    assert donors[0] == kept[0][index]
    for own, matrix, donor in zip(kept[1:], angles, donors[1:], strict=True):
        within = np.flatnonzero(matrix[index] <= 0.6)
        index = rng.choice(within) if len(within) else matrix[index].argmin()
        assert donor == own[index]


def test_interleaved_combinations_advance_all_lists_then_enumerate_the_rest():
    assert interleaved_combinations([3, 2], 5) == [(0, 0), (1, 1), (2, 0), (0, 1), (1, 0)]
    assert len(interleaved_combinations([3, 2], 99)) == 6
