"""Reading of BVH files: dialects, conventions, recordings, unusual and damaged files."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft.motion import rotations
from tests.dialects import Dialect, clips, dialects, layouts, to_text
from tests.fingerprint import fingerprint
from tests.fuzz import bvh as fuzz_bvh
from tests.fuzz import outcome
from tests.hierarchies import clip_name, mark_repeated_hierarchies
from tests.io.bvh_helpers import TEXT, assert_same_numbers, assert_same_skeleton, read, round_trip
from tests.io.recorded_files import ODD_FILES, RECORDINGS
from tests.strategies import few_examples


@few_examples(60)
@given(clips(), dialects())
def test_read_bvh_any_dialect_gives_same_clip(clip, dialect):
    motion = read(to_text(clip, dialect))
    assert_same_skeleton(motion.skeleton, clip.skeleton)
    assert motion.frame_time == clip.frame_time
    assert_same_numbers(motion.channel_values, clip.values)


@few_examples(40)
@given(clips(), layouts())
def test_read_bvh_white_space_is_not_a_repair(clip, layout):
    plain, other = (read(to_text(clip, dialect)).repairs for dialect in (Dialect(), layout))
    messages = [[repair.split(": ", 1)[1] for repair in repairs] for repairs in (plain, other)]
    assert sorted(messages[0]) == sorted(messages[1])


def _result(text, *, strict):
    """Return what is read from a text to the bit, or the error."""
    found = outcome(partial(read, strict=strict), text)
    if isinstance(found, mg.BvhError):
        return str(found)
    return fingerprint([found.skeleton, found.channel_values, found.repairs])


@settings(max_examples=150)
@given(clips(), st.data(), st.booleans())
def test_read_bvh_result_does_not_depend_on_the_file_before(clip, data, strict):
    """A file with nearly the hierarchy of the one before, beside one with another before."""
    text = TEXT.encode() if data.draw(st.booleans()) else to_text(clip, Dialect())
    end = text.index(b"MOTION")
    place = data.draw(st.integers(0, end + 8) | st.integers(end - 9, end))
    changes = [(0, b" "), (0, b"}"), (1, b""), (1, b"7"), (0, b"")]
    n_removed, added = data.draw(st.sampled_from(changes))
    other = text[:place] + added + text[place + n_removed :]
    read(TEXT.replace("Hips", "Root"))
    expected = _result(other, strict=strict)
    read(text)
    assert _result(other, strict=strict) == expected


@few_examples(40)
@given(clips())
def test_read_bvh_path_text_and_binary_files_are_equal(tmp_path_factory, clip):
    text = to_text(clip, Dialect())
    path = tmp_path_factory.mktemp("clips") / "walk 1.bvh"
    path.write_bytes(text)
    from_path = mg.read_bvh(path)
    assert (from_path.name, from_path.path) == ("walk 1", path)
    with path.open(encoding="utf-8", newline="") as file:
        from_text = mg.read_bvh(file)
    assert from_text.path == path
    assert read(text).path is None
    for other in (from_text, mg.read_bvh(str(path)), read(text)):
        assert_same_skeleton(other.skeleton, from_path.skeleton)
        assert_same_numbers(other.channel_values, from_path.channel_values)


@few_examples(60)
@given(clips(), st.booleans())
def test_read_bvh_channels_turn_and_move_joints_in_their_order(clip, add_offsets):
    """Signs are continuous; position channels replace the offsets, or are added to them."""
    values = np.clip(clip.values, -1e4, 1e4)
    motion = read(to_text(replace(clip, values=values), Dialect()), add_offsets=add_offsets)
    skeleton, quats = motion.skeleton, motion.rotations
    assert (np.einsum("fji,fji->fj", quats[1:], quats[:-1]) >= 0).all()
    assert (quats[0, :, 3] >= 0).all()
    turned = np.tile(rotations.IDENTITY, (len(values), skeleton.n_joints, 1))
    moved = np.tile(skeleton.offsets, (len(values), 1, 1))
    for joint, columns in enumerate(skeleton.channel_columns):
        for name, column in zip(skeleton.channels[joint], columns, strict=True):
            axis, own = "XYZ".index(name[0]), values[:, column]
            if name.endswith("rotation"):
                step = rotations.from_axis_angle(np.eye(3)[axis], np.radians(own))
                turned[:, joint] = rotations.multiply(turned[:, joint], step)
            else:
                moved[:, joint, axis] = own + moved[:, joint, axis] * add_offsets
    np.testing.assert_allclose(rotations.angle(quats, turned), 0.0, atol=1e-11)
    np.testing.assert_array_equal(motion.positions, moved)
    # The written file gives the same positions without add_offsets.
    np.testing.assert_array_equal(round_trip(motion).positions, moved)


def test_read_bvh_invalid_source_raises_error():
    with pytest.raises(TypeError, match="`source` must be a path or a file object, got int"):
        mg.read_bvh(3)
    with pytest.raises(FileNotFoundError):
        mg.read_bvh("no/such/file.bvh")


@given(st.integers(0, 2**32))
def test_read_bvh_damaged_file_is_read_or_raises_bvh_error(seed):
    fuzz_bvh.check(seed)


@pytest.mark.parametrize("path", RECORDINGS, ids=clip_name)
def test_bvh_recording_round_trips(path):
    motion = mg.read_bvh(path)
    again = round_trip(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)
    assert_same_numbers(again.rotations, motion.rotations)
    assert again.frame_time == motion.frame_time


@pytest.mark.parametrize("path", ODD_FILES, ids=clip_name)
def test_read_bvh_unusual_file_round_trips_or_is_refused_with_position(path):
    motion = outcome(mg.read_bvh, path)
    if isinstance(motion, mg.BvhError):
        assert re.search(rf"{path.name}:\d+:\d+: expected .*, got ", str(motion))
        return
    assert np.isfinite(motion.channel_values).all()
    again = round_trip(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)


ONE_PER_HIERARCHY = mark_repeated_hierarchies(RECORDINGS)


@pytest.mark.parametrize("path", ONE_PER_HIERARCHY, ids=clip_name)
def test_world_positions_equal_pybvh(path, tmp_path):
    pybvh = pytest.importorskip("pybvh", reason="pybvh is not installed")
    try:
        clip = pybvh.read_bvh_file(path, world_up="+y")
    except (ValueError, KeyError, IndexError) as error:
        pytest.skip(f"pybvh does not read it: {error}")
    joints = [n for n, node in enumerate(clip.nodes) if not node.is_end_site()]
    expected = clip.node_positions()[:, joints]
    height = max(float(np.ptp(expected[0], axis=0).max()), 1e-9)
    motion = mg.read_bvh(path)
    np.testing.assert_allclose(motion.world_positions(), expected, rtol=0, atol=1e-4 * height)
    # pybvh reads the same numbers from the written file as from the original.
    mg.write_bvh(motion, tmp_path / "again.bvh")
    again = pybvh.read_bvh_file(tmp_path / "again.bvh", world_up="+y")
    np.testing.assert_array_equal(again.joint_angles, clip.joint_angles)
    np.testing.assert_array_equal(again.root_pos, clip.root_pos)
