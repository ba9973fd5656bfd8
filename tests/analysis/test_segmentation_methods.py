"""Laws of segments, and of cut frames that the user gives."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Motion, segment
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.motion import rotations
from tests.strategies import few_examples

DANCER = dance(strides=1, seed=3).motion


def still_motion(n_frames, heights=0.0, skeleton=DANCER.skeleton, rate=30.0):
    """A figure in its rest pose, raised by `heights` statures."""
    quats = np.tile(rotations.IDENTITY, (n_frames, skeleton.n_joints, 1))
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    positions[:, 0, 1] += np.asarray(heights) * mass_model(skeleton).height
    return Motion(skeleton, 1.0 / rate, quats, positions, name="still")


def bounds_of(segments):
    return np.append(segments.start, segments.stop[-1])


@few_examples(15)
@given(n_frames=st.integers(2, 240), first=st.integers(0, 100), rate=st.sampled_from([24.0, 90.0]))
def test_segments_tile_the_motion_within_the_length_limits(n_frames, first, rate):
    motion = replace(DANCER[first : first + n_frames], frame_time=1.0 / rate)
    config = Config()
    segments = segment(motion, config)
    bounds = bounds_of(segments)
    assert (bounds[0], bounds[-1]) == (0, motion.n_frames - 1)
    np.testing.assert_array_equal(segments.start[1:], segments.stop[:-1])
    if len(segments) > 1:
        assert segments.lengths.min() >= round(config.min_length * rate)
    assert segments.lengths.max() <= config.max_length * rate


@pytest.mark.parametrize("n_frames", [2, 30, 400])
def test_constant_motion_has_no_cut_frames(n_frames):
    segments = segment(still_motion(n_frames), Config(max_length=np.inf))
    assert len(segments) == 1


def test_cuts_are_the_same_in_any_unit_and_at_any_place():
    motion = dance(strides=2).motion
    sites = [replace(s, offset=0.25 * np.array(s.offset)) for s in motion.skeleton.end_sites]
    skeleton = replace(
        motion.skeleton, offsets=0.25 * motion.skeleton.offsets, end_sites=tuple(sites)
    )
    positions = 0.25 * motion.positions
    positions[:, 0] += [64.0, 0.0, -32.0]
    moved = Motion(skeleton, motion.frame_time, motion.rotations, positions)
    own, other = (bounds_of(segment(m)) for m in (motion, moved))
    np.testing.assert_array_equal(own, other)


def test_motion_of_one_frame_raises_value_error():
    with pytest.raises(ValueError, match="needs at least 2 frames, still has 1"):
        segment(still_motion(1))


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
