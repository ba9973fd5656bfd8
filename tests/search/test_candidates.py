"""Laws of candidates, limits and the random choice."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from mograft import Config, Segments
from mograft.search.candidates import (
    INFEASIBLE_PENALTY,
    DonorTrellis,
    SegmentPool,
    choose,
    count_combinations,
    length_fits,
    pose_gaps,
    reachable,
    velocity_gaps,
)
from mograft.search.viterbi import viterbi
from tests.oracles import pipeline as plain
from tests.strategies import SEEDS, quaternions, wander

ROBUST, PAPER = Config(), Config.paper()


def make_pool(seed, n=12, n_labels=3, spread=0.5):
    """Segments of one clip with random lengths, labels and poses."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 12, n)
    stops = np.cumsum(lengths)
    poses = wander(rng, n + 1, 3, speed=spread)
    speeds = rng.normal(size=(n + 1, 3, 3))
    return SegmentPool(
        Segments(stops - lengths, stops),
        rng.integers(0, n_labels, n),
        np.ones(n, bool),
        poses[:-1],
        poses[1:],
        30.0,
        speeds[:-1],
        speeds[1:],
        rng.normal(size=(n, 4)),
        2.0,
    )


def test_the_length_rule_is_strict_and_measured_by_the_base():
    def fits(base, donor, config):
        return bool(length_fits(np.array(base), np.array(donor), 30.0, config))

    assert fits(20, 22, PAPER)
    assert not fits(20, 23, PAPER)  # 0.15 is not below 0.15
    assert fits(21, 18, PAPER)
    assert not fits(18, 21, PAPER)  # the same two the other way round
    assert not fits(6, 7, PAPER)
    assert fits(6, 7, ROBUST)
    assert not fits(6, 8, ROBUST)
    assert fits(20, 23, ROBUST)


@given(st.integers(1, 500), st.integers(1, 500))
def test_the_slack_allows_a_frame_at_any_rate_and_nothing_less(base, donor):
    at_30 = length_fits(np.array(base), np.array(donor), 30.0, ROBUST)
    at_120 = length_fits(np.array(4 * base), np.array(4 * donor), 120.0, ROBUST)
    assert at_30 == at_120
    assert at_30 == (abs(base - donor) <= max(0.15 * base + 1e-9, 1))


@given(SEEDS, st.sampled_from((ROBUST, PAPER)))
def test_candidates_are_those_of_the_plain_version(seed, config):
    pool = make_pool(seed)
    expected = plain.candidates(pool.labels, pool.segments.lengths, 30.0, config)
    for segment in range(len(pool.segments)):
        found = pool.candidates(segment, config)
        np.testing.assert_array_equal(found, expected[segment])
        assert segment in found
    scenario = np.random.default_rng(seed).integers(0, len(pool.segments), 20)
    for segment, found in zip(scenario, pool.candidate_lists(scenario, config), strict=True):
        np.testing.assert_array_equal(found, expected[segment])


@given(SEEDS, st.sampled_from([1, 3, 100]))
def test_rows_cost_what_the_formula_says(seed, most):
    pool = make_pool(seed)
    config = Config(max_stretch=2.0, max_candidates=most, max_angle=0.5)
    scenario = np.arange(len(pool.segments))
    row = DonorTrellis.build(pool, scenario, pool.candidate_lists(scenario, config), config)
    lengths, scaled = pool.segments.lengths, pool.scale_config(config)

    def alone(i, k):
        ratio = min(lengths[i], lengths[k]) / max(lengths[i], lengths[k])
        apart = np.linalg.norm(pool.points[i] - pool.points[k]) / pool.sigma
        return 1 - ratio + 0.25 * apart - config.novelty * (i != k)

    for i, (own, costs) in enumerate(zip(row.candidates, row.costs.unary, strict=True)):
        np.testing.assert_allclose(costs, [alone(i, k) for k in own], atol=1e-12)
        everyone = pool.candidates(i, config)
        dropped = np.setdiff1d(everyone, own)
        assert i in own
        assert len(own) == min(most, len(everyone))
        kept = [alone(i, k) for k in own if k != i]
        assert all(alone(i, k) >= max(kept, default=-np.inf) - 1e-12 for k in dropped)
    for p, costs in enumerate(row.costs.pairwise):
        for a, left in enumerate(row.candidates[p]):
            for b, right in enumerate(row.candidates[p + 1]):
                angle = plain.gap(pool.last[left], pool.first[right])
                speed = np.linalg.norm(
                    pool.last_velocity[left] - pool.first_velocity[right], axis=1
                )
                expected = (angle / scaled.angle_scale) ** 2
                expected += (speed.mean() / scaled.velocity_scale) ** 2
                expected += INFEASIBLE_PENALTY * (angle > 0.5)
                assert costs[a, b] == pytest.approx(expected, abs=1e-9)
    np.testing.assert_array_equal(
        row.path(row.donor_sequence(viterbi(row.costs))), viterbi(row.costs)
    )


def plain_typical_gaps(pool):
    """Between the next member of each cluster, around it, and the next of its neighbour's."""

    def mate(i):
        same = (pool.labels == pool.labels[i]) & pool.is_donor
        members = [int(k) for k in np.flatnonzero(same)]
        return members[(members.index(i) + 1) % len(members)]

    angles, speeds = [], []
    for i in range(len(pool.segments) - 1):
        if not pool.is_donor[i : i + 2].all():
            continue
        left, right = mate(i), mate(i + 1)
        if (left, right) != (i, i + 1):
            angles.append(plain.gap(pool.last[left], pool.first[right]))
            jump = pool.last_velocity[left] - pool.first_velocity[right]
            speeds.append(np.linalg.norm(jump, axis=1).mean())
    return (np.mean(angles), np.mean(speeds)) if angles else (np.inf, np.inf)


@given(SEEDS, st.integers(1, 12), st.floats(0.01, 3.0))
def test_seams_are_measured_by_what_is_typical_where_that_is_little(seed, n_labels, size):
    pool = make_pool(seed, n_labels=n_labels)
    small = replace(
        pool,
        first_velocity=size * pool.first_velocity,
        last_velocity=size * pool.last_velocity,
        is_donor=np.random.default_rng(seed).random(12) < 0.8,
    )
    angle, speed = plain_typical_gaps(small)
    np.testing.assert_allclose(small.typical_gaps, (angle, speed), atol=1e-9)
    scaled = small.scale_config(ROBUST)
    assert scaled.angle_scale == pytest.approx(min(np.radians(20), 2 * angle))
    assert scaled.velocity_scale == pytest.approx(min(np.radians(200), 2 * speed))


@given(SEEDS)
def test_motions_that_hardly_move_are_chosen_as_if_they_moved_more(seed):
    """All angles and speeds a tenth: seams cost the same where both are below the scales."""
    rng = np.random.default_rng(seed)
    pool = make_pool(seed)
    angles, speeds = rng.uniform(-0.1, 0.1, (13, 3)), rng.uniform(-0.5, 0.5, (13, 3, 1))

    def turned(by):
        quats = np.stack([np.sin(by * angles / 2), np.cos(by * angles / 2)], axis=-1)
        quats = np.concatenate([np.zeros((13, 3, 2)), quats], axis=-1)
        moving = by * speeds * [0.0, 0.0, 1.0]
        return replace(
            pool,
            first=quats[:-1],
            last=quats[1:],
            first_velocity=moving[:-1],
            last_velocity=moving[1:],
        )

    scenario = np.arange(12)
    lists = pool.candidate_lists(scenario, ROBUST)
    rows = [DonorTrellis.build(turned(by), scenario, lists, ROBUST) for by in (1.0, 0.1)]
    for more, less in zip(*(row.costs.pairwise for row in rows), strict=True):
        np.testing.assert_allclose(more, less, rtol=1e-6, atol=1e-9)


@given(SEEDS)
def test_the_cheapest_row_keeps_the_transition_limit_and_its_seams_are_no_worse(seed):
    pool = make_pool(seed, n_labels=2)
    config = Config(max_angle=0.4, max_stretch=2.0, novelty=0.0, distance_weight=0.0)
    scenario = np.arange(len(pool.segments))
    row = DonorTrellis.build(pool, scenario, pool.candidate_lists(scenario, config), config)
    donors = row.donor_sequence(viterbi(row.costs))
    assert (np.diag(pool.seam_angles(donors[:-1], donors[1:])) <= 0.4).all()
    # Nothing is gained by an exchange, so that nothing is exchanged.
    assert row.costs.cost(viterbi(row.costs)) == pytest.approx(0.0, abs=1e-12)


@given(SEEDS)
def test_the_nearest_are_others_wherever_there_are_others(seed):
    pool = make_pool(seed, n_labels=4)
    config = Config(choice="nearest", max_stretch=2.0, max_angle=np.pi)
    scenario = np.arange(len(pool.segments))
    lists = pool.candidate_lists(scenario, config)
    row = DonorTrellis.build(pool, scenario, lists, config)
    for i, (own, donor) in enumerate(
        zip(lists, row.donor_sequence(viterbi(row.costs)), strict=True)
    ):
        others = own[own != i]
        if len(others):
            apart = np.linalg.norm(pool.points[others] - pool.points[i], axis=1)
            assert donor == others[apart.argmin()]
        else:
            assert donor == i


@given(SEEDS)
def test_without_limits_candidates_are_the_cluster_and_combinations_its_powers(seed):
    pool = make_pool(seed)
    free = Config(max_stretch=1e6)
    found = [set(pool.candidates(i, free).tolist()) for i in range(len(pool.segments))]
    for i, own in enumerate(found):
        assert own == set(np.flatnonzero(pool.labels == pool.labels[i]).tolist())
    for n_groups in (2, 3, 4):
        brute = sum(1 for own in found for _ in product(own, repeat=n_groups - 1))
        assert count_combinations(pool.labels, n_groups) == brute


def test_combinations_are_exact_beyond_floats():
    assert count_combinations(np.zeros(10_000, int), 5) == 10_000**5


@given(SEEDS)
def test_spoiled_segments_lend_nothing_but_keep_their_own(seed):
    pool = make_pool(seed, n_labels=1)
    pool.is_donor[4] = False
    for segment in range(len(pool.segments)):
        assert (4 in pool.candidates(segment, ROBUST)) == (segment == 4)


@given(quaternions((3, 2)), quaternions((4, 2)))
def test_pose_gaps_are_mean_angles(ends, starts):
    gaps = pose_gaps(ends, starts)
    expected = [[plain.gap(end, start) for start in starts] for end in ends]
    np.testing.assert_allclose(gaps, expected, atol=1e-9)
    np.testing.assert_allclose(pose_gaps(starts, ends), gaps.T, atol=1e-12)


def test_velocity_gaps_are_mean_lengths_of_differences():
    rng = np.random.default_rng(0)
    ends, starts = rng.normal(size=(4, 2, 3)), rng.normal(size=(3, 2, 3))
    expected = np.linalg.norm(ends[:, None] - starts, axis=-1).mean(axis=-1)
    np.testing.assert_allclose(velocity_gaps(ends, starts), expected, atol=1e-12)


@given(SEEDS)
def test_neighbours_in_a_clip_have_no_gap(seed):
    pool = make_pool(seed)
    n = len(pool.segments)
    gaps = pool.seam_angles(np.arange(n - 1), np.arange(1, n))
    np.testing.assert_allclose(np.diag(gaps), 0.0, atol=1e-15)
    speeds = pool.seam_velocity_gaps(np.arange(n - 1), np.arange(1, n))
    np.testing.assert_array_equal(np.diag(speeds), 0.0)


@given(SEEDS, st.floats(0.05, 1.0))
def test_whoever_is_chosen_keeps_the_limit_and_the_cluster(seed, limit):
    pool = make_pool(seed, n_labels=2)
    config = Config(max_angle=limit, max_stretch=2.0)
    positions = [pool.candidates(i, config) for i in range(len(pool.segments))]
    alive, gaps = reachable(pool, positions, config)
    for own, all_of_them in zip(alive, positions, strict=True):
        assert set(own) <= set(all_of_them)
    chosen = choose(alive, gaps, config, np.random.default_rng(seed))
    np.testing.assert_array_equal(pool.labels[chosen], pool.labels)
    # From any start there is a way on, for the original follows the original without a gap.
    met = np.diag(pool.seam_angles(chosen[:-1], chosen[1:]))
    assert (met <= limit).all()


@given(SEEDS)
def test_the_choice_is_that_of_the_plain_version(seed):
    pool = make_pool(seed, n_labels=2)
    config = Config(max_angle=0.6, max_stretch=2.0)
    bounds = np.array([*pool.segments.start, pool.segments.stop[-1]])
    quats = np.zeros((bounds[-1] + 1, 3, 4))
    quats[bounds] = np.concatenate([pool.first, pool.last[-1:]])
    found = plain.candidates(pool.labels, pool.segments.lengths, 30.0, config)
    expected = plain.choose(quats, bounds, found, config, np.random.default_rng(seed))
    positions = [pool.candidates(i, config) for i in range(len(pool.segments))]
    alive, gaps = reachable(pool, positions, config)
    chosen = choose(alive, gaps, config, np.random.default_rng(seed))
    np.testing.assert_array_equal(chosen, expected)


def test_all_that_pass_are_chosen_alike():
    pool = make_pool(5, n=6, n_labels=1, spread=0.01)
    config = Config(max_stretch=100.0)
    positions = [pool.candidates(i, config) for i in range(6)]
    alive, gaps = reachable(pool, positions, config)
    rng = np.random.default_rng(0)
    draws = np.array([choose(alive, gaps, config, rng) for _ in range(3000)])
    for column in draws.T:
        assert chisquare(np.bincount(column, minlength=6)).pvalue > 1e-6


@given(SEEDS)
def test_every_refusal_names_the_limit_that_it_misses(seed):
    pool = make_pool(seed)
    config = Config(max_angle=0.3)
    for segment in range(len(pool.segments)):
        judged = pool.judge(segment, None, config)
        assert judged.allowed[0].segment == segment
        allowed = {c.segment for c in judged.allowed}
        by_length = set(pool.candidates(segment, config).tolist())
        assert allowed <= by_length
        for candidate in judged.refused:
            wide = max(candidate.gap_before, candidate.gap_after) > 0.3
            assert ("seam" in candidate.refused) == wide
            assert ("length" in candidate.refused) == (candidate.segment not in by_length)
        total = len(judged.allowed) + len(judged.refused) + judged.elsewhere
        assert total == len(pool.segments)


def test_a_candidates_cost_is_that_of_the_row_with_its_neighbours():
    pool = make_pool(4, n_labels=1)
    config = Config(max_stretch=5.0, max_angle=3.0)
    judged = pool.judge(5, None, config)
    scenario = np.arange(len(pool.segments))
    row = DonorTrellis.build(pool, scenario, pool.candidate_lists(scenario, config), config)
    for candidate in judged.allowed:
        donors = scenario.copy()
        donors[5] = candidate.segment
        assert candidate.cost == pytest.approx(row.costs.cost(row.path(donors)))
    gaps = pool.seam_angles_along(donors)
    np.testing.assert_array_equal(gaps, np.diag(pool.seam_angles(donors[:-1], donors[1:])))


def test_a_lone_segment_has_itself():
    pool = make_pool(0, n=1)
    alive, gaps = reachable(pool, [pool.candidates(0, ROBUST)], ROBUST)
    assert choose(alive, gaps, ROBUST, np.random.default_rng(0)).tolist() == [0]
    assert len(pool.judge(0, None, ROBUST)) == 1
    with pytest.raises(IndexError):
        pool.judge(1, None, ROBUST)
