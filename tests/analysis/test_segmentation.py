"""Kinetic energy, its extrema, and segmentation at them, of whole and of growing motions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.ndimage import gaussian_filter1d

import mograft as mg
from mograft import Config, Motion, Segments, Skeleton, kinetic_energy, segment
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import OnlineSegmenter, extrema
from mograft.body.mass import mass_model, moments_of_inertia
from mograft.dancer import dance
from mograft.motion import rotations
from tests.oracles import analysis as oracle
from tests.strategies import SEEDS, motions

INDICES = st.one_of(
    st.slices(9),
    npst.arrays(np.bool_, 9),
    npst.arrays(np.int64, st.integers(0, 20), elements=st.integers(-9, 8)),
)

CURVES = npst.arrays(np.float64, st.integers(4, 200), elements=st.floats(0, 1e3))


def chain(n_joints=3):
    """A chain of bones along x, each 10 long."""
    offsets = np.zeros((n_joints, 3))
    offsets[1:, 0] = 10.0
    return Skeleton([f"bone{j}" for j in range(n_joints)], np.arange(n_joints) - 1, offsets)


def steady_rotation(skeleton, joint, speed, n_frames=20, frame_time=0.02):
    """A motion of one joint that rotates about y at a constant speed in radians per second."""
    quats = np.tile(rotations.IDENTITY, (n_frames, skeleton.n_joints, 1))
    quats[:, joint] = rotations.from_axis_angle([0, 1, 0], speed * frame_time * np.arange(n_frames))
    return Motion(skeleton, frame_time, quats, np.tile(skeleton.offsets, (n_frames, 1, 1)))


@given(st.integers(0, 2), st.floats(0.1, 8.0))
def test_kinetic_energy_steady_rotation_is_half_i_omega_squared(joint, speed):
    skeleton = chain()
    motion = steady_rotation(skeleton, joint, speed)
    moments = moments_of_inertia(mass_model(skeleton), skeleton, "own")
    expected = 0.5 * moments[joint:].sum() * speed**2
    np.testing.assert_allclose(kinetic_energy(motion), expected, rtol=1e-9)
    expected = 0.5 * moments[joint] * speed**2
    np.testing.assert_allclose(kinetic_energy(motion, omega="local"), expected, rtol=1e-9)


@given(motions(min_joints=2), SEEDS)
def test_kinetic_energy_equals_oracle_for_any_signs_of_quaternions(motion, seed):
    skeleton = motion.skeleton
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (*motion.rotations.shape[:2], 1))
    motion = replace(motion, rotations=signs * motion.rotations)
    moments = moments_of_inertia(mass_model(skeleton), skeleton, "own")
    expected = oracle.kinetic_energy(skeleton.parents, motion.rotations, moments, motion.frame_time)
    np.testing.assert_allclose(kinetic_energy(motion), expected, rtol=1e-9, atol=1e-14)


@given(CURVES, st.floats(0, 6))
def test_gaussian_filter_equals_scipy(curve, sigma):
    expected = gaussian_filter1d(curve, sigma) if sigma >= 0.125 else curve
    np.testing.assert_allclose(gaussian_filter(curve, sigma), expected, rtol=1e-9, atol=1e-9)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=80), st.floats(0.1, 1e3))
@example([0, 1, 1, 1, 0, 2, 2, 3, 3, 0], 1.0)
def test_extrema_equal_those_of_oracle(levels, scale):
    curve = scale * np.array(levels)
    np.testing.assert_array_equal(extrema(curve), oracle.turning_points(curve))


@given(
    motions(min_frames=2, max_frames=200, min_joints=2), st.sampled_from((Config(), Config.paper()))
)
def test_segment_equals_oracle(motion, config):
    bounds = oracle.segment_bounds(kinetic_energy(motion), motion.rate, config)
    segments = segment(motion, config)
    np.testing.assert_array_equal([*segments.start, segments.stop[-1]], bounds)


@given(motions(min_frames=2, max_frames=50), st.floats(0.01, 0.99))
def test_segment_max_length_below_one_interval_counts_as_one_interval(motion, intervals):
    seconds = intervals * motion.frame_time
    config = Config(min_length=seconds / 4, max_length=seconds)
    assert (segment(motion, config).lengths == 1).all()


@given(SEEDS)
def test_segment_still_motion_is_split_only_at_max_length(seed):
    n_frames = int(np.random.default_rng(seed).integers(2, 400))
    still = steady_rotation(chain(), 0, 0.0, n_frames, 1 / 30)
    assert len(segment(still, Config.paper())) == 1
    assert len(segment(still)) == max(int(np.ceil((n_frames - 1) / 60)), 1)


def test_segmentation_invalid_arguments_raise_value_error():
    single = steady_rotation(chain(), 0, 0.0, 1)
    with pytest.raises(ValueError, match="kinetic energy needs at least 2 frames"):
        segment(single)
    for seconds in (2e-5, 9e-5, 1.01, 30.0):
        motion = replace(DANCER, frame_time=seconds, name="walk")
        with pytest.raises(ValueError, match=r"frame time of walk must be between 0.0001 and 1 s"):
            segment(motion)
    for message, call in (
        ("segment 1 must stop after its start, got 4 to 4", lambda: Segments([0, 4], [4, 4])),
        ("`start` must have shape", lambda: Segments([0], [8])[np.array([[0, 0]])]),
        ("`parts` must have at least one Segments, got none", lambda: Segments.concatenate([])),
        ("`parts` must be a Segments, got int", lambda: Segments.concatenate([3])),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            call()
    for name in ("omega", "inertia"):
        for value in ("heavy", ["own"], None):
            with pytest.raises(ValueError, match=f"`{name}` must be one of .*, got "):
                kinetic_energy(steady_rotation(chain(), 0, 1.0), **{name: value})


DANCER = dance(strides=1, seed=3).motion


def bounds_of(segments):
    return np.append(segments.start, segments.stop[-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "energi"}, "`segmentation` must be one of 'energy', .*; did you mean 'energy'"),
        ({"method": [5, 4]}, "cut frames in `method` must be ascending whole numbers"),
        ({"method": [4.5]}, "cut frames in `method` must be ascending whole numbers"),
        ({"method": [[1, 2], [3]]}, "cut frames in `method` must be ascending whole numbers"),
        ({"method": [10**6]}, f"must be at most {DANCER.n_frames - 1}, its last frame"),
        ({"method": lambda _: "a"}, "cut frames that `segmentation` returned for dance"),
        ({"method": {"waltz": [5]}}, "must have cut frames for every clip, got none for 'dance'"),
    ],
)
def test_invalid_method_raises_value_error(arguments, message):
    with pytest.raises(ValueError, match=message):
        segment(DANCER, **arguments)


@given(st.sets(st.integers(0, DANCER.n_frames - 1), max_size=20).map(sorted))
def test_given_cut_frames_are_neither_merged_nor_split(frames):
    expected = np.unique([0, *frames, DANCER.n_frames - 1])
    for method in (frames, lambda _: np.array(frames), {DANCER.name: frames}):
        np.testing.assert_array_equal(bounds_of(segment(DANCER, method=method)), expected)


@given(INDICES)
def test_segments_selected_equal_segments_of_selected_frames(indices):
    start = np.arange(0, 90, 10)
    segments = Segments(start, start + np.arange(1, 10), start % 4)
    chosen = segments[indices]
    expected = Segments(start[indices], segments.stop[indices], segments.clip[indices])
    for name in ("start", "stop", "clip"):
        column = getattr(chosen, name)
        np.testing.assert_array_equal(column, getattr(expected, name))
        assert column.flags.c_contiguous
        assert not column.flags.writeable
        assert not np.shares_memory(column, getattr(segments, name))


def segment_bounds(energies, config, rate=30.0):
    """Return the bounds after all energies are pushed at once."""
    segmenter = OnlineSegmenter(rate, config)
    segmenter.push(energies)
    segmenter.close()
    return segmenter.bounds


@given(SEEDS, st.integers(1, 300), st.lists(st.integers(1, 50), min_size=1, max_size=5))
def test_online_segmenter_any_chunks_bounds_are_final_and_within_length_limits(seed, n, chunks):
    rng = np.random.default_rng(seed)
    energies = np.abs(np.cumsum(rng.normal(size=n + 1)))
    energies[rng.integers(n) :][:80] = 1.0  # a constant interval, without extrema
    config = mg.Config(max_length=1.0)
    segmenter, final = OnlineSegmenter(30.0, config), []
    first, n_pushes = 0, 0
    while first < len(energies):
        size = chunks[n_pushes % len(chunks)]
        segmenter.push(energies[first : first + size])
        assert segmenter.bounds[: len(final)] == final
        final, first, n_pushes = list(segmenter.bounds), first + size, n_pushes + 1
    segmenter.close()
    assert segmenter.bounds[: len(final)] == final
    assert segmenter.bounds == segment_bounds(energies, config)
    bounds = np.array(segmenter.bounds)
    assert bounds[0] == 0
    assert bounds[-1] == n
    if n >= 3:
        assert np.diff(bounds).min() >= 3
    assert np.diff(bounds).max() <= 30


@given(SEEDS, st.integers(40, 300))
def test_online_segmenter_without_merges_cuts_at_all_extrema(seed, n):
    rng = np.random.default_rng(seed)
    phase, pace = rng.uniform(0, 6), rng.uniform(0.15, 0.4)
    energies = 2.0 + np.cos(phase + pace * np.arange(n)) + 0.3 * np.sin(0.05 * np.arange(n))
    config = mg.Config(min_length=1 / 30, max_length=100.0)
    inner = extrema(gaussian_filter(energies, config.smoothing * 30.0))
    expected = [0, *(int(frame) for frame in inner if 0 < frame < n - 1), n - 1]
    assert segment_bounds(energies, config) == expected


@pytest.mark.parametrize("seed", [0, 4])
def test_online_segmenter_dance_equals_segment(seed):
    motion = dance(seed=seed, strides=1).motion
    bounds = segment_bounds(mg.kinetic_energy(motion), mg.Config(), motion.rate)
    assert bounds == [0, *mg.segment(motion).stop.tolist()]


def test_online_segmenter_max_length_below_one_interval_cuts_at_all_frames():
    energies = np.linspace(1.0, 2.0, 20)
    assert segment_bounds(energies, mg.Config(max_length=0.5), 1.0) == list(range(20))
