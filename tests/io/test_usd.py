"""USD: what its own library reads back is the motion, and its validator finds nothing."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import EndSite, Motion, Skeleton, write_bvh, write_usd
from mograft.body.mass import mass_model
from mograft.cli import main
from mograft.dancer import dance
from mograft.io.usd import SUFFIXES
from mograft.motion import rotations
from tests import strategies as own
from tests.clients import blender
from tests.io.test_formats import same_up_to_a_turn
from tests.strategies import HOSTILE_NAMES

pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
from pxr import Usd, UsdGeom, UsdSkel, UsdValidation  # noqa: E402


@pytest.fixture(scope="module")
def motion():
    return dance(seed=1, strides=1).motion[:60]


def matrices(query, frame):
    """World matrices of the joints, as columns."""
    found = query.ComputeJointSkelTransforms(frame)
    return np.array([np.array(matrix).T for matrix in found])


def figure(path):
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


def check_skin(query, skin, frame, want):
    """Assert that bones begin where joints are, as USD moves the skin."""
    points = UsdGeom.Mesh(skin.GetPrim()).GetPointsAttr().Get()
    assert skin.ComputeSkinnedPoints(query.ComputeSkinningTransforms(frame), points)
    joints = np.array(skin.GetJointIndicesPrimvar().Get())
    far = 1e-5 * max(np.abs(want).max(), 1.0)
    # The first corner of every bone is its joint.
    np.testing.assert_allclose(np.array(points)[::24], want[joints[::24]], atol=far)


@settings(max_examples=40)
@given(own.motions(max_frames=10), st.sampled_from([0.01, 1.0]), st.sampled_from(SUFFIXES))
def test_joints_are_where_forward_kinematics_puts_them(tmp_path_factory, motion, scale, ending):
    path = tmp_path_factory.mktemp("usd") / f"m{ending}"
    assert write_usd(motion, path, scale=scale) == scale
    stage, query, skin = figure(path)  # They live as long as the stage does.
    want = scale * motion.world_positions()
    got = np.empty_like(want)
    for frame in range(motion.n_frames):
        world = matrices(query, frame)
        got[frame] = world[:, :3, 3]
        check_skin(query, skin, frame, got[frame])
    same_up_to_a_turn(got, want, 1e-5 * max(np.abs(want).max(), 1.0))
    assert stage.GetEndTimeCode() == motion.n_frames - 1
    np.testing.assert_allclose(stage.GetTimeCodesPerSecond(), motion.rate)


def test_units_axes_names_and_colours_are_told(motion, tmp_path):
    assert write_usd(motion, tmp_path / "m.usda") == 0.01
    stage, query, skin = figure(tmp_path / "m.usda")
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


@pytest.mark.parametrize("axis", [[np.pi / 2, 0, 0], [0, 0, np.pi / 2], [np.pi, 0, 0]])
def test_whatever_is_up_becomes_y(motion, tmp_path, axis):
    whole = rotations.exp(np.array(axis, float))
    quats, places = motion.rotations.copy(), motion.positions.copy()
    quats[:, 0] = rotations.multiply(np.broadcast_to(whole, quats[:, 0].shape), quats[:, 0])
    places[:, 0] = rotations.rotate(whole, places[:, 0])
    write_usd(replace(motion, rotations=quats, positions=places), tmp_path / "m.usdc")
    stage, query, skin = figure(tmp_path / "m.usdc")
    check_skin(query, skin, 30, matrices(query, 30)[:, :3, 3])
    points = UsdGeom.Mesh(skin.GetPrim()).GetPointsAttr().Get()
    assert skin.ComputeSkinnedPoints(query.ComputeSkinningTransforms(30), points)
    # The fourth corner of a bone is its end, which is where the next joint is.
    ends = np.array(points)[3::24][: motion.n_joints - 1]
    np.testing.assert_allclose(ends, matrices(query, 30)[1:, :3, 3], atol=1e-5)
    got = matrices(query, 30)[:, :3, 3]
    want = 0.01 * motion.world_positions()[30]
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    np.testing.assert_allclose(got[:, 1], want[:, 1], atol=1e-4)
    same_up_to_a_turn(got, want, 1e-4)


def test_the_validators_of_usd_find_nothing(motion, tmp_path):
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
def test_names_that_usd_has_no_signs_for_stay_readable(motion, tmp_path, name):
    names = (name,) * motion.n_joints
    evil = replace(motion[:3], skeleton=replace(motion.skeleton, names=names), name=name)
    for ending in (".usda", ".usdc"):
        write_usd(evil, tmp_path / f"m{ending}")
        stage, query, _ = figure(tmp_path / f"m{ending}")
        plain = name.encode("utf-8", "replace").decode().replace("\0", "")
        told = list(query.GetSkeleton().GetJointNamesAttr().Get())
        assert set(told) == {plain}
        assert stage.GetDefaultPrim().GetDisplayName() == (plain or "motion")
        assert len(set(map(str, query.GetJointOrder()))) == motion.n_joints


@pytest.mark.parametrize("ending", SUFFIXES)
def test_the_same_motion_gives_the_same_bytes(motion, tmp_path, ending):
    made = []
    for name in ("a", "b"):
        write_usd(motion, tmp_path / f"{name}{ending}")
        made.append((tmp_path / f"{name}{ending}").read_bytes())
    assert made[0] == made[1]


def test_what_cannot_be_written_is_refused(motion, tmp_path):
    with pytest.raises(ValueError, match=r"path must end in \.usd, \.usda, \.usdc, got m\.usdz"):
        write_usd(motion, tmp_path / "m.usdz")
    with pytest.raises(ValueError, match="scale must be above 0"):
        write_usd(motion, tmp_path / "m.usd", scale=0)
    with pytest.raises(ValueError, match="preset must be one of"):
        write_usd(motion, tmp_path / "m.usd", groups="wings")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError, match=r"no such folder: '.*none'"):
        write_usd(motion, tmp_path / "none" / "m.usd")
    assert list(tmp_path.iterdir()) == []


def test_export_writes_usd_and_names_the_extra_where_it_is_absent(
    motion, tmp_path, capsys, monkeypatch
):
    write_bvh(motion, tmp_path / "a.bvh")
    words = ["export", str(tmp_path / "a.bvh"), "-o"]
    assert main([*words, str(tmp_path / "x.usda"), "--scale", "0.02", "--rate", "15"]) == 0
    assert "metres, y up" in capsys.readouterr().err
    stage, _, _ = figure(tmp_path / "x.usda")
    assert stage.GetTimeCodesPerSecond() == pytest.approx(15, rel=0.02)
    monkeypatch.setitem(sys.modules, "pxr", None)
    assert main([*words, str(tmp_path / "y.usd")]) == 1
    assert "pip install 'mograft[usd]'" in capsys.readouterr().err
    assert not (tmp_path / "y.usd").exists()


@pytest.mark.client
def test_blender_sees_joints_where_we_do(motion, tmp_path):
    run = blender()
    scale = write_usd(motion, tmp_path / "m.usdc")
    frames = [0, 1, 29, motion.n_frames - 1]
    told = run(tmp_path / "m.usdc", frames, motion.rate)
    world = scale * motion.world_positions()[frames]
    names = motion.skeleton.names
    got = np.array([[heads[name] for name in names] for heads in told["heads"]])
    # Blender has z up.
    want = np.stack([world[..., 0], -world[..., 2], world[..., 1]], axis=-1)
    assert np.abs(got - want).max() < 1e-4 * scale * mass_model(motion.skeleton).height
