"""Generators that grafts are compared with, and the sections that compare them."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.baselines import body_mixing, catalogue, genmm, motion_matching
from lab.baselines.motion_arrays import MotionArrays
from lab.experiments import seam_tests
from lab.experiments.pooling import Z, pool, subtract
from lab.experiments.sources import Recordings
from mograft import rotations
from mograft.dancer import dance
from tests.strategies import SEEDS

ONE_SCALE = genmm.Settings(coarsest=1.0, noise=0.0)


@pytest.fixture(scope="module")
def recordings():
    return Recordings("dancer", tuple(take.motion for take in dance(seed=4, strides=2).takes(3)))


@pytest.fixture(scope="module")
def library(recordings):
    return recordings.library


@given(SEEDS, st.integers(4, 30), st.integers(1, 3))
def test_genmm_one_scale_without_noise_reproduces_its_example(seed, n, n_examples):
    rng = np.random.default_rng(seed)
    examples = [rng.normal(size=(n + k, 4)) for k in range(n_examples)]
    for example in examples:
        result = genmm.synthesize(examples, len(example), rng, ONE_SCALE, start=example)
        np.testing.assert_allclose(result, example, atol=1e-9)


@given(SEEDS, st.integers(12, 40))
def test_genmm_kept_columns_are_unchanged(seed, n):
    rng = np.random.default_rng(seed)
    examples = [rng.normal(size=(n, 5)), rng.normal(size=(n + 9, 5))]
    kept = genmm.Kept(np.array([0, 2]), rng.normal(size=(n, 2)), example=1, radius=5)
    result = genmm.synthesize(examples, n, rng, kept=kept)
    np.testing.assert_array_equal(result[:, kept.columns], kept.values)


def test_genmm_excluded_patches_are_not_used():
    rng = np.random.default_rng(0)
    examples = [rng.normal(size=(60, 3)), rng.normal(size=(60, 3)) + 50]
    start, columns = examples[0], np.array([0])
    free = genmm.Kept(columns, start[:, columns])
    barred = replace(free, example=0, radius=100)
    near, far = (genmm.synthesize(examples, 60, rng, ONE_SCALE, k, start) for k in (free, barred))
    np.testing.assert_allclose(near, start, atol=1e-9)
    assert far[:, 1:].min() > 40


def test_genmm_values_lie_within_the_range_of_the_examples():
    rng = np.random.default_rng(1)
    examples = [rng.normal(size=(50, 3)), rng.normal(size=(70, 3))]
    frames, result = np.concatenate(examples), genmm.synthesize(examples, 90, rng)
    clipped = result.clip(frames.min(axis=0), frames.max(axis=0))
    np.testing.assert_allclose(result, clipped, atol=1e-12)


def test_motion_arrays_decode_inverts_encode(library):
    arrays, clip = MotionArrays.of(library), library.clips[0]
    level = [axis for axis in range(3) if axis != library.up]
    start = clip.positions[0, library.root, level]
    decoded = arrays.decode(arrays.encode(clip), start)
    assert rotations.angle(decoded.rotations, clip.rotations).max() < 1e-6
    np.testing.assert_allclose(decoded.positions, clip.positions, atol=1e-6)


def test_cut_mix_kept_joints_are_unchanged_to_the_bit(library):
    joints, base = library.joints("upper"), library.clips[0]
    mixed = body_mixing.cut_mix(base, library.clips, joints, np.random.default_rng(0))
    assert_only_joints_change(mixed, base, joints, 0.1)
    np.testing.assert_array_equal(mixed.positions, base.positions)


def test_cut_mix_joints_beyond_the_border_are_those_of_the_donor(library):
    joints = library.joints("upper")
    donor = body_mixing.random_track(library.clips, joints, 200, np.random.default_rng(5))
    base = library.clips[0][:200]
    mixed = body_mixing.cut_mix(base, library.clips, joints, np.random.default_rng(5))
    weights = body_mixing.soft_weights(base.skeleton, joints)
    assert set(np.round(weights, 6)) >= {round(1 / 3, 6), 1.0}
    np.testing.assert_array_equal(mixed.rotations[:, joints[weights == 1]], donor[:, weights == 1])


def test_add_noise_angles_have_the_given_deviation(library):
    clip = library.clips[0]
    noisy = body_mixing.add_noise(clip, 2.0, np.random.default_rng(0))
    angles = np.degrees(rotations.angle(noisy.rotations, clip.rotations))
    assert np.sqrt((angles**2).mean()) == pytest.approx(2.0, rel=0.05)
    only = body_mixing.add_noise(clip, 2.0, np.random.default_rng(0), joints=[3])
    assert_only_joints_change(only, clip, [3], 0.0)


def test_motion_matching_changes_the_given_joints_only_if_own_frames_are_barred(library):
    joints, base = library.joints("upper"), library.clips[1]
    database = motion_matching.MatchingDatabase.of(library.clips)
    match = partial(motion_matching.match, base, 1, joints, database, np.random.default_rng(0))
    own = match(radius=0, n_nearest=1)
    assert rotations.angle(own.rotations, base.rotations).max() < 1e-6
    assert_only_joints_change(match(), base, joints, 0.02)


def assert_only_joints_change(motion, base, joints, mean_angle):
    """Assert that the given joints turn by more than an angle, and others not at all."""
    kept = np.setdiff1d(np.arange(base.n_joints), joints)
    np.testing.assert_array_equal(motion.rotations[:, kept], base.rotations[:, kept])
    angles = rotations.angle(motion.rotations[:, joints], base.rotations[:, joints])
    assert angles.mean() > mean_angle


NUMBERS, ERRORS = st.floats(-100, 100), st.floats(0, 10)


def as_estimate(value, error):
    return {"value": value, "interval": [value - Z * error, value + Z * error], "n": 10, "of": "x"}


def error_of(estimate):
    low, high = estimate["interval"]
    return pytest.approx((high - low) / (2 * Z), abs=1e-9)


@given(NUMBERS, ERRORS, st.integers(1, 9))
def test_pool_equal_sources_divides_the_error_by_the_root(value, error, n):
    pooled = pool([as_estimate(value, error)] * n)
    assert pooled["value"] == pytest.approx(value)
    assert pooled["n"] == 10 * n
    assert error / math.sqrt(n) == error_of(pooled)


@given(NUMBERS, NUMBERS, ERRORS, ERRORS)
def test_subtract_adds_the_variances(first, second, error, other_error):
    found = subtract(as_estimate(first, error), as_estimate(second, other_error))
    assert found["value"] == pytest.approx(first - second)
    assert math.hypot(error, other_error) == error_of(found)


def test_pool_leaves_out_estimates_without_an_interval_if_others_have_one():
    unknown, missing = (as_estimate(1.0, 0.0) | {"interval": None, "value": v} for v in (1.0, None))
    assert pool([as_estimate(2.0, 1.0), unknown]) == pool([as_estimate(2.0, 1.0)])
    assert pool([unknown])["interval"] is None
    assert pool([unknown])["value"] == 1.0
    assert pool([as_estimate(2.0, 1.0), missing])["value"] == 2.0
    assert pool([missing])["value"] is None


def test_treat_every_treatment_has_the_same_donors(library):
    chosen = seam_tests.choose_donors(library, 2)
    treated = {name: seam_tests.treat(library, chosen, name) for name in seam_tests.TREATMENTS}
    donors = {
        tuple((own.group, own.segment, own.donor) for graft in own for own in graft.substitutions)
        for own in treated.values()
    }
    assert len(donors) == 1
    motions = {grafts[0].motion.rotations.tobytes() for grafts in treated.values()}
    assert len(motions) == len(treated)


@given(st.data(), st.integers(1, 12))
def test_keep_own_keeps_exactly_the_segments_that_are_kept(data, n):
    is_own = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    drawn = np.arange(100, 100 + n)
    kept = [SimpleNamespace(group="upper", segment=k, is_own=own) for k, own in enumerate(is_own)]
    donors = catalogue.keep_own(kept, {"upper": drawn})["upper"]
    np.testing.assert_array_equal(donors, np.where(is_own, np.arange(n), drawn))
    np.testing.assert_array_equal(drawn, np.arange(100, 100 + n))


def test_same_segments_and_random_donors_change_the_recording(recordings, library):
    studio, base = catalogue.Studio(library, recordings), library.clips[0]
    for motions in (studio.same_segments(0, 2), studio.random_donors(0, 2)):
        for motion in motions:
            assert_only_joints_change(motion, base, studio.joints, 0.1)
