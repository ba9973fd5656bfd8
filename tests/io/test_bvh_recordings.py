"""Recorded BVH files, and unusual ones from other programs."""

import re

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from tests.hierarchies import mark_repeated_hierarchies
from tests.io.bvh_helpers import assert_same_numbers, assert_same_skeleton, round_trip
from tests.io.recorded_files import DATA, ODD, ODD_FILES, RECORDINGS, file_id, require


@pytest.mark.parametrize("path", RECORDINGS, ids=file_id)
def test_bvh_recording_round_trips(path):
    motion = mg.read_bvh(require(path, DATA))
    again = round_trip(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)
    assert_same_numbers(again.rotations, motion.rotations)
    assert again.frame_time == motion.frame_time
    summary = formats.scan_bvh(path)
    assert summary.n_frames == summary.declared_frames


def expected_behaviours():
    """The behaviour that the list of unusual files states, by file name."""
    table = ODD / "README.md"
    if not table.exists():
        return {}
    rows = re.findall(
        r"^\| (\w+) \| [^\n]*?\| ((?:accept|clear reject|reject)[^|]*)\|", table.read_text(), re.M
    )
    return dict(rows)


EXPECTED_BEHAVIOURS = expected_behaviours()


@pytest.mark.parametrize("path", ODD_FILES, ids=file_id)
def test_read_bvh_unusual_file_behaves_as_listed(path):
    expected = EXPECTED_BEHAVIOURS[require(path, ODD).stem]
    if not re.search("accept|or ", expected):
        with pytest.raises(mg.BvhError, match=rf"{path.name}:\d+:\d+: expected .*, got "):
            mg.read_bvh(path)
        return
    try:
        motion = mg.read_bvh(path)
    except mg.BvhError:
        if "reject" in expected:
            return
        raise
    if counts := re.search(
        r"\((\d+) joints?, (?:\d+ channels, )?(\d+)(?: or (\d+))? frames?", expected
    ):
        joints, *frames = (int(count) for count in counts.groups() if count)
        assert motion.n_joints == joints
        assert motion.n_frames in frames
    assert np.isfinite(motion.channel_values).all()
    again = round_trip(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)


def test_unusual_files_are_all_listed():
    require(ODD_FILES[0], ODD)
    assert {path.stem for path in ODD_FILES} == set(EXPECTED_BEHAVIOURS)


ONE_PER_HIERARCHY = mark_repeated_hierarchies(RECORDINGS)
# pymotion misreads joints with fewer than three channels, and roots whose rotations come first.
UNSUPPORTED_BY_PYMOTION = ("rotation_first_root", "custom_skeleton_walk_example", "wd2_")


def assert_close(actual, desired):
    """Compare up to 1e-4 of the height of the skeleton."""
    assert actual.shape == desired.shape
    height = max(float(np.ptp(desired[0], axis=0).max()), 1e-9)
    assert np.abs(actual - desired).max() <= 1e-4 * height


def pybvh_positions(clip):
    joints = [n for n, node in enumerate(clip.nodes) if not node.is_end_site()]
    return clip.node_positions()[:, joints]


def read_with_pybvh(path):
    pybvh = pytest.importorskip("pybvh", reason="pybvh is not installed")
    try:
        return pybvh.read_bvh_file(path, world_up="+y")
    except (ValueError, KeyError, IndexError) as error:
        pytest.skip(f"pybvh does not read it: {error}")


@pytest.mark.parametrize("path", ONE_PER_HIERARCHY, ids=file_id)
def test_world_positions_equal_pybvh(path, tmp_path):
    clip = read_with_pybvh(require(path, DATA))
    motion = mg.read_bvh(path)
    assert_close(motion.world_positions(), pybvh_positions(clip))
    # pybvh reads the same numbers from the written file as from the original.
    mg.write_bvh(motion, tmp_path / "again.bvh")
    again = read_with_pybvh(tmp_path / "again.bvh")
    np.testing.assert_array_equal(again.joint_angles, clip.joint_angles)
    np.testing.assert_array_equal(again.root_pos, clip.root_pos)


def pymotion_positions(path, motion):
    """Return the world positions of the joints by the rotations that pymotion reads."""
    pymotion = pytest.importorskip("pymotion.io.bvh", reason="pymotion is not installed")
    clip = pymotion.BVH()
    try:
        clip.load(str(path))
        to_matrix, placed, parents, *_ = clip.get_data()
    except (ValueError, IndexError, AssertionError, TypeError) as error:
        pytest.skip(f"pymotion does not read it: {error}")
    scalar_last = np.ascontiguousarray(np.roll(to_matrix, -1, axis=-1), dtype=np.float64)
    parents = np.asarray([parent or 0 for parent in parents])
    parents[0] = -1
    skeleton = mg.Skeleton(motion.skeleton.names, parents, motion.skeleton.offsets)
    quats = scalar_last / np.linalg.norm(scalar_last, axis=-1, keepdims=True)
    return mg.Motion(skeleton, motion.frame_time, quats, placed).world_positions()


@pytest.mark.parametrize("path", ONE_PER_HIERARCHY, ids=file_id)
def test_world_positions_equal_pymotion(path):
    if require(path, DATA).stem.startswith(UNSUPPORTED_BY_PYMOTION):
        pytest.skip("pymotion misreads it")
    motion = mg.read_bvh(path)
    assert_close(motion.world_positions(), pymotion_positions(path, motion))
