"""Properties of candidate generation and listing."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import Config
from mograft.dancer import dance
from mograft.search.candidates import count_combinations, list_candidates
from mograft.search.donor_choice import cost_model
from mograft.search.trellis import DonorTrellis
from mograft.synthesis.donor_trellis import build_trellis
from mograft.synthesis.search_problem import SearchProblem
from tests.oracles import search as oracle
from tests.strategies import SEEDS, few_examples

ROBUST, PAPER = Config(), Config.paper()
CHOICES = ("viterbi", "best", "sample", "nearest", "random")


def list_segment(pool, segment, config):
    return list_candidates(pool, segment, cost_model(config, pool))


@given(SEEDS, st.sampled_from((ROBUST, PAPER)))
def test_candidate_lists_match_the_oracle(make_pool, seed, config):
    pool = make_pool(seed)
    expected = oracle.candidates(pool.labels, pool.segments.lengths, 30.0, config)
    scenario = np.random.default_rng(seed).integers(0, len(pool.segments), 20)
    for base, found in zip(scenario, pool.candidate_lists(scenario, config), strict=True):
        np.testing.assert_array_equal(found, expected[base])
        assert base in found


@given(SEEDS)
def test_candidate_lists_without_length_limit_are_the_clusters(make_pool, seed):
    pool = make_pool(seed)
    everyone = np.arange(len(pool.segments))
    lists = pool.candidate_lists(everyone, Config(max_stretch=1e6))
    for base, found in zip(everyone, lists, strict=True):
        np.testing.assert_array_equal(found, np.flatnonzero(pool.labels == pool.labels[base]))
    for n_groups in (2, 3, 4):
        enumerated = sum(1 for own in lists for _ in product(own, repeat=n_groups - 1))
        assert count_combinations(pool.labels, n_groups) == enumerated


def test_count_combinations_is_exact_above_float_precision():
    assert count_combinations(np.zeros(10_000, int), 5) == 10_000**5


@given(SEEDS)
def test_candidate_lists_excluded_donor_is_listed_for_itself_only(make_pool, seed):
    pool = make_pool(seed, n_labels=1)
    pool.is_donor[4] = False
    lists = pool.candidate_lists(np.arange(len(pool.segments)), ROBUST)
    for base, found in enumerate(lists):
        assert (4 in found) == (base == 4)
    (refused,) = (c for c in list_segment(pool, 3, ROBUST).refused if c.segment == 4)
    assert refused.refused.startswith("excluded donor: a recording fault overlaps it")


def typical_gaps_oracle(pool):
    """Gaps between the next member of each cluster, cyclically, and that of its neighbour's."""

    def partner(i):
        same = (pool.labels == pool.labels[i]) & pool.is_donor
        members = [int(k) for k in np.flatnonzero(same)]
        return members[(members.index(i) + 1) % len(members)]

    boundary = pool.boundary
    angles, velocities = [], []
    for i in range(len(pool.segments) - 1):
        if not pool.is_donor[i : i + 2].all():
            continue
        left, right = partner(i), partner(i + 1)
        if (left, right) != (i, i + 1):
            angles.append(oracle.seam_angle(boundary.last[left], boundary.first[right]))
            jump = boundary.last_velocity[left] - boundary.first_velocity[right]
            velocities.append(np.linalg.norm(jump, axis=1).mean())
    return (np.mean(angles), np.mean(velocities)) if angles else (np.inf, np.inf)


@given(SEEDS, st.integers(1, 12), st.floats(0.01, 3.0))
def test_typical_gaps_match_the_oracle_and_set_the_seam_scales(make_pool, seed, n_labels, size):
    pool = make_pool(seed, n_labels=n_labels)
    boundary = replace(
        pool.boundary,
        first_velocity=size * pool.boundary.first_velocity,
        last_velocity=size * pool.boundary.last_velocity,
    )
    is_donor = np.random.default_rng(seed).random(12) < 0.8
    pool = replace(pool, boundary=boundary, is_donor=is_donor)
    angle, velocity = typical_gaps_oracle(pool)
    np.testing.assert_allclose(pool.typical_gaps, (angle, velocity), atol=1e-9)
    scales = pool.seam_scales(ROBUST)
    assert scales.angle == pytest.approx(min(np.radians(20), 2 * angle))
    assert scales.velocity == pytest.approx(min(np.radians(200), 2 * velocity))


@given(SEEDS)
def test_seam_angles_along_are_those_of_the_matrix(make_pool, seed):
    pool = make_pool(seed)
    donors = np.random.default_rng(seed).integers(0, 12, 7)
    expected = np.diag(pool.seam_angles(donors[:-1], donors[1:]))
    np.testing.assert_array_equal(pool.seam_angles_along(donors), expected)
    assert pool.seam_angles_along(donors[:1]).shape == (0,)


@given(SEEDS)
def test_list_candidates_refusals_name_the_exceeded_limits(make_pool, seed):
    pool = make_pool(seed)
    config = Config(max_angle=0.3)
    lists = pool.candidate_lists(np.arange(len(pool.segments)), config)
    for segment, fitting in enumerate(lists):
        found = list_segment(pool, segment, config)
        assert found.allowed[0].segment == segment
        assert {c.segment for c in found.allowed} <= set(fitting.tolist())
        for candidate in found.refused:
            is_wide = max(candidate.gap_before, candidate.gap_after) > 0.3
            assert ("seam: " in candidate.refused) == is_wide
            assert ("length: " in candidate.refused) == (candidate.segment not in fitting)
        total = len(found.allowed) + len(found.refused) + found.elsewhere
        assert total == len(pool.segments)


@few_examples(40)
@pytest.mark.parametrize("choice", CHOICES)
@given(SEEDS, st.integers(1, 3), st.floats(0.05, 3.0))
def test_listed_cost_is_that_of_the_trellis_beside_the_base_neighbours(
    make_pool, choice, seed, n_labels, limit
):
    pool = make_pool(seed, n_labels=n_labels)
    config = Config(choice=choice, max_stretch=5.0, max_angle=limit)
    scenario = np.arange(len(pool.segments))
    lists = pool.candidate_lists(scenario, config)
    model = cost_model(config, pool)
    trellis = DonorTrellis.build(pool, scenario, lists, model)
    beside = trellis.costs.costs_beside(trellis.path(scenario))
    for segment in scenario.tolist():
        found = list_segment(pool, segment, config)
        costs = {c.segment: c.cost for c in (*found.allowed, *found.refused)}
        for member, cost in zip(trellis.candidates[segment], beside[segment], strict=True):
            assert costs[member] == pytest.approx(cost, rel=1e-12, abs=1e-12)


@pytest.fixture(scope="module")
def library():
    motion = dance(seed=1, strides=2).motion
    return mg.Library.build([motion[:500], replace(motion[500:900], name="second")])


CONSTRAINTS = {
    "pose": [
        mg.Avoid(mg.Sphere((30.0, 130.0, 40.0), 30.0)),
        mg.Reach("LeftHand", (20.0, 120.0, 30.0), 200, weight=0.5),
        mg.Face((0.0, 150.0, 500.0), weight=0.2, frames=(100, 300)),
    ],
    "several hard": [
        mg.Avoid(mg.Sphere((30.0, 130.0, 40.0), 30.0)),
        mg.KeepOut("RightHand", mg.HalfSpace((0.0, 120.0, 0.0), (0.0, 1.0, 0.0))),
        mg.AvoidSelf(tolerance=0.001),
    ],
    "origin": [
        mg.OnlyFrom("second", weight=0.7),
        mg.MaxStretch(0.08),
        mg.NotFrom("second", clip_frames=(0, 90), frames=(50, 250)),
        mg.KeepOriginal(frames=(300, 350)),
    ],
    "seam": [mg.MaxAngle(0.15)],
}


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("kind", list(CONSTRAINTS))
def test_listed_cost_with_constraints_is_that_of_the_search(library, choice, kind):
    library = replace(library, config=replace(library.config, choice=choice))
    constraints = CONSTRAINTS[kind]
    scenario = library.segments.of_clip(0)
    base_segments = library.segments[scenario]
    problem = SearchProblem.build(
        library, library.clips[0], scenario, base_segments, ["upper"], constraints
    )
    trellis = build_trellis(problem, "upper", {})
    beside = trellis.costs.costs_beside(trellis.path(scenario))
    n_compared = 0
    for position, segment in list(enumerate(scenario.tolist()))[::7]:
        found = library.candidates(segment, "upper", constraints)
        costs = {c.segment: c.cost for c in (*found.allowed, *found.refused)}
        for member, cost in zip(trellis.candidates[position], beside[position], strict=True):
            assert costs[member] == pytest.approx(cost, rel=1e-12, abs=1e-12)
            n_compared += member != segment
    assert n_compared


def test_listed_candidates_with_a_seam_constraint_are_refused_by_its_limit(library):
    found = [library.candidates(i, "upper", [mg.MaxAngle(0.15)]) for i in range(0, 60, 5)]
    wide = [c for own in found for c in own.refused if "is above 8.6°" in c.refused]
    assert wide
    for candidate in wide:
        assert max(candidate.gap_before, candidate.gap_after) > 0.15
        assert candidate.cost > 900


def test_list_candidates_lone_segment_lists_itself(make_pool):
    pool = make_pool(0, n=1)
    assert len(list_segment(pool, 0, ROBUST)) == 1
    with pytest.raises(IndexError):
        list_segment(pool, 1, ROBUST)
