"""Laws of `Motion`."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from tests import dialects
from tests.strategies import few_examples


@given(st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_channel_blocks_of_any_length_give_the_same_numbers(length, seed):
    """Also where angles are derived from those of the frame before, or of a later frame."""
    rng = np.random.default_rng(seed)
    skeleton = Skeleton(["Hips", "Spine"], [-1, 0], [[0, 0, 0], [0, 1, 0]])
    quats = rotations.exp(rng.normal(scale=2.0, size=(12, 2, 3)))
    values = Motion(skeleton, 1 / 30, quats, rng.normal(size=(12, 2, 3))).channel_numbers()
    values[rng.random(values.shape) < 0.3] = np.nan
    values[: rng.integers(12), 6:] = np.nan
    motion = Motion(skeleton, 1 / 30, quats, np.zeros((12, 2, 3)), values)
    blocks = np.concatenate(list(motion.channel_blocks(length)))
    np.testing.assert_array_equal(blocks, motion.channel_numbers())


CHANNEL = Skeleton(["Hips"], [-1], [[0, 0, 0]], [["Yrotation"]])


def of_values(values, computed=None):
    """Return a motion of one channel, given its values."""
    n_frames = len(values)
    quats, places = [[[0, 0, 0, 1]]] * n_frames, np.zeros((n_frames, 1, 3))
    return Motion(CHANNEL, 0.5, quats, places, values, computed)


@given(st.lists(st.none() | st.integers(-(2**40), 2**40), min_size=1), st.booleans())
def test_motion_channel_values_may_be_any_array_like(values, is_computed):
    expected = np.array([[np.nan if value is None else float(value)] for value in values])
    motion = of_values(expected.tolist(), [[is_computed]] * len(values))
    np.testing.assert_array_equal(motion.channel_values, expected)
    numbers = motion.channel_numbers()
    np.testing.assert_array_equal(numbers, np.nan_to_num(expected, nan=numbers))
    assert (motion.is_computed(numbers) == (is_computed | np.isnan(expected))).all()
    if None not in values:
        whole = of_values(expected.astype(int))
        np.testing.assert_array_equal(whole.channel_numbers(), expected)


def test_motion_invalid_channel_array_raises_error():
    for values, computed, message in (
        ([[1.0]] * 2, [[True]], r"`computed_values` must have shape \(2, 1\)"),
        ([[1.0, 2.0]], None, r"`channel_values` must have shape \(1, 1\)"),
        ([[1.0], [-np.inf]], None, r"must be finite or NaN, got -inf at \[1, 0\]"),
        ([["a"]], None, "`channel_values` must be an array of float64, got <U1"),
        ([[1.0]], [[0.5]], "`computed_values` must be an array of bool, got float64"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            of_values(values, computed)


def test_resample_motion_with_computed_values_forgets_them():
    motion = of_values([[0.0], [0.0], [0.0]], [[True], [False], [True]])
    resampled = motion.resample(4)
    assert resampled.n_frames == 5
    assert resampled.channel_values is resampled.computed_values is None


@few_examples(40)
@given(dialects.motions(), st.integers(1, 5), st.data())
def test_channel_numbers_of_unknown_joints_equal_angles_of_each_joint(motion, length, data):
    skeleton = motion.skeleton
    expected = motion.channel_numbers()
    for joint, columns in enumerate(skeleton.rotation_columns):
        order = skeleton.rotation_order(joint)
        angles = rotations.to_euler(motion.rotations[:, joint], order)
        np.testing.assert_array_equal(expected[:, columns], np.degrees(angles))
    # Known angles of some joints change nothing in the angles of the others.
    values = np.full(expected.shape, np.nan)
    for columns in skeleton.channel_columns:
        if data.draw(st.booleans()):
            values[:, columns] = expected[:, columns]
    partly = replace(motion, channel_values=values)
    blocks = np.concatenate(list(partly.channel_blocks(length)))
    np.testing.assert_array_equal(blocks, expected)
