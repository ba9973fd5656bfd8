"""Writing of BVH files."""

import io
from dataclasses import replace
from decimal import Decimal
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import mograft as mg
from mograft.io.bvh import writer
from mograft.motion import rotations
from tests.dialects import Clip, Dialect, clips, motions, to_text
from tests.io.bvh_helpers import TEXT, assert_same_numbers, read, round_trip
from tests.strategies import few_examples, still_motion


def angle_columns(skeleton):
    names = [name for channels in skeleton.channels for name in channels]
    return np.flatnonzero([name.endswith("rotation") for name in names])


@few_examples(40)
@given(motions())
def test_write_bvh_computed_motion_fills_its_channels_with_continuous_angles(motion):
    again = round_trip(motion)
    skeleton = motion.skeleton
    steps = np.diff(again.channel_values[:, angle_columns(skeleton)], axis=0)
    assert (np.abs(steps) <= 180.0 + 1e-5).all()
    for joint, channels in enumerate(skeleton.channels):
        if len(skeleton.rotation_order(joint)) == 3:
            off = rotations.angle(again.rotations[:, joint], motion.rotations[:, joint])
            np.testing.assert_allclose(off, 0.0, atol=1e-7)
        for axis, letter in enumerate("XYZ"):
            if f"{letter}position" in channels:
                places = again.positions[:, joint, axis], motion.positions[:, joint, axis]
                np.testing.assert_array_equal(*places)


@given(clips(), st.data())
def test_write_bvh_changed_joint_keeps_other_numbers(clip, data):
    # Angles of many turns would limit the precision of computed angles near them.
    motion = read(to_text(replace(clip, values=clip.values % 1e3), Dialect()))
    skeleton = motion.skeleton
    joint = data.draw(st.integers(0, skeleton.n_joints - 1))
    frames = slice(*sorted(data.draw(st.tuples(*[st.integers(0, motion.n_frames)] * 2))))
    columns = list(skeleton.channel_columns[joint])
    values = motion.channel_values.copy()
    values[frames, columns] = np.nan
    turned = motion.rotations.copy()
    turned[frames, joint] = rotations.from_axis_angle([1.0, 2.0, 3.0], 0.7)
    again = round_trip(replace(motion, rotations=turned, channel_values=values))
    known = ~np.isnan(values)
    assert_same_numbers(again.channel_values[known], values[known])
    if len(skeleton.rotation_order(joint)) == 3:
        off = rotations.angle(again.rotations[frames, joint], turned[frames, joint])
        np.testing.assert_allclose(off, 0.0, atol=1e-7)


DIGITS = st.none() | st.integers(1, 12)


@few_examples(40)
@given(motions(), DIGITS)
def test_write_bvh_computed_angles_are_off_by_half_a_unit_of_the_last_decimal(motion, digits):
    exact, written = motion.channel_numbers(), round_trip(motion, digits=digits).channel_values
    columns = angle_columns(motion.skeleton)
    others = np.setdiff1d(np.arange(exact.shape[1]), columns)
    np.testing.assert_array_equal(written[:, others], exact[:, others])
    off, spacing = np.abs(written - exact)[:, columns], np.spacing(np.abs(exact[:, columns]))
    assert (off <= 0.5 * 10.0 ** -(digits or 6) + spacing).all()
    for number in written[:, columns].ravel().tolist():
        assert Decimal(repr(number)) == round(Decimal(repr(number)), digits or 6)


@few_examples(40)
@given(motions() | clips().map(lambda clip: read(to_text(clip, Dialect()))), DIGITS)
def test_write_bvh_file_that_is_read_is_written_again_unchanged(motion, digits):
    first, second = io.BytesIO(), io.BytesIO()
    mg.write_bvh(motion, first, digits=digits)
    first.seek(0)
    mg.write_bvh(mg.read_bvh(first), second)
    assert second.getvalue() == first.getvalue()


@given(st.integers(0, 12), st.integers(0, 10), st.data())
def test_write_bvh_computed_angles_have_decimals_of_file(digits, frame, data):
    units = st.integers(-179 * 10**digits, 179 * 10**digits).filter(lambda n: n % 10)
    angles = data.draw(st.lists(st.tuples(units, units, units), min_size=12, max_size=12))
    values = np.array(angles) / 10.0**digits
    values[frame] = np.nan
    channels = ("Xrotation", "Yrotation", "Zrotation")
    skeleton = mg.Skeleton(("a",), [-1], np.zeros((1, 3)), (channels,))
    turned = rotations.from_euler(np.ones((12, 1, 3)), "XYZ")
    motion = mg.Motion(skeleton, 0.1, turned, np.zeros((12, 1, 3)), channel_values=values)
    computed = motion.channel_numbers()[frame].tolist()
    written = round_trip(motion).channel_values
    assert_same_numbers(np.delete(written, frame, axis=0), np.delete(values, frame, axis=0))
    assert written[frame].tolist() == [round(x, max(digits, 6)) for x in computed]


@given(clips(), st.data())
def test_write_bvh_computed_values_are_rounded_and_all_others_kept(clip, data):
    motion = read(to_text(clip, Dialect()))
    values = motion.channel_values
    is_computed = data.draw(npst.arrays(bool, values.shape))
    written = round_trip(replace(motion, computed_values=is_computed), digits=2).channel_values
    is_angle = np.isin(np.arange(values.shape[1]), angle_columns(motion.skeleton))
    assert_same_numbers(written[~is_computed | ~is_angle], values[~is_computed | ~is_angle])
    rounded = written[is_computed & is_angle].tolist()
    assert rounded == [round(x, 2) for x in values[is_computed & is_angle].tolist()]
    sliced = replace(motion, computed_values=is_computed)[-1:]
    assert_same_numbers(round_trip(sliced, digits=2).channel_values, written[-1:])


@pytest.mark.parametrize("digits", [0, 13, 6.0, True, "6"])
def test_write_bvh_invalid_digits_raises_value_error(digits):
    with pytest.raises(ValueError, match="`digits` must be an integer from 1 to 12, got"):
        mg.write_bvh(read(TEXT), io.BytesIO(), digits=digits)


def test_write_bvh_joints_in_other_order_are_written_depth_first():
    names = ("root", "left", "right", "left hand", "right hand")
    skeleton = mg.Skeleton(names, np.array([-1, 0, 0, 1, 2]), np.eye(5, 3))
    turned = rotations.from_axis_angle([0, 1, 0], np.arange(10.0).reshape(2, 5) / 9)
    motion = mg.Motion(skeleton, 0.1, turned, np.tile(skeleton.offsets, (2, 1, 1)))
    again = round_trip(motion, digits=12)
    assert again.skeleton.names == ("root", "left", "left hand", "right", "right hand")
    order = [0, 1, 3, 2, 4]
    off = rotations.angle(again.rotations, motion.rotations[:, order])
    np.testing.assert_allclose(off, 0.0, atol=1e-12)


def test_write_bvh_path_text_and_binary_files_are_equal(tmp_path):
    motion = read(TEXT)
    as_text, as_bytes = io.StringIO(), io.BytesIO()
    mg.write_bvh(motion, as_text)
    mg.write_bvh(motion, as_bytes)
    mg.write_bvh(motion, tmp_path / "a.bvh")
    assert as_text.getvalue() == as_bytes.getvalue().decode() == TEXT
    assert (tmp_path / "a.bvh").read_bytes() == TEXT.encode()


def test_write_bvh_error_keeps_previous_file(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text("previous")
    motion = read(TEXT)
    failure = patch.object(writer._core, "format_rows", side_effect=MemoryError)
    with failure, pytest.raises(MemoryError):
        mg.write_bvh(motion, path)
    assert path.read_text() == "previous"
    mg.write_bvh(motion, path)
    assert path.read_text() == TEXT
    assert [child.name for child in tmp_path.iterdir()] == ["walk.bvh"]


@few_examples(40)
@given(motions())
def test_write_bvh_any_motion_equals_oracle(motion):
    file = io.BytesIO()
    mg.write_bvh(motion, file)
    clip = Clip(motion.skeleton, motion.frame_time, np.empty((0, 0)))
    texts = file.getvalue(), to_text(clip, Dialect())
    assert len({text.split(b"MOTION\n")[0] for text in texts}) == 1


@pytest.mark.parametrize("name", ["", "a\nb", "a{b", " a", "a\t", "\ud800"])
def test_write_bvh_invalid_joint_name_raises_value_error(name):
    motion = read(TEXT)
    skeleton = replace(motion.skeleton, names=("Hips", name))
    with pytest.raises(ValueError, match="joint 1 "):
        mg.write_bvh(replace(motion, skeleton=skeleton), io.BytesIO())


def test_write_bvh_no_channels_raises_value_error():
    still = still_motion(mg.Skeleton(["a"], [-1], [[0, 0, 0]], [[]]), 1)
    assert still.skeleton.n_channels == 0
    with pytest.raises(ValueError, match="must have at least one channel"):
        mg.write_bvh(still, io.BytesIO())
