"""USD files, read by the USD library and its validators, read back, and with wrong content."""

import contextlib
import re
import struct
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mograft as mg
from mograft import EndSite, Motion, Skeleton
from mograft.cli import main
from mograft.dancer import dance
from mograft.formats import write_usd
from mograft.io.export_figure import ExportTransform
from mograft.io.usd import SUFFIXES
from tests import strategies
from tests.strategies import assert_same_rotations, few_examples

pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
from pxr import Sdf, Usd, UsdGeom, UsdSkel, UsdUtils, UsdValidation  # noqa: E402

from tests.fuzz import usd as fuzz_usd  # noqa: E402 - needs usd-core
from tests.fuzz.usd import define_animation, define_figure  # noqa: E402


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
def test_write_usd_poses_equal_those_of_usd_and_are_read_back(
    tmp_path_factory, motion, scale, ending
):
    path = tmp_path_factory.mktemp("usd") / f"m{ending}"
    write_usd(motion, path, scale=scale)
    transform = ExportTransform.of(motion, scale)
    expected = transform.points(motion.world_positions())
    size = max(np.abs(expected).max(), 1.0)
    stage, query, skin = open_figure(path)  # They are valid as long as the stage exists.
    for frame, places in enumerate(expected):
        world = [list(m.ExtractTranslation()) for m in query.ComputeJointSkelTransforms(frame)]
        np.testing.assert_allclose(world, places, atol=1e-5 * size)
        check_skin(query, skin, frame, places)
    assert stage.GetEndTimeCode() == motion.n_frames - 1
    np.testing.assert_allclose(stage.GetTimeCodesPerSecond(), motion.rate)
    (again,) = mg.read(path)
    size = max(np.abs(expected).max(), scale)
    np.testing.assert_allclose(again.world_positions(), expected, atol=1e-5 * size)
    # The turn to y up is in the rest pose, so local rotations are those of the motion in its axes.
    turn = transform.to_y_up
    local = mg.rotations.multiply(motion.rotations, mg.rotations.inverse(turn))
    assert_same_rotations(again.rotations, mg.rotations.multiply(turn, local), atol=1e-5)
    offsets = transform.points(motion.skeleton.offsets)
    np.testing.assert_allclose(again.skeleton.offsets, offsets, atol=1e-6 * size)
    assert again.skeleton.has_same_hierarchy(motion.skeleton)
    assert (again.n_frames, again.rate) == (motion.n_frames, pytest.approx(motion.rate, rel=1e-6))
    assert again.is_translated[1:].sum() == 0


def test_write_usd_stores_units_axes_names_and_colours(motion, tmp_path):
    write_usd(motion, tmp_path / "m.usda")
    stage, query, skin = open_figure(tmp_path / "m.usda")
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    stored = {"metres_in_a_unit": 0.01, "unit": "cm", "up_in_the_motion": "y"}
    assert stage.GetRootLayer().customLayerData["mograft"] == stored
    assert list(query.GetSkeleton().GetJointNamesAttr().Get()) == list(motion.skeleton.names)
    colours = np.array(UsdGeom.Mesh(skin.GetPrim()).GetDisplayColorAttr().Get())
    assert len(np.unique(colours, axis=0)) == 4


def test_write_usd_is_deterministic_and_passes_usd_validators(motion, tmp_path):
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
            path, again = tmp_path / f"{name}{ending}", tmp_path / f"again{ending}"
            write_usd(item, path)
            write_usd(item, again)
            assert path.read_bytes() == again.read_bytes()
            found = context.Validate(Usd.Stage.Open(str(path)))
            assert [error.GetMessage() for error in found] == [], path.name


@pytest.mark.parametrize(
    "name", [*strategies.HOSTILE_NAMES, "Hips/Spine", "1st", "Hüfte", "엉덩이"]
)
def test_write_usd_any_name_is_kept_as_joint_name(motion, tmp_path, name):
    names = (name,) * motion.n_joints
    renamed = replace(motion[:3], skeleton=replace(motion.skeleton, names=names), name=name)
    encoded = name.encode("utf-8", "replace").decode().replace("\0", "")
    for path in (tmp_path / "m.usda", tmp_path / "m.usdc"):
        write_usd(renamed, path)
        # Joints with the same path would be refused.
        assert set(mg.read(path)[0].skeleton.names) == {encoded}
        stage = Usd.Stage.Open(str(path))
        assert stage.GetDefaultPrim().GetDisplayName() == (encoded or "motion")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("m.usdz", {}, r"`path` must end in \.usd, \.usda, \.usdc, got m\.usdz"),
        ("m.usd", {"scale": 0}, "`scale` must be above 0"),
        ("m.usd", {"groups": "wings"}, "`preset` must be one of"),
    ],
)
def test_write_usd_invalid_argument_raises_value_error(motion, tmp_path, name, options, message):
    with pytest.raises(ValueError, match=message):
        write_usd(motion, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


def test_usd_without_usd_core_names_the_extra(motion, tmp_path, capsys, monkeypatch):
    path = tmp_path / "x.usda"
    write_usd(motion, path)
    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.delitem(sys.modules, "mograft.io.usd_reader", raising=False)  # imports pxr once
    assert main(["export", str(path), "-o", str(tmp_path / "y.usd")]) == 1
    assert "pip install 'mograft[usd]'" in capsys.readouterr().err
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'mograft\[usd\]'"):
        write_usd(motion, tmp_path / "y.usd")
    assert list(tmp_path.iterdir()) == [path]


def test_read_usd_package_and_rate(tmp_path):
    motion = dance(strides=1).motion[:61]
    write_usd(motion, tmp_path / "m.usdc")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "m.usdc"), str(tmp_path / "m.usdz"))
    packed, clips = (mg.read(tmp_path / f"m.{own}", rate=10) for own in ("usdz", "usdc"))
    np.testing.assert_array_equal(packed[0].rotations, clips[0].rotations)
    assert clips.names == ("motion",)
    assert clips[0].n_frames == 21
    assert clips[0].duration == pytest.approx(motion.duration)
    assert clips.notes == ("unit: 1 m, Y up", "prims that are not joints: 1 Mesh")


def matrix(rng, shift):
    result = np.eye(4)
    result[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    result[:3, 3] = shift
    return result


def save(stage, path, codes_per_second=24.0):
    stage.SetTimeCodesPerSecond(codes_per_second)
    assert stage.GetRootLayer().Export(str(path))
    return path


@few_examples(20)
@given(strategies.SEEDS)
def test_read_usd_positions_match_usd_with_rest_rotations_scale_and_moving_prim(
    tmp_path_factory, seed
):
    stage = fuzz_usd.make_stage(seed)
    path = save(stage, tmp_path_factory.mktemp("usd") / "a.usda")
    (motion,) = mg.read(path)
    assert motion.rate == pytest.approx(24)
    assert motion.n_frames == 4
    assert motion.skeleton.names == ("hips", "spine", "head", "leg")
    cache = UsdSkel.Cache()
    assert cache.Populate(UsdSkel.Root.Get(stage, "/figure"), Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(UsdSkel.Skeleton.Get(stage, "/figure/skel"))
    positions = motion.world_positions()
    for frame, code in enumerate((1.0, 2.0, 3.0, 4.0)):
        world = UsdGeom.XformCache(Usd.TimeCode(code))
        transforms = query.ComputeJointWorldTransforms(world)
        expected = [list(transform.ExtractTranslation()) for transform in transforms]
        np.testing.assert_allclose(positions[frame], expected, atol=2e-3 if code == 3 else 1e-5)


def test_read_usd_several_animations_and_roots(tmp_path):
    rng = np.random.default_rng(1)
    stage = Usd.Stage.CreateInMemory()
    joints = ["left", "left/tip", "right"]
    rest = [matrix(rng, [1, 0, 0]) for _ in joints]
    bind = [rest[0], rest[0] @ rest[1], rest[2]]
    define_figure(stage, "pair", joints, None, bind)
    key = (rng.normal(size=(3, 3)), np.tile([0, 0, 0, 1.0], (3, 1)), np.ones((3, 3)))
    for name in ("a", "b"):
        define_animation(stage, f"/pair/{name}/walk", joints, {0.0: key, 0.5: key, 1.25: key})
    clips = mg.read(save(stage, tmp_path / "a.usdc", 20.0))
    assert clips.names == ("walk", "walk~2")
    motion = clips["walk~2"]
    # A joint above several roots; keys between time codes are sampled at 30 fps.
    assert motion.skeleton.names == ("skel", "left", "tip", "right")
    assert motion.skeleton.parents.tolist() == [-1, 0, 1, 0]
    expected = np.array([np.zeros(3), *(m[:3, 3] for m in bind)])
    np.testing.assert_allclose(motion.skeleton.rest_positions(), expected, atol=1e-9)
    assert motion.duration == pytest.approx(1.25 / 20)
    assert motion.n_frames == 3


def test_read_usd_layer_outside_folder_raises_format_error(tmp_path):
    (tmp_path / "inner").mkdir()
    write_usd(dance(strides=1).motion[:5], tmp_path / "m.usda")
    write_usd(dance(strides=1).motion[:5], tmp_path / "inner" / "m.usda")
    for name, is_inside in (("./m.usda", True), ("../m.usda", False), (tmp_path / "m.usda", False)):
        layer = Sdf.Layer.CreateNew(str(tmp_path / "inner" / "top.usda"))
        layer.subLayerPaths.append(str(name))
        layer.Save()
        del layer
        if is_inside:
            assert len(mg.read(tmp_path / "inner" / "top.usda")) == 1
        else:
            with pytest.raises(mg.FormatError, match="expected layers in the folder of the file"):
                mg.read(tmp_path / "inner" / "top.usda")


KEY = (np.zeros((1, 3)), [[0, 0, 0, 1.0]], np.ones((1, 3)))


@pytest.mark.parametrize(
    ("joints", "moved", "keys", "message"),
    [
        ([], ["a"], {0.0: KEY}, "/f/skel: expected joints, got none"),
        (["a/b", "a"], ["a"], {0.0: KEY}, "/f/skel: expected parents before children"),
        (["a", "a/b", "a/b"], ["a"], {0.0: KEY}, "expected different joints, got a/b more than"),
        (["a"], ["b"], {0.0: KEY}, "/f/walk: expected a Skeleton with the joints"),
        (["a"], ["a"], {0.0: (np.zeros((2, 3)), *KEY[1:])}, "expected 1 finite translations"),
        (["a"], ["a"], {0.0: (KEY[0] + np.nan, *KEY[1:])}, "expected 1 finite translations"),
        (["a"], ["a"], {0.0: (KEY[0], [[0, 0, 0, 0]], KEY[2])}, "expected unit quaternions"),
        (["a"], ["a"], {0.0: KEY, 1e5: KEY}, "/f/walk: a duration of .* too long for 2 keys"),
        (["a"], ["a"], {}, "expected restTransforms or bindTransforms"),
    ],
)
def test_read_usd_wrong_content_raises_format_error(tmp_path, joints, moved, keys, message):
    stage = Usd.Stage.CreateInMemory()
    define_figure(stage, "f", joints, [np.eye(4)] * len(joints) if keys else None)
    define_animation(stage, "/f/walk", moved, keys)
    path = save(stage, tmp_path / "a.usda")
    with pytest.raises(mg.FormatError, match=r"a\.usda: .*" + message):
        mg.read(path)[0]


@pytest.mark.parametrize(
    "change",
    [
        ('"Hips/Spine"', '"Hips/Spine-ulder"'),
        ("timeCodesPerSecond = ", "timeCodesPerSecond = " + "4" * 60),
    ],
)
def test_usd_warnings_are_not_printed_beside_our_error(change, tmp_path, capfd):
    path = tmp_path / "a.usda"
    write_usd(dance(strides=1).motion[:5], path)
    text = path.read_text(encoding="utf-8")
    old, new = change
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with contextlib.suppress(mg.FormatError):
        mg.read(path)[0]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("content", [b"#usda 1.0\n(", b"PXR-USDC" + bytes(80), b"PK\3\4", b""])
def test_read_usd_damaged_file_raises_format_error(tmp_path, content):
    for ending in (".usd", ".usda", ".usdc", ".usdz"):
        path = tmp_path / f"a{ending}"
        path.write_bytes(content)
        with pytest.raises(mg.FormatError, match=rf"a\{ending}"):
            mg.read(path)


@pytest.mark.parametrize("seed", range(80))
def test_read_usd_damaged_text_gives_motions_or_format_error(tmp_path, seed):
    if not fuzz_usd.is_excused(seed, -1):
        fuzz_usd.check(seed, tmp_path)


def test_read_usd_values_of_other_types_raise_format_error(tmp_path):
    text = fuzz_usd.valid_files()["bind.usda"].decode()
    numbers = r"\1double[] bindTransforms = [1, 2, 3, 4]"
    changed = re.sub(r"(uniform )matrix4d\[\] bindTransforms = .*", numbers, text)
    assert changed != text
    (tmp_path / "a.usda").write_text(changed)
    with pytest.raises(mg.FormatError, match=r"expected a USD file: .* has no attribute"):
        mg.read(tmp_path / "a.usda")
    write_usd(dance(strides=1).motion[:5], tmp_path / "m.usdc")
    data = (tmp_path / "m.usdc").read_bytes()
    assert b"Spine" in data
    (tmp_path / "b.usdc").write_bytes(data.replace(b"Spine", b"Sp\xffne"))
    with pytest.raises(mg.FormatError, match=r"expected a USD file: .* codec can't decode"):
        mg.read(tmp_path / "b.usdc")[0]


@pytest.mark.parametrize("section", range(6))
@pytest.mark.parametrize("claim", [2**30, 2**40, 2**63, 2**64 - 1])
def test_read_usd_binary_file_with_too_large_section_raises_format_error(tmp_path, section, claim):
    """A file of 2 KB that claims 10 GB makes usd-core allocate them."""
    write_usd(dance(strides=1).motion[:5], tmp_path / "m.usdc")
    data = bytearray((tmp_path / "m.usdc").read_bytes())
    (contents,) = struct.unpack_from("<q", data, 16)
    name, first, size = struct.unpack_from("<16sqq", data, contents + 8 + 32 * section)
    place = name.rstrip(b"\0").decode()
    struct.pack_into("<Q", data, first, claim)
    path = tmp_path / "large.usdc"
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=f"section {place}: expected at most"):
        mg.read(path)
    struct.pack_into("<q", data, contents + 24 + 32 * section, size + len(data))
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=f"section {place}: expected an end"):
        mg.read(path)
    struct.pack_into("<Q", data, contents, claim)
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=r"table of contents: expected at most \d+ sections"):
        mg.read(path)
    struct.pack_into("<q", data, 16, claim % 2**63)
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=r"table of contents|position"):
        mg.read(path)
