"""Methods of donor selection, each against a direct implementation of its rule."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from lab.donors.donor_methods import Method, RandomLength, draw_donors, grafts_by
from lab.donors.methods import (
    Analogy,
    Ball,
    ByCost,
    Captured,
    ContactPattern,
    Nearest,
    Random,
    contact_patterns,
    contact_sequences,
    default_methods,
)
from mograft import (
    Config,
    InsufficientDataError,
    JointGroups,
    Library,
    Motion,
    Skeleton,
    graft_many,
    rotations,
)
from mograft.body.contacts import detect_contacts
from mograft.search.costs import length_fits
from mograft.solve.plan import GraftPlan
from tests.strategies import smooth_rotations

RANDOM_METHODS = (
    Random(),
    RandomLength(),
    ContactPattern(),
    ContactPattern(is_exact=True),
    Nearest(),
    Ball(),
    Analogy(),
)
METHODS = (*RANDOM_METHODS, ByCost())


@pytest.fixture(scope="module")
def library(library):
    """Return the library with every 17th segment excluded as donor."""
    is_donor = library.is_donor.copy()
    is_donor[::17] = False
    return replace(library, is_donor=is_donor)


@pytest.mark.parametrize("method", [Analogy(), ByCost(), Nearest(), Ball()], ids=repr)
def test_candidates_do_not_depend_on_configured_neighbourhood(library, method):
    ball = library.relabelled(replace(library.config, neighbourhood="ball"))
    scenario = np.arange(len(library.segments))
    found = [method.candidates(own, scenario) for own in (library, ball)]
    for of_cluster, of_ball in zip(*found, strict=True):
        np.testing.assert_array_equal(of_cluster, of_ball)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_candidates_contain_base_segment_and_no_excluded_donor(library, method):
    scenario = np.arange(len(library.segments))[::-3]
    candidates = method.candidates(library, scenario)
    assert len(candidates) == len(scenario)
    for segment, donors in zip(scenario.tolist(), candidates, strict=True):
        assert segment in donors
        assert (np.diff(donors) > 0).all()
        assert library.is_donor[donors[donors != segment]].all()


def has_similar_length(library, segment):
    lengths = library.segments.lengths
    return length_fits(lengths[[segment]], lengths, library.rate, library.config)


def assert_candidates(library, method, is_allowed):
    """Assert that the candidates of some segments are the allowed donors and the segment."""
    n = len(library.segments)
    candidates = method.candidates(library, np.arange(n))
    for segment in range(0, n, 7):
        expected = np.array([is_allowed(segment, other) for other in range(n)])
        expected &= library.is_donor
        if method != Random():
            expected &= has_similar_length(library, segment)
        expected[segment] = True
        np.testing.assert_array_equal(candidates[segment], np.flatnonzero(expected))


@pytest.mark.parametrize("method", [Random(), RandomLength()], ids=repr)
def test_random_candidates_are_all_donors(library, method):
    assert_candidates(library, method, lambda *_: True)


def test_analogy_candidates_are_in_the_same_cluster(library):
    labels = library.labels["lower"]
    assert_candidates(library, Analogy(), lambda a, b: labels[a] == labels[b])


def test_contact_pattern_candidates_differ_in_at_most_two_states(library):
    states = contact_patterns(library)
    assert_candidates(library, ContactPattern(), lambda a, b: (states[a] != states[b]).sum() <= 2)


def test_contact_pattern_exact_candidates_have_equal_sequences(library):
    sequences = contact_sequences(library)
    method = ContactPattern(is_exact=True)
    assert_candidates(library, method, lambda a, b: sequences[a] == sequences[b])


def test_nearest_without_count_has_as_many_donors_as_analogy(library):
    segments = np.arange(len(library.segments))
    found, expected = (own.candidates(library, segments) for own in (Nearest(), Analogy()))
    assert [len(own) for own in found] == [len(own) for own in expected]


def test_ball_candidates_are_those_of_its_neighbourhood(library):
    segments = np.arange(len(library.segments))
    config = replace(library.config, neighbourhood="ball")
    expected = library.pool("upper").candidate_lists(segments, config)
    for own, other in zip(Ball().candidates(library, segments), expected, strict=True):
        np.testing.assert_array_equal(own, other)


def test_nearest_candidates_are_six_nearest_donors(library):
    points = library.embedding["lower"].points
    n = len(library.segments)
    candidates = Nearest(count=6).candidates(library, np.arange(n))
    for segment in range(0, n, 7):
        is_allowed = has_similar_length(library, segment) & library.is_donor
        is_allowed[segment] = False
        others = np.flatnonzero(is_allowed)
        distances = np.linalg.norm(points - points[segment], axis=1)
        nearest = candidates[segment][candidates[segment] != segment]
        assert len(nearest) == min(6, len(others))
        assert np.isin(nearest, others).all()
        farther = np.setdiff1d(others, nearest)
        if len(farther) and len(nearest):
            assert distances[nearest].max() <= distances[farther].min()


def test_contact_patterns_first_and_last_instant_equal_detected_contacts(library):
    states, cut = contact_patterns(library), library.segments
    contacts = [detect_contacts(clip).any(axis=2) for clip in library.clips]
    for segment in range(0, len(cut), 5):
        touching = contacts[cut.clip[segment]]
        np.testing.assert_array_equal(states[segment][0], touching[cut.start[segment]])
        np.testing.assert_array_equal(states[segment][-1], touching[cut.stop[segment]])


def test_contact_sequences_omit_states_of_one_frame(library):
    sequences, cut = contact_sequences(library), library.segments
    contacts = [detect_contacts(clip).any(axis=2) for clip in library.clips]
    for segment in range(0, len(cut), 5):
        rows = contacts[cut.clip[segment]][cut.start[segment] : cut.stop[segment] + 1]
        states = ["".join(map(str, row.astype(int))) for row in rows]
        lengths = [(state, len(list(frames))) for state, frames in groupby(states)]
        lasting = [state for state, length in lengths if length > 1]
        if lasting:
            assert sequences[segment] == ">".join(state for state, _ in groupby(lasting))


@pytest.mark.parametrize("method", RANDOM_METHODS, ids=repr)
def test_draw_donors_equals_donors_of_grafts_and_draws_candidates(library, method):
    plan, sequences = draw_donors(method, library, library.clips[1].name, 3, seed=9)
    scenario = plan.problem.scenario
    candidates = method.candidates(library, scenario)
    grafts = grafts_by(method, library, library.clips[1].name, 3, seed=9)
    for sequence, graft in zip(sequences, grafts, strict=True):
        for allowed, donor in zip(candidates, sequence["upper"].tolist(), strict=True):
            assert donor in allowed
        assert [s.donor for s in graft.substitutions] == sequence["upper"].tolist()


def test_draw_donors_equal_those_of_the_choice_random(library):
    # The clusters of the dancer have at most 100 members, so that no candidates are left out.
    config = replace(library.config, neighbourhood="cluster", choice="random", self_repair=False)
    plan, drawn = draw_donors(Analogy(), library, count=3, seed=5)
    chosen = GraftPlan.build(library.relabelled(config), None, None, ()).choose_donors(3, 5)
    for found, expected in zip(drawn, chosen, strict=True):
        np.testing.assert_array_equal(found["upper"], expected["upper"])
    assert max(map(len, plan.problem.candidates["upper"])) <= 100


def test_draw_donors_seam_limit_is_exceeded_only_by_nearest_candidate(library):
    method, max_angle = RandomLength(), np.radians(15)
    limited = replace(library, config=replace(library.config, max_angle=max_angle))
    plan, sequences = draw_donors(method, limited, None, 40, seed=1)
    scenario = plan.problem.scenario
    candidates = method.candidates(limited, scenario)
    pool = limited.pool("upper")
    first_donors = np.array([sequence["upper"][0] for sequence in sequences])
    assert len(np.unique(first_donors)) > min(len(candidates[0]), 40) / 4
    for sequence in sequences[:10]:
        donors = sequence["upper"]
        for position, angle in enumerate(pool.seam_angles_along(donors).tolist()):
            if angle > max_angle:
                previous = donors[position : position + 1]
                angles = pool.seam_angles(previous, candidates[position + 1])
                assert angle == pytest.approx(angles.min())


def test_grafts_by_cost_equal_graft_many(library):
    found = grafts_by(ByCost(), library, None, 2, seed=3)
    unrepaired = library.relabelled(replace(library.config, self_repair=False))
    expected = graft_many(unrepaired, None, 2, seed=3)
    for one, two in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.motion.rotations, two.motion.rotations)


def test_grafts_by_captured_equals_recording(library):
    graft = grafts_by(Captured(), library, None, 1, seed=0)[0]
    np.testing.assert_array_equal(graft.motion.rotations, graft.base.rotations)
    np.testing.assert_array_equal(graft.motion.positions, graft.base.positions)


def test_candidates_of_base_class_raises_not_implemented_error(library):
    with pytest.raises(NotImplementedError):
        Method().candidates(library, np.array([0]))


@pytest.fixture
def pole():
    skeleton = Skeleton(["a", "b", "c"], [-1, 0, 1], [[0, 0, 0], [0, 1, 0], [0, 1, 0]])
    quats = smooth_rotations(np.random.default_rng(0), 90, 3)
    return Motion(skeleton, 1 / 30, quats, np.tile(skeleton.offsets, (90, 1, 1)))


POLE_GROUPS = JointGroups({"lower": ["a"], "upper": ["b", "c"]})


def test_default_methods_without_legs_omits_contact_pattern(pole):
    library = Library.build(pole, POLE_GROUPS, Config())
    assert ContactPattern() not in default_methods(library)
    with pytest.raises(InsufficientDataError, match="legs"):
        ContactPattern().candidates(library, np.array([0]))


def test_default_methods_equal_base_parts_omits_nearest(pole):
    still = replace(pole, rotations=np.tile(rotations.IDENTITY, (90, 3, 1)))
    with pytest.warns(UserWarning, match="to compare"):
        library = Library.build(still, POLE_GROUPS, Config())
    assert Nearest() not in default_methods(library)
    with pytest.raises(InsufficientDataError, match="differ"):
        Nearest().candidates(library, np.array([0]))


def test_grafts_by_config_changes_changes_motion_only(library):
    changed_method = ByCost(config_changes=(("seam", "displacement"),))
    default, changed = (
        grafts_by(method, library, None, 1, seed=2)[0] for method in (ByCost(), changed_method)
    )
    assert [s.donor for s in default.substitutions] == [s.donor for s in changed.substitutions]
    assert (default.motion.rotations != changed.motion.rotations).any()
    assert changed.library.config.seam == "displacement"


def test_grafts_by_config_change_of_embedding_raises_value_error(library):
    with pytest.raises(ValueError, match="samples"):
        grafts_by(ByCost(config_changes=(("samples", 5),)), library)
