"""Properties of candidates: neighbourhoods, lists and listed costs."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft import Config, Segments
from mograft.dancer import dance
from mograft.search.costs import length_fits
from mograft.search.donor_choice import DONOR_CHOICES, cost_model
from mograft.search.neighbourhoods import FEWEST_DONORS, NEIGHBOURHOODS, ClusterMembers
from mograft.search.trellis import DonorTrellis
from mograft.solve.candidates import count_combinations, list_candidates
from mograft.solve.donor_trellis import build_trellis
from tests.grafting_fixtures import make_problem
from tests.oracles import search as oracle
from tests.strategies import SEEDS, few_examples

ROBUST, PAPER = Config(), Config.paper()


def list_segment(pool, segment, config):
    return list_candidates(pool, segment, cost_model(config, pool))


def with_random_donors(pool, seed):
    return replace(pool, is_donor=np.random.default_rng(seed).random(len(pool.segments)) < 0.8)


CLUSTER = Config(neighbourhood="cluster")


CONFIGS, RADII = st.sampled_from((CLUSTER, PAPER, ROBUST)), st.sampled_from([0.2, 1.0, 2.0])


@given(SEEDS, st.integers(1, 5), RADII, CONFIGS)
def test_candidate_lists_match_the_oracle(make_pool, seed, batch, sigma, config):
    """All donors of the neighbourhood that fit; if a ball has too few, the nearest in two radii."""
    pool = replace(with_random_donors(make_pool(seed), seed), sigma=sigma)
    scenario = np.random.default_rng(seed).integers(0, len(pool.segments), 20)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mograft.search.segment_pool.POSITIONS_PER_BATCH", batch)
        patch.setattr("mograft.search.segment_pool._NEIGHBOURS_PER_BATCH", batch)
        lists = pool.candidate_lists(scenario, config)
    lengths = pool.segments.lengths
    for base, found in zip(scenario.tolist(), lists, strict=True):
        distances = np.linalg.norm(pool.points - pool.points[base], axis=1)
        fits = length_fits(lengths[base], lengths, 30.0, config) & pool.is_donor
        order = np.argsort(distances, kind="stable").tolist()
        fitting = [k for k in order if fits[k] and k != base]
        is_inside = pool.labels == pool.labels[base]
        if config.neighbourhood == "ball":
            is_inside = distances <= sigma
        inside = [k for k in fitting if is_inside[k]]
        if config.neighbourhood == "ball" and len(inside) < FEWEST_DONORS:
            inside = [k for k in fitting if distances[k] <= 2 * sigma][:FEWEST_DONORS]
        assert found.tolist() == sorted([base, *inside])


@few_examples(50)
@given(SEEDS, st.integers(1, 4), st.integers(1, 3), st.integers(1, 20))
def test_search_keeps_cheapest_of_those_preselected(make_pool, seed, most, factor, batch):
    """With lists limited before the search or not, and with batches of any size."""
    pool = make_pool(seed, n=20, n_labels=2)
    config = replace(CLUSTER, max_stretch=1e6, max_candidates=most)
    model, scenario = cost_model(config, pool), np.arange(len(pool.segments))
    with pytest.MonkeyPatch.context() as patch:
        for module in ("segment_pool", "trellis"):
            patch.setattr(f"mograft.search.{module}.POSITIONS_PER_BATCH", batch)
            patch.setattr(f"mograft.search.{module}.PRESELECTION", factor)
        patch.setattr("mograft.search.segment_pool._NEIGHBOURS_PER_BATCH", batch)
        patch.setattr("mograft.search.segment_pool._SEGMENTS_PER_BATCH", factor)
        patch.setattr("mograft.search.segment_pool._MAX_KNOWN_PAIRS", batch)
        limited = pool.candidate_lists(scenario, config, model)
        lists = pool.candidate_lists(scenario, config)
        trellises = [DonorTrellis.build(pool, scenario, own, model) for own in (limited, lists)]
    for base, candidates in enumerate(lists):
        donors = candidates.tolist()
        pairs = np.full(len(donors), base), candidates
        without = pool.preselection_costs(*pairs, model)
        unary = dict(zip(donors, pool.unary_costs(*pairs, model), strict=True))
        ranked = sorted(zip(without, donors, strict=True), key=lambda own: (own[1] != base, own))
        first = [donor for _, donor in ranked[: factor * most]]
        assert limited[base].tolist() == sorted(first)
        kept = sorted(first, key=lambda donor: (donor != base, unary[donor], donor))[:most]
        for trellis in trellises:
            assert trellis.candidates[base].tolist() == sorted(kept)
            expected = [unary[donor] for donor in sorted(kept)]
            np.testing.assert_array_equal(trellis.costs.unary[base], expected)


@given(st.lists(st.integers(0, 3), min_size=1, max_size=8), st.integers(2, 4))
def test_count_combinations_is_exact_also_above_float_precision(labels, n_groups):
    enumerated = sum(labels.count(own) ** (n_groups - 1) for own in labels)
    assert count_combinations(np.array(labels), n_groups) == enumerated
    assert count_combinations(np.zeros(10_000, int), 5) == 10_000**5


@few_examples(30)
@given(SEEDS, st.lists(st.tuples(st.integers(1, 12), st.booleans(), st.booleans()), max_size=9))
def test_candidate_lists_do_not_depend_on_earlier_ones(make_pool, seed, questions):
    pool = make_pool(seed, n=20, n_labels=2)
    for n, is_wide, has_model in questions:
        config = replace(CLUSTER, max_stretch=1e6 if is_wide else 0.2, max_candidates=1)
        scenario, model = np.arange(n), cost_model(config, pool) if has_model else None
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("mograft.search.segment_pool.PRESELECTION", 1)
            found = pool.candidate_lists(scenario, config, model)
            expected = replace(pool).candidate_lists(scenario, config, model)
        assert [own.tolist() for own in found] == [own.tolist() for own in expected]


@few_examples(50)
@given(SEEDS, st.integers(1, 12), st.sampled_from([0.01, 1.0]))
def test_typical_seams_join_other_donors_of_neighbouring_clusters_and_set_the_scales(
    make_pool, seed, n_labels, size
):
    pool = with_random_donors(make_pool(seed, n_labels=n_labels), seed)
    clip = (np.arange(12) >= 5).astype(int)
    boundary = replace(pool.boundary, last_velocity=size * pool.boundary.last_velocity)
    segments = Segments(pool.segments.start, pool.segments.stop, clip)
    pool = replace(pool, segments=segments, boundary=boundary)
    sizes = [np.sum((pool.labels == own) & pool.is_donor) for own in pool.labels]
    is_inner = (np.diff(clip) == 0) & pool.is_donor[:-1] & pool.is_donor[1:]
    seams = [i for i in np.flatnonzero(is_inner) if sizes[i] + sizes[i + 1] > 2]
    left, right = pool.typical_seams()
    assert len(left) == (512 if seams else 0)
    angles, velocities = [], []
    for index, (a, b) in enumerate(zip(left.tolist(), right.tolist(), strict=True)):
        seam = seams[index * len(seams) // 512]  # each seam of the clips in turn
        assert (pool.labels[[a, b]] == pool.labels[[seam, seam + 1]]).all()
        assert pool.is_donor[[a, b]].all()
        assert a != seam or sizes[seam] == 1
        assert (b, clip[b]) != (a + 1, clip[a])
        angles.append(oracle.seam_angle(boundary.last[a], boundary.first[b]))
        jump = boundary.last_velocity[a] - boundary.first_velocity[b]
        velocities.append(np.linalg.norm(jump, axis=1).mean())
    angle, velocity = (np.mean(angles), np.mean(velocities)) if seams else (np.inf, np.inf)
    np.testing.assert_allclose(pool.typical_gaps, (angle, velocity), atol=1e-9)
    scales = cost_model(ROBUST, pool).scales
    assert scales.angle == pytest.approx(min(np.radians(20), angle / 2))
    assert scales.velocity == pytest.approx(min(np.radians(200), 2 * velocity))


@few_examples(40)
@given(SEEDS)
def test_list_candidates_refusals_name_the_exceeded_limits(make_pool, seed):
    pool = with_random_donors(make_pool(seed), seed)
    config = Config(max_angle=0.3)
    lengths = pool.segments.lengths
    lists = pool.candidate_lists(np.arange(len(pool.segments)), config)
    for segment, fitting in enumerate(lists):
        found = list_segment(pool, segment, config)
        assert found.allowed[0].segment == segment
        assert {c.segment for c in found.allowed} <= set(fitting.tolist())
        for candidate in found.refused:
            is_wide = max(candidate.gap_before, candidate.gap_after) > 0.3
            assert ("seam: " in candidate.refused) == is_wide
            is_excluded = not pool.is_donor[candidate.segment]
            expected = "excluded donor: a recording fault overlaps it"
            assert candidate.refused.startswith(expected) == is_excluded
            fits = length_fits(lengths[segment], lengths[candidate.segment], 30.0, config)
            assert ("length: " in candidate.refused) == (not fits)
            # With `length_slack` a difference of exactly the limit is accepted.
            assert "not below" not in candidate.refused
            if "length: " in candidate.refused:
                stated = re.search(r"length: ([\d.]+) is above ([\d.]+)", candidate.refused)
                assert float(stated[1]) >= float(stated[2])
        total = len(found.allowed) + len(found.refused) + found.elsewhere
        assert total == len(pool.segments)
        strict = list_segment(pool, segment, replace(config, length_slack=0.0)).refused
        refusals = [candidate.refused for candidate in strict if "length: " in candidate.refused]
        assert all("is not below 0.15" in refusal for refusal in refusals)


@pytest.fixture(scope="module")
def library():
    motion = dance(seed=1, strides=2).motion
    return mg.Library.build([motion[:500], replace(motion[500:900], name="second")])


CONSTRAINTS = {
    "none": [],
    "pose": [
        mc.Avoid(mc.Sphere((30.0, 130.0, 40.0), 30.0)),
        mc.AvoidSelf(tolerance=0.001),
        mc.Reach("LeftHand", (20.0, 120.0, 30.0), 200, weight=0.5),
        mc.Face((0.0, 150.0, 500.0), weight=0.2, frames=(100, 300)),
    ],
    "origin": [
        mc.OnlyFrom("second", weight=0.7),
        mc.MaxStretch(0.08),
        mc.NotFrom("second", clip_frames=(0, 90), frames=(50, 250)),
        mc.KeepOriginal(frames=(300, 350)),
    ],
    "seam": [mc.MaxAngle(0.15)],
}


@pytest.mark.parametrize("choice", tuple(DONOR_CHOICES))
@pytest.mark.parametrize("neighbourhood", tuple(NEIGHBOURHOODS))
@pytest.mark.parametrize("kind", list(CONSTRAINTS))
def test_listed_cost_is_that_of_the_search_beside_the_base_neighbours(
    library, choice, neighbourhood, kind
):
    config = replace(library.config, choice=choice, neighbourhood=neighbourhood)
    library = replace(library, config=config)
    constraints, scenario = CONSTRAINTS[kind], library.segments.of_clip(0)
    trellis = build_trellis(make_problem(library, constraints), "upper", {})
    beside = trellis.costs.conditional_costs(trellis.path(scenario))
    n_compared = 0
    for position, segment in list(enumerate(scenario.tolist()))[::7]:
        found = mg.candidates(library, segment, "upper", constraints)
        costs = {c.segment: c.cost for c in (*found.allowed, *found.refused)}
        for member, cost in zip(trellis.candidates[position], beside[position], strict=True):
            assert costs[member] == pytest.approx(cost, rel=1e-12, abs=1e-12)
            n_compared += member != segment
    assert n_compared


N = 30
SIGMAS = st.sampled_from([0.0, 0.5, 2.0, 4.0, 1e3])


def find_members(name, seed, sigma, *, is_grid=False):
    """Return labels and points of random segments, and the members that a neighbourhood finds."""
    rng = np.random.default_rng(seed)
    # On the grid many distances are equal, also to the radius.
    points = rng.integers(0, 4, (N, 3)) * 0.5 if is_grid else rng.normal(size=(N, 3))
    points.setflags(write=False)  # the last sorted points are kept: another array is not these
    labels = rng.integers(0, 5, N)
    members = NEIGHBOURHOODS[name].find_members(labels, points, sigma, np.arange(N))
    return labels, points, members


@given(SEEDS, SIGMAS, st.booleans())
def test_ball_members_match_the_oracle(seed, sigma, is_grid):
    _, points, members = find_members("ball", seed, sigma, is_grid=is_grid)
    for base, found in enumerate(members):
        distances = [np.linalg.norm(point - points[base]) for point in points]
        expected = [k for k in range(N) if distances[k] <= sigma]
        assert found.tolist() == expected


@given(SEEDS, st.floats(100, 308), st.integers(0, 3))
def test_ball_members_are_found_beside_points_of_any_size(seed, exponent, column):
    """The points of a damaged library are far from all others, and cause no warning."""
    rng, ball = np.random.default_rng(seed), NEIGHBOURHOODS["ball"]
    points = rng.normal(size=(N, 4))
    huge = rng.random(N) < 0.1
    points[huge, column] = rng.choice([-1.0, 1.0], huge.sum()) * 10.0**exponent
    members = ball.find_members(np.arange(N), points, 1.0, np.arange(N))
    usual = np.flatnonzero(~huge)
    alone = ball.find_members(np.arange(len(usual)), points[usual], 1.0, np.arange(len(usual)))
    for index, own in zip(usual, alone, strict=True):
        assert members[index].tolist() == usual[own].tolist()


@given(SEEDS, SIGMAS)
def test_ball_near_a_new_point_is_that_of_a_segment_at_the_point(seed, sigma):
    labels, points, members = find_members("ball", seed, sigma, is_grid=True)
    by_cluster = ClusterMembers.from_labels(labels, points)
    for base, expected in enumerate(members):
        found, distances = NEIGHBOURHOODS["ball"].find_near(by_cluster, points[base], sigma)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_allclose(distances, np.linalg.norm(points[found] - points[base], axis=1))


def test_ball_without_an_embedding_is_the_base_segment():
    members = NEIGHBOURHOODS["ball"].find_members(np.arange(4), None, 0.0, np.array([2, 0]))
    assert [own.tolist() for own in members] == [[2], [0]]
