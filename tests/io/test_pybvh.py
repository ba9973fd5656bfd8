"""World positions compared with pybvh, pymotion and bvhio; conversion to and from pybvh."""

import io
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.motion import rotations
from tests.dialects import motions
from tests.hierarchies import mark_repeated_hierarchies
from tests.io.recorded_files import DATA, RECORDINGS, file_id, require
from tests.strategies import few_examples

ONE_PER_HIERARCHY = mark_repeated_hierarchies(RECORDINGS)
# As a fraction of the height of the skeleton.
TOLERANCE = 1e-4


def height(positions):
    return max(float(np.ptp(positions[0], axis=0).max()), 1e-9)


def assert_close(actual, desired):
    assert actual.shape == desired.shape
    assert np.abs(actual - desired).max() <= TOLERANCE * height(desired)


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
    assert_close(formats.from_pybvh(clip).world_positions(), pybvh_positions(clip))
    # pybvh reads the same numbers from the written file as from the original.
    mg.write_bvh(motion, tmp_path / "again.bvh")
    again = read_with_pybvh(tmp_path / "again.bvh")
    np.testing.assert_array_equal(again.joint_angles, clip.joint_angles)
    np.testing.assert_array_equal(again.root_pos, clip.root_pos)


@pytest.mark.parametrize("path", ONE_PER_HIERARCHY, ids=file_id)
def test_written_computed_angles_equal_pybvh(path, tmp_path):
    motion = mg.read_bvh(require(path, DATA))[:50]
    read_with_pybvh(path)
    new = mg.Motion(motion.skeleton, motion.frame_time, motion.rotations, motion.positions)
    mg.write_bvh(new, tmp_path / "new.bvh")
    clip = read_with_pybvh(tmp_path / "new.bvh")
    assert_close(pybvh_positions(clip), motion.world_positions())


# pymotion misreads joints with fewer than three channels, and roots whose rotations come first.
UNSUPPORTED_BY_PYMOTION = ("rotation_first_root", "custom_skeleton_walk_example", "wd2_")


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
    other = mg.Motion(
        mg.Skeleton(motion.skeleton.names, parents, motion.skeleton.offsets),
        motion.frame_time,
        scalar_last / np.linalg.norm(scalar_last, axis=-1, keepdims=True),
        placed,
    )
    return other.world_positions()


@pytest.mark.parametrize("path", ONE_PER_HIERARCHY, ids=file_id)
def test_world_positions_equal_pymotion(path):
    if require(path, DATA).stem.startswith(UNSUPPORTED_BY_PYMOTION):
        pytest.skip("pymotion misreads it")
    motion = mg.read_bvh(path)
    assert_close(motion.world_positions(), pymotion_positions(path, motion))


@pytest.fixture(scope="module")
def graft():
    return mg.graft(mg.Library.build(dance(seed=2, strides=1).motion[:400]), seed=5).motion


def test_written_graft_equal_in_pybvh_and_pymotion(graft, tmp_path):
    mg.write_bvh(graft, tmp_path / "graft.bvh")
    positions = graft.world_positions()
    assert_close(pymotion_positions(tmp_path / "graft.bvh", graft), positions)
    assert_close(pybvh_positions(read_with_pybvh(tmp_path / "graft.bvh")), positions)


# bvhio is slow and does not accept channel names in upper case.
SUPPORTED_BY_BVHIO = [
    path
    for path in RECORDINGS
    if path and path.stat().st_size < 250_000 and not path.stem.startswith("wd2_")
] or [None]


@pytest.mark.parametrize("path", SUPPORTED_BY_BVHIO, ids=file_id)
def test_world_positions_equal_bvhio(path):
    bvhio = pytest.importorskip("bvhio", reason="bvhio is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        root = bvhio.readAsHierarchy(str(require(path, DATA)))
    motion = mg.read_bvh(path)
    frames = sorted({0, motion.n_frames // 2, motion.n_frames - 1})
    positions = []
    for frame in frames:
        root.loadPose(frame)
        layout = [joint for joint, *_ in root.layout()]
        positions.append([list(joint.PositionWorld) for joint in layout])
        assert [joint.Name.split()[0] for joint in layout] == [
            name.split()[0] for name in motion.skeleton.names
        ]
    assert_close(np.array(positions), motion.world_positions()[frames])


@few_examples(40)
@given(motions(), st.permutations("XYZ"))
def test_to_pybvh_from_pybvh_round_trips(motion, order):
    pytest.importorskip("pybvh", reason="pybvh is not installed")
    # In pybvh, only the root can be translated, and joints are identified by name.
    skeleton = motion.skeleton
    placed = np.tile(motion.positions[0], (motion.n_frames, 1, 1))
    placed[:, 0] = motion.positions[:, 0]
    channels = tuple(f"{axis}rotation" for axis in order)
    skeleton = mg.Skeleton(
        tuple(f"joint {joint}" for joint in range(skeleton.n_joints)),
        skeleton.parents,
        placed[0],
        (("Xposition", "Yposition", "Zposition", *channels), *[channels] * (skeleton.n_joints - 1)),
        skeleton.end_sites,
    )
    motion = mg.Motion(skeleton, motion.frame_time, motion.rotations, placed)
    with warnings.catch_warnings():
        # pybvh warns, because it cannot determine the up axis from these names and offsets.
        warnings.simplefilter("ignore", UserWarning)
        clip = formats.to_pybvh(motion)
    back = formats.from_pybvh(clip)
    assert back.skeleton.names == skeleton.names
    assert back.skeleton.channels == skeleton.channels
    np.testing.assert_array_equal(back.skeleton.parents, skeleton.parents)
    assert [(site.parent, site.before) for site in back.skeleton.end_sites] == [
        (site.parent, site.before) for site in skeleton.end_sites
    ]
    np.testing.assert_array_equal(back.positions, motion.positions)
    mg.write_bvh(back, file := io.BytesIO())
    file.seek(0)
    again = mg.read_bvh(file)
    np.testing.assert_allclose(rotations.angle(again.rotations, motion.rotations), 0, atol=1e-7)
    np.testing.assert_allclose(rotations.angle(back.rotations, motion.rotations), 0, atol=1e-7)


def test_to_pybvh_translated_joint_raises_value_error():
    pytest.importorskip("pybvh", reason="pybvh is not installed")
    skeleton = mg.Skeleton(("a", "b"), np.array([-1, 0]), np.zeros((2, 3)))
    placed = np.zeros((2, 2, 3))
    placed[1, 1] = 1.0
    motion = mg.Motion(skeleton, 0.1, np.tile(rotations.IDENTITY, (2, 2, 1)), placed)
    with pytest.raises(
        ValueError, match=r"pybvh can translate the root only, got .* local position, b"
    ):
        formats.to_pybvh(motion)
