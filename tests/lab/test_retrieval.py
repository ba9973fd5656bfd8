"""Retrieval on parts whose dependence is planted or destroyed, and libraries of some segments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from scipy import stats

from lab.donors.held_out import fit_on, shuffle_parts
from lab.donors.retrieval import retrieval
from lab.donors.retrieval_trials import RULES, PartErrors, first_weights, middle_ranks
from mograft import InsufficientDataError, Library, rotations
from tests.strategies import SEEDS, few_examples


def move_arms_like_legs(motion):
    """Return the motion with the rotations of the thighs in the upper arms."""
    index, quats = motion.skeleton.index, motion.rotations.copy()
    for side in ("Left", "Right"):
        quats[:, index(f"{side}Arm")] = quats[:, index(f"{side}UpLeg")]
    return replace(motion, rotations=quats, channel_values=None)


def move_upper_body_at_random(motion, joints, rng):
    """Return the motion with smooth noise in the rotations of joints."""
    noise = rng.normal(size=(motion.n_frames + 12, len(joints), 3)).cumsum(axis=0)
    quats = motion.rotations.copy()
    quats[:, joints] = rotations.exp((noise[12:] - noise[:-12]) / 12)
    return replace(motion, rotations=quats, channel_values=None)


@pytest.fixture(scope="module")
def coupled(library):
    """Return the result for arms that move like the legs of the same frame."""
    return retrieval(Library.build([move_arms_like_legs(clip) for clip in library.clips]))


@pytest.fixture(scope="module")
def uncoupled(library):
    """Return the result for upper bodies that move at random."""
    rng, joints = np.random.default_rng(1), library.joints("upper")
    clips = [move_upper_body_at_random(clip, joints, rng) for clip in library.clips]
    return retrieval(Library.build(clips))


def test_retrieval_planted_coupling_is_found(coupled):
    for rule in ("random", "contact pattern"):
        advantage = coupled.advantage(rule)
        assert advantage.angle.low > 0
        assert advantage.angle.low > advantage.angle_null.high
        assert advantage.distance.low > advantage.distance_null.high


def test_retrieval_independent_parts_have_no_advantage(uncoupled):
    for advantage in uncoupled.advantages:
        assert advantage.angle.low <= 0 <= advantage.angle.high, advantage.rule


@pytest.mark.parametrize("name", ["coupled", "uncoupled"])
def test_retrieval_shuffled_parts_have_no_advantage(name, request):
    found = request.getfixturevalue(name)
    nulls = [own.angle_null for own in found.scores if own.rule in RULES]
    nulls += [null for own in found.advantages for null in (own.angle_null, own.distance_null)]
    assert all(null.low <= 0 <= null.high for null in nulls)


def test_retrieval_scores_are_bounded_by_best_possible(coupled):
    scores = {score.rule: score for score in coupled.scores}
    best = scores.pop("best possible")
    assert set(scores) == set(RULES)
    for rule, score in scores.items():
        if rule != "ball":
            assert score.distance.value >= best.distance.value
            assert score.donors.value == best.donors.value
    assert scores["random"].rank.value == pytest.approx(0.5)
    assert abs(scores["random"].angle_gain.value) < 0.15 * scores["analogy"].angle_gain.value
    assert 0 < coupled.segments <= coupled.held_out


def test_retrieval_invalid_arguments_raise(coupled, library):
    with pytest.raises(KeyError, match="wings"):
        coupled.advantage("wings")
    with pytest.raises(InsufficientDataError, match="60 segments"):
        retrieval(Library.build(library.clips[0][:200]))
    with pytest.raises(ValueError, match="`group` must be one of upper"):
        retrieval(library, "lower")


def test_part_errors_equal_definition(library):
    errors = PartErrors.of(library, "upper")
    i, j = 3, 40
    joints = np.intersect1d(library.joints("upper"), library.embedding["upper"].joints)
    first, second = library.samples.rotations[[i, j], ::2][:, :, joints].astype(np.float64)
    assert errors.angle[i, j] == pytest.approx(rotations.angle(first, second).mean(), abs=1e-3)
    is_other = library.is_donor & (np.arange(len(library.segments)) != j)
    assert errors.mean_angle[j] == pytest.approx(errors.angle[is_other, j].mean(), rel=1e-3)
    assert np.diag(errors.distance) == pytest.approx(0, abs=1e-3)


@few_examples(50)
@given(SEEDS)
def test_first_weights_equal_mean_over_random_tie_breaks(seed):
    rng = np.random.default_rng(seed)
    order = rng.integers(0, 4, rng.integers(1, 9)).astype(float)
    n = int(rng.integers(0, len(order) + 1))
    chosen = np.zeros(len(order))
    for _ in range(2000):
        chosen[np.lexsort((rng.random(len(order)), order))[:n]] += 1
    np.testing.assert_allclose(first_weights(order, n), chosen / 2000 / max(n, 1), atol=0.06)


@few_examples(50)
@given(SEEDS)
def test_middle_ranks_equal_scipy(seed):
    rng = np.random.default_rng(seed)
    order = rng.integers(0, 5, rng.integers(1, 12)).astype(float)
    expected = (stats.rankdata(order) - 0.5) / len(order)
    np.testing.assert_allclose(middle_ranks(order), expected)


def test_fit_on_all_clips_but_one_equals_library_with_appended_clip(library):
    held = library.segments.clip == 1
    fitted = fit_on(library, ~held)
    expected = Library.build(library.clips[0]).with_clip(library.clips[1])
    for group in library.groups.names:
        points, other = (own.embedding[group].points for own in (fitted, expected))
        np.testing.assert_allclose(points, other, atol=1e-4)
        np.testing.assert_array_equal(fitted.labels[group], expected.labels[group])
        assert fitted.sigma[group] == pytest.approx(expected.sigma[group], rel=1e-5)
    np.testing.assert_array_equal(fitted.is_donor, expected.is_donor)


def test_fit_on_interleaved_segments_ignores_the_others(library):
    is_fitted = np.arange(len(library.segments)) % 3 != 0
    fitted = fit_on(library, is_fitted)
    rows = library.samples.rows.copy()
    rows[~is_fitted] = rows[~is_fitted][::-1]
    changed = fit_on(replace(library, samples=replace(library.samples, rows=rows)), is_fitted)
    for group in library.groups.names:
        found, expected = changed.embedding[group].points, fitted.embedding[group].points
        np.testing.assert_array_equal(found[is_fitted], expected[is_fitted])
        np.testing.assert_array_equal(found[~is_fitted], expected[~is_fitted][::-1])
        assert changed.sigma[group] == fitted.sigma[group]


@few_examples(30)
@given(SEEDS)
def test_shuffle_parts_permutes_donors_within_groups(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    groups, is_donor = rng.integers(0, 5, n), rng.random(n) < 0.8
    for within in (None, groups):
        shuffled = shuffle_parts(is_donor, rng, within)
        assert sorted(shuffled.tolist()) == list(range(n))
        np.testing.assert_array_equal(shuffled[~is_donor], np.flatnonzero(~is_donor))
    np.testing.assert_array_equal(groups[shuffled], groups)
