"""Methods of donor selection, each against a direct implementation of its rule."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from lab.donors.methods import (
    Analogy,
    Ball,
    ByCost,
    ContactPattern,
    Nearest,
    Random,
    contact_patterns,
    contact_sequences,
    default_methods,
)
from mograft import InsufficientDataError, JointGroups, Library, graft_many, rotations
from mograft.body.contacts import detect_contacts
from mograft.evaluation import RandomLength, draw_donors, grafts_by
from mograft.search.costs import length_fits
from tests.strategies import random_star_clip, tile_segments

EXACT_PATTERN = ContactPattern(is_exact=True)
RANDOM_METHODS = [Random(), RandomLength(), Analogy(), ContactPattern(), EXACT_PATTERN]
RANDOM_METHODS += [Nearest(), Ball()]


@pytest.fixture(scope="module")
def library(library):
    """Return the library with every 17th segment excluded as donor."""
    is_donor = library.is_donor.copy()
    is_donor[::17] = False
    return replace(library, is_donor=is_donor)


@pytest.fixture(scope="module")
def segments(library):
    return np.arange(len(library.segments))


@pytest.fixture(scope="module")
def ball(library):
    return library.relabelled(replace(library.config, neighbourhood="ball"))


def assert_same_lists(found, expected):
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(own, other)


@pytest.mark.parametrize("method", [Analogy(), ByCost(), Nearest(), Ball()], ids=repr)
def test_candidates_do_not_depend_on_configured_neighbourhood(library, ball, segments, method):
    assert_same_lists(*(method.candidates(own, segments) for own in (library, ball)))


def similar_lengths(library, segment):
    lengths = library.segments.lengths
    return length_fits(lengths[[segment]], lengths, library.rate, library.config)


RULES = {
    Random(): lambda library: np.zeros(len(library.segments)),
    RandomLength(): lambda library: np.zeros(len(library.segments)),
    Analogy(): lambda library: library.labels["lower"],
    EXACT_PATTERN: lambda library: np.array(contact_sequences(library)),
    ContactPattern(): contact_patterns,
}
"""What must be equal, or differ in at most two elements, in a segment and its candidates."""


@pytest.mark.parametrize("method", RULES, ids=repr)
def test_candidates_are_all_donors_that_the_rule_allows(library, segments, method):
    values = RULES[method](library).reshape(len(segments), -1)
    candidates = method.candidates(library, segments)
    for segment in segments[::7]:
        n_allowed = 2 if method == ContactPattern() else 0
        expected = (values != values[segment]).sum(axis=1) <= n_allowed
        expected &= library.is_donor
        if method != Random():
            expected &= similar_lengths(library, segment)
        expected[segment] = True
        np.testing.assert_array_equal(candidates[segment], np.flatnonzero(expected))


def test_nearest_without_count_has_as_many_donors_as_analogy(library, segments):
    found, expected = (own.candidates(library, segments) for own in (Nearest(), Analogy()))
    assert [len(own) for own in found] == [len(own) for own in expected]


def test_ball_candidates_are_those_of_its_neighbourhood(library, ball, segments):
    expected = library.pool("upper").candidate_lists(segments, ball.config)
    assert_same_lists(Ball().candidates(library, segments), expected)


def test_nearest_candidates_are_six_nearest_donors(library, segments):
    points = library.embedding["lower"].points
    candidates = Nearest(count=6).candidates(library, segments)
    for segment in segments[::7]:
        is_allowed = similar_lengths(library, segment) & library.is_donor & (segments != segment)
        others = np.flatnonzero(is_allowed)
        distances = np.linalg.norm(points[others] - points[segment], axis=1)
        nearest = np.isin(others, candidates[segment])
        assert nearest.sum() == len(candidates[segment]) - 1 == min(6, len(others))
        farthest = distances[nearest].max(initial=0)
        assert farthest <= distances[~nearest].min(initial=np.inf)


def test_contact_patterns_and_sequences_equal_detected_contacts(library, segments):
    states, sequences, cut = contact_patterns(library), contact_sequences(library), library.segments
    contacts = [detect_contacts(clip).any(axis=2) for clip in library.clips]
    for segment in segments[::5]:
        rows = contacts[cut.clip[segment]][cut.start[segment] : cut.stop[segment] + 1]
        np.testing.assert_array_equal(states[segment][[0, -1]], rows[[0, -1]])
        names = ["".join(map(str, row.astype(int))) for row in rows]
        lasting = [state for state, frames in groupby(names) if len(list(frames)) > 1]
        if lasting:  # states of one frame are left out
            assert sequences[segment] == ">".join(state for state, _ in groupby(lasting))


@pytest.mark.parametrize("method", RANDOM_METHODS, ids=repr)
def test_draw_donors_equals_donors_of_grafts_and_draws_candidates(library, method):
    arguments = (method, library, library.clips[1].name, 3)
    plan, sequences = draw_donors(*arguments, seed=9)
    candidates = method.candidates(library, plan.problem.scenario)
    for sequence, graft in zip(sequences, grafts_by(*arguments, seed=9), strict=True):
        for allowed, donor in zip(candidates, sequence["upper"].tolist(), strict=True):
            assert donor in allowed
        assert [s.donor for s in graft.substitutions] == sequence["upper"].tolist()


def test_draw_donors_seam_limit_is_exceeded_only_by_nearest_candidate(library):
    method, max_angle = RandomLength(), np.radians(15)
    limited = replace(library, config=replace(library.config, max_angle=max_angle))
    plan, sequences = draw_donors(method, limited, None, 40, seed=1)
    candidates = method.candidates(limited, plan.problem.scenario)
    pool = limited.pool("upper")
    first_donors = {int(sequence["upper"][0]) for sequence in sequences}
    assert len(first_donors) > min(len(candidates[0]), 40) / 4
    for donors in [sequence["upper"] for sequence in sequences[:10]]:
        angles = pool.seam_angles_along(donors)
        for position in np.flatnonzero(angles > max_angle):
            possible = pool.seam_angles(donors[[position]], candidates[position + 1])
            assert angles[position] == pytest.approx(possible.min())


def test_grafts_by_cost_equal_graft_many(library):
    unrepaired = library.relabelled(replace(library.config, self_repair=False))
    made = grafts_by(ByCost(), library, None, 2, seed=3), graft_many(unrepaired, None, 2, seed=3)
    assert_same_lists(*([graft.motion.rotations for graft in own] for own in made))


def test_default_methods_omit_those_that_need_legs_or_different_base_parts():
    motion = random_star_clip(np.random.default_rng(0), tile_segments(np.array([89])))
    groups = JointGroups({"lower": [0], "upper": [1, 2, 3]})
    still = rotations.IDENTITY + np.zeros_like(motion.rotations)
    unknown = Library.build(motion, groups)
    with pytest.warns(UserWarning, match="to compare"):
        equal = Library.build(replace(motion, rotations=still, channel_values=None), groups)
    cases = (unknown, ContactPattern(), "legs"), (equal, Nearest(), "differ")
    for library, method, message in cases:
        assert method not in default_methods(library)
        with pytest.raises(InsufficientDataError, match=message):
            method.candidates(library, np.array([0]))
