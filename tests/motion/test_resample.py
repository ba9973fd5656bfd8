"""Properties of resampling and of the curves through frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.motion import resample, rotations
from tests import strategies
from tests.oracles import rotations as oracle

BOTH = pytest.mark.parametrize("curve", [resample.slerp, resample.cubic])


@strategies.few_examples(40)
@BOTH
@given(track=strategies.rotation_tracks(), time=st.floats(-1, 9))
def test_curve_has_unit_norm_and_returns_frames_at_their_times(curve, track, time):
    times, quats = track
    norms = np.linalg.norm(curve(*track, [time]), axis=-1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-14)
    strategies.assert_same_rotations(curve(times, quats, times), quats)
    np.testing.assert_array_equal(curve(times, quats, times[:1]), quats[:1])


@BOTH
@given(velocity=strategies.vectors((2,), size=1.5), time=st.floats(0, 1))
def test_constant_velocity_motion_is_reproduced(curve, velocity, time):
    times = np.array([0.0, 0.1, 0.4, 0.5, 0.9, 1.0])
    quats = rotations.exp(velocity * times[:, None, None])
    found, expected = curve(times, quats, [time])[0], rotations.exp(velocity * time)
    strategies.assert_same_rotations(found, expected, 1e-12)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=8), st.floats(0, 1))
def test_cubic_about_one_axis_matches_scalar_hermite(angles, share):
    times = np.linspace(0.0, 1.0, len(angles))
    quats = rotations.from_axis_angle([0, 1, 0], angles)[:, None]
    positions = np.zeros((len(angles), 1, 3))
    positions[:, 0, 1] = angles
    angles_of_curve = rotations.log(resample.cubic(times, quats, [share]))
    expected = resample.cubic_positions(times, positions, [share])
    np.testing.assert_allclose(angles_of_curve, expected, atol=1e-12)


@given(strategies.SEEDS, st.integers(2, 9), st.integers(2, 40))
def test_resample_segments_matches_cubic_of_segment_frames(seed, n_frames, count):
    quats = strategies.smooth_rotations(np.random.default_rng(seed), n_frames + 4, 2)
    segment = quats[2 : 2 + n_frames]
    resampled = resample.resample_segments(quats, [2], [1 + n_frames], [count])
    times = np.linspace(0, n_frames - 1, count)
    curves = [resample.cubic(np.arange(n_frames), segment, times), oracle.resample(segment, count)]
    if n_frames == 2:
        curves.append(resample.slerp(np.arange(2), segment, times))
    for expected in curves:
        strategies.assert_same_rotations(resampled, expected, 1e-12)


@given(strategies.motions(min_frames=6), st.integers(1, 5))
def test_resample_segments_same_or_multiple_count_keeps_frames(motion, times):
    last = motion.n_frames - 1
    same = resample.resample_segments(motion.rotations, [0], [last], [last + 1])
    np.testing.assert_array_equal(same, motion.rotations)
    finer = resample.resample_segments(motion.rotations, [0], [last], [times * last + 1])
    np.testing.assert_array_equal(finer[::times], motion.rotations)
    backward = resample.resample_segments(finer, [0], [times * last], [last + 1])
    np.testing.assert_array_equal(backward, motion.rotations)
    bounds = [0], [last], [times * last + 1]
    positions = resample.resample_segment_positions(motion.positions, *bounds)
    np.testing.assert_array_equal(positions[::times], motion.positions)


@given(strategies.SEEDS)
def test_resample_segments_many_equal_one_by_one(seed):
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, 30, 7)
    bounds = starts, starts + rng.integers(1, 10, 7), rng.integers(0, 15, 7)
    for track, curve in (
        (strategies.smooth_rotations(rng, 40, 3), resample.resample_segments),
        (rng.normal(size=(40, 3, 3)), resample.resample_segment_positions),
    ):
        one_by_one = [curve(track, [a], [b], [c]) for a, b, c in zip(*bounds, strict=True)]
        np.testing.assert_array_equal(curve(track, *bounds), np.concatenate(one_by_one))


@given(strategies.motions(min_frames=4), st.floats(5, 200))
def test_motion_resample_keeps_duration_and_end_frames(motion, rate):
    other = motion.resample(rate)
    assert other.duration == pytest.approx(motion.duration, rel=1e-12)
    for end in (0, -1):
        np.testing.assert_array_equal(other.rotations[end], motion.rotations[end])
        np.testing.assert_array_equal(other.positions[end], motion.positions[end])
    assert motion.resample(motion.rate) is motion


def test_resample_invalid_arguments_raise_value_error():
    identity = np.tile([0.0, 0.0, 0.0, 1.0], (5, 1, 1))
    for times, message in (
        ([0.0], "shape"),
        ([0.0, 0.0], "strictly increase"),
        ([0.0, np.inf], r"`times` must be finite, got inf at \[1\]"),
    ):
        for curve in (resample.slerp, resample.cubic):
            with pytest.raises(ValueError, match=message):
                curve(times, identity[:2], [0.0])
    for bounds, message in (
        (([0], [5], [3]), "segment 0 must lie within the clip"),
        (([0, 2], [1, 2], [3, 3]), "segment 1 must lie within the clip and span"),
        (([-1], [1], [3]), "`starts` must not be negative, got -1"),
        (([0], [1, 2], [3]), "`stops` must have shape"),
    ):
        with pytest.raises(ValueError, match=message):
            resample.resample_segments(identity, *bounds)
