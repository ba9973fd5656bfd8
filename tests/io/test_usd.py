"""USD files, read back by the USD library, its validators and Blender."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mograft import EndSite, Motion, Skeleton, write_bvh
from mograft.cli import main
from mograft.formats import write_usd
from mograft.io.usd import SUFFIXES, _joint_paths
from tests import strategies
from tests.io.glb_file import assert_equal_up_to_rotation
from tests.strategies import HOSTILE_NAMES

pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
from pxr import Usd, UsdGeom, UsdSkel, UsdValidation  # noqa: E402


@given(st.lists(st.sampled_from(["A", "A_2", "A_3", "A_4", "A_2_2"]), min_size=1, max_size=6))
@example(["A", "A_3", "A", "A"])
def test_joint_paths_of_any_names_are_unique(names):
    """Also if a name looks like another name with a number appended."""
    parents = [-1, *[0] * (len(names) - 1)]
    paths = _joint_paths(Skeleton(names, parents, np.zeros((len(names), 3))))
    assert len(set(paths)) == len(names)


def matrices(query, frame):
    """World matrices of the joints, as columns."""
    transforms = query.ComputeJointSkelTransforms(frame)
    return np.array([np.array(matrix).T for matrix in transforms])


def open_figure(path):
    stage = Usd.Stage.Open(str(path))
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(stage.GetDefaultPrim())
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/figure/skeleton"))
    query = cache.GetSkelQuery(skeleton)
    assert query.HasBindPose()
    assert query.HasRestPose()
    skin = cache.GetSkinningQuery(stage.GetPrimAtPath("/figure/bones"))
    return stage, query, skin


def check_skin(query, skin, frame, expected):
    """Assert that the skinned bones start at the joints."""
    points = UsdGeom.Mesh(skin.GetPrim()).GetPointsAttr().Get()
    assert skin.ComputeSkinnedPoints(query.ComputeSkinningTransforms(frame), points)
    joints = np.array(skin.GetJointIndicesPrimvar().Get())
    tolerance = 1e-5 * max(np.abs(expected).max(), 1.0)
    # The first corner of a bone is at its joint.
    np.testing.assert_allclose(np.array(points)[::24], expected[joints[::24]], atol=tolerance)


@settings(max_examples=40)
@given(strategies.motions(max_frames=10), st.sampled_from([0.01, 1.0]), st.sampled_from(SUFFIXES))
def test_write_usd_joint_positions_equal_forward_kinematics(
    tmp_path_factory, motion, scale, ending
):
    path = tmp_path_factory.mktemp("usd") / f"m{ending}"
    write_usd(motion, path, scale=scale)
    stage, query, skin = open_figure(path)  # They are valid as long as the stage exists.
    expected = scale * motion.world_positions()
    actual = np.empty_like(expected)
    for frame in range(motion.n_frames):
        world = matrices(query, frame)
        actual[frame] = world[:, :3, 3]
        check_skin(query, skin, frame, actual[frame])
    assert_equal_up_to_rotation(actual, expected, 1e-5 * max(np.abs(expected).max(), 1.0))
    assert stage.GetEndTimeCode() == motion.n_frames - 1
    np.testing.assert_allclose(stage.GetTimeCodesPerSecond(), motion.rate)


def test_write_usd_stores_units_axes_names_and_colours(motion, tmp_path):
    write_usd(motion, tmp_path / "m.usda")
    stage, query, skin = open_figure(tmp_path / "m.usda")
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.GetRootLayer().customLayerData["mograft"] == {
        "metres_in_a_unit": 0.01,
        "unit": "cm",
        "up_in_the_motion": "y",
    }
    assert list(query.GetSkeleton().GetJointNamesAttr().Get()) == list(motion.skeleton.names)
    paths = [str(path) for path in query.GetJointOrder()]
    for joint, parent in enumerate(motion.skeleton.parents.tolist()):
        assert paths[joint].rpartition("/")[0] == ("" if parent < 0 else paths[parent])
    world = matrices(query, 0)
    names = list(motion.skeleton.names)
    head, foot = (world[names.index(name), 1, 3] for name in ("Head", "LeftFoot"))
    assert 1.2 < head - foot < 1.7
    colours = np.array(UsdGeom.Mesh(skin.GetPrim()).GetDisplayColorAttr().Get())
    assert len(np.unique(colours, axis=0)) == 4


def test_write_usd_passes_usd_validators(motion, tmp_path):
    lone = Skeleton(["x"], [-1], [[0, 0, 0]], end_sites=(EndSite(0, [0, 0, 0]),))
    motions = {
        "dance": motion,
        "lone": Motion(lone, 0.1, [[[0, 0, 0, 1]]], [[[0, 0, 0]]]),
        "far": replace(motion, positions=motion.positions + 1e5),
    }
    rules = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(rules) > 5
    context = UsdValidation.ValidationContext(rules)
    for name, item in motions.items():
        for ending in SUFFIXES:
            path = tmp_path / f"{name}{ending}"
            write_usd(item, path)
            found = context.Validate(Usd.Stage.Open(str(path)))
            assert [error.GetMessage() for error in found] == [], path.name


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "Hips/Spine", "1st", "Hüfte", "엉덩이"])
def test_write_usd_any_name_is_kept_as_joint_name(motion, tmp_path, name):
    names = (name,) * motion.n_joints
    renamed = replace(motion[:3], skeleton=replace(motion.skeleton, names=names), name=name)
    for ending in (".usda", ".usdc"):
        write_usd(renamed, tmp_path / f"m{ending}")
        stage, query, _ = open_figure(tmp_path / f"m{ending}")
        encoded = name.encode("utf-8", "replace").decode().replace("\0", "")
        joint_names = list(query.GetSkeleton().GetJointNamesAttr().Get())
        assert set(joint_names) == {encoded}
        assert stage.GetDefaultPrim().GetDisplayName() == (encoded or "motion")
        assert len(set(map(str, query.GetJointOrder()))) == motion.n_joints


@pytest.mark.parametrize("ending", SUFFIXES)
def test_write_usd_is_deterministic(motion, tmp_path, ending):
    contents = []
    for name in ("a", "b"):
        write_usd(motion, tmp_path / f"{name}{ending}")
        contents.append((tmp_path / f"{name}{ending}").read_bytes())
    assert contents[0] == contents[1]


def test_write_usd_invalid_argument_raises_error(motion, tmp_path):
    with pytest.raises(ValueError, match=r"`path` must end in \.usd, \.usda, \.usdc, got m\.usdz"):
        write_usd(motion, tmp_path / "m.usdz")
    with pytest.raises(ValueError, match="`scale` must be above 0"):
        write_usd(motion, tmp_path / "m.usd", scale=0)
    with pytest.raises(ValueError, match="`preset` must be one of"):
        write_usd(motion, tmp_path / "m.usd", groups="wings")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError, match=r"no such folder: '.*none'"):
        write_usd(motion, tmp_path / "none" / "m.usd")
    assert list(tmp_path.iterdir()) == []


def test_export_command_usd_without_usd_core_names_the_extra(motion, tmp_path, capsys, monkeypatch):
    write_bvh(motion, tmp_path / "a.bvh")
    command = ["export", str(tmp_path / "a.bvh"), "-o"]
    assert main([*command, str(tmp_path / "x.usda"), "--scale", "0.02", "--rate", "15"]) == 0
    assert "metres, y up" in capsys.readouterr().err
    stage, _, _ = open_figure(tmp_path / "x.usda")
    assert stage.GetTimeCodesPerSecond() == pytest.approx(15, rel=0.02)
    monkeypatch.setitem(sys.modules, "pxr", None)
    assert main([*command, str(tmp_path / "y.usd")]) == 1
    assert "pip install 'mograft[usd]'" in capsys.readouterr().err
    assert not (tmp_path / "y.usd").exists()
