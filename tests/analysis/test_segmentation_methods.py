"""Laws of segments, and of cut frames that the user gives."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, segment
from mograft.dancer import dance
from tests.strategies import few_examples

DANCER = dance(strides=1, seed=3).motion


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
