"""NPZ files of Kimodo against their own joint positions, and with wrong content."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.body.anatomy import anatomy
from mograft.body.mass import mass_model, up_axis
from mograft.io.kimodo.joints import SKELETONS, SOMA_30, SOMA_77
from tests.hierarchies import DATA
from tests.io.amass_file import write_arrays
from tests.io.kimodo_file import kimodo_arrays
from tests.strategies import SEEDS, assert_same_rotations, few_examples

FILES = sorted((DATA.parent / "data" / "npz").glob("kimodo*.npz"))


@pytest.mark.parametrize("path", FILES or [None], ids=lambda path: path and path.stem)
def test_read_kimodo_positions_equal_posed_joints(path):
    if path is None:
        pytest.skip("the Kimodo files are missing")
    clips = mg.read(path)
    motion = clips[0]
    height = mass_model(motion.skeleton).height
    with np.load(path) as data:
        gaps = np.abs(motion.world_positions() - data["posed_joints"])
    assert gaps.max() < 1e-4 * height
    assert 1.5 < height < 2.0
    assert up_axis(motion) == 1
    assert motion.is_translated.tolist() == [True] + [False] * 29  # bones keep their lengths
    assert clips.notes == (
        "frames per second: 30, that of Kimodo's models; the file states none",
        "arrays that are not part of the motion: foot_contacts",
    )


@few_examples(20)
@given(st.sampled_from(sorted(SKELETONS)), SEEDS)
def test_read_kimodo_recovers_rotations_and_offsets(tmp_path_factory, n_joints, seed):
    arrays, expected = kimodo_arrays(n_joints, seed=seed)
    path = write_arrays(tmp_path_factory.mktemp("kimodo") / "a.npz", arrays)
    motion = mg.read(path)[0]
    assert_same_rotations(motion.rotations, expected.rotations, atol=1e-5)
    np.testing.assert_allclose(
        motion.skeleton.offsets[1:], expected.skeleton.offsets[1:], atol=1e-5
    )
    np.testing.assert_allclose(motion.world_positions(), arrays["posed_joints"], atol=2e-5)
    assert mg.read(path, rate=60)[0].n_frames == 9


def test_read_kimodo_stretched_bone_keeps_positions(tmp_path):
    arrays, _ = kimodo_arrays()
    arrays["posed_joints"][2, 22:26] += np.float32(0.1)  # the left leg
    motion = mg.read(write_arrays(tmp_path / "a.npz", arrays))[0]
    np.testing.assert_allclose(motion.world_positions(), arrays["posed_joints"], atol=2e-5)
    assert np.flatnonzero(motion.is_translated).tolist() == [0, 22]
    assert motion.skeleton.channels[22][:3] == ("Xposition", "Yposition", "Zposition")


def test_kimodo_skeletons_name_the_published_joints():
    assert sorted(SKELETONS) == [22, 30, 34, 77]
    for kind in (SOMA_30, SOMA_77):
        known = anatomy(mg.Skeleton(kind.joints, kind.parents, np.ones((len(kind.joints), 3))))
        assert known.human
        assert [kind.joints[j] for j in known.joints("shank", side="left")] == ["LeftShin"]
    # The smaller skeleton is a part of the larger one.
    for joint, parent in zip(SOMA_30.joints, SOMA_30.parents, strict=True):
        index = SOMA_77.joints.index(joint)
        above = SOMA_77.parents[index]
        while above >= 0 and SOMA_77.joints[above] not in SOMA_30.joints:
            above = SOMA_77.parents[above]
        assert (SOMA_77.joints[above] if above >= 0 else "") == (
            SOMA_30.joints[parent] if parent >= 0 else ""
        )


def change(**changes):
    return kimodo_arrays()[0] | changes


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (
            change(posed_joints=np.zeros((5, 31, 3)), global_rot_mats=np.zeros((5, 31, 3, 3))),
            r"`posed_joints`: expected 22 \(SMPL-X\), 30 .* joints, got 31",
        ),
        (
            change(global_rot_mats=np.zeros((5, 30, 4))),
            r"`global_rot_mats`: expected shape \(5, 30",
        ),
        (change(posed_joints=np.zeros((6, 30, 3))), r"`global_rot_mats`: expected shape \(6, 30"),
        (change(posed_joints=np.zeros((1, 5, 30, 3))), "`posed_joints`: expected shape"),
        (change(global_rot_mats=np.zeros((5, 30, 3, 3))), r"expected rotation .* at \[0, 0\]"),
        (change(global_rot_mats=np.full((5, 30, 3, 3), 1e300)), "expected rotation matrices"),
        (
            change(global_rot_mats=np.tile(np.diag([1.0, 1, -1]), (5, 30, 1, 1))),
            "expected rotation matrices",
        ),
        (change(posed_joints=np.full((5, 30, 3), np.nan)), "`posed_joints`: expected finite"),
        (
            change(posed_joints=np.zeros((0, 30, 3)), global_rot_mats=np.zeros((0, 30, 3, 3))),
            "`posed_joints`: expected at least one frame",
        ),
    ],
)
def test_read_kimodo_wrong_array_raises_format_error_naming_it(tmp_path, arrays, message):
    path = write_arrays(tmp_path / "walk.npz", arrays)
    with pytest.raises(mg.FormatError, match=r"walk\.npz: array .*" + message):
        mg.read(path)[0]
