"""GLB files, read back, and read by the Khronos validator and Blender."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import EndSite, Motion, Skeleton, SkeletonMismatchError
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.formats import write_glb
from mograft.io.export_figure import UNITS, ExportTransform, bone_mesh, guess_unit
from mograft.io.gltf.container import read_container
from mograft.io.gltf.document import read_gltf_file
from mograft.motion import rotations
from tests import strategies
from tests.clients import blender, gltf_validator
from tests.dialects import skeletons
from tests.hierarchies import human, under_world_root
from tests.io.gltf_scenes import assert_equal_up_to_rotation, read_primitives, skinned
from tests.oracles import bone_mesh as oracle
from tests.strategies import HOSTILE_NAMES, transform_motion, turn_motion


def read_both(path):
    """Return the clips of a file, and the file with its mesh."""
    file = read_gltf_file(path)
    ((found, _),) = read_primitives(file)
    return mg.read(path), file, found


@settings(max_examples=60)
@given(strategies.motions(max_frames=12), st.sampled_from([0.01, 1.0, 0.056444]))
def test_write_glb_joints_and_vertices_equal_forward_kinematics(tmp_path_factory, motion, scale):
    path = tmp_path_factory.mktemp("glb") / "m.glb"
    write_glb(motion, path, scale=scale)
    clips, file, found = read_both(path)
    (clip,) = clips
    expected = scale * motion.world_positions()
    actual = np.empty_like(expected)
    actual[:, file.joints] = clip.world_positions()
    height, size = scale * mass_model(motion.skeleton).height, np.abs(expected).max()
    assert_equal_up_to_rotation(actual, expected, 1e-4 * height + 1e-6 * size)
    assert clip.duration == pytest.approx(motion.duration, rel=1e-6)
    # The first corner of a bone is at its joint.
    corners, joints = skinned(file, clip, found)[:, ::24], found["JOINTS_0"][::24, 0]
    np.testing.assert_allclose(corners, actual[:, joints], rtol=1e-5, atol=1e-5 * size)


@pytest.mark.parametrize("axes", [[0, 0, 0], [np.pi / 2, 0, 0], [0, 0, np.pi / 2], [np.pi, 0, 0]])
def test_write_glb_figure_is_upright_for_any_up_axis(motion, tmp_path, axes):
    write_glb(turn_motion(motion, rotations.exp(np.array(axes, float))), tmp_path / "m.glb")
    actual, expected = mg.read(tmp_path / "m.glb")[0].world_positions(), motion.world_positions()
    np.testing.assert_allclose(actual[..., 1], 0.01 * expected[..., 1], atol=1e-4)


def test_write_glb_world_root_has_no_bone_in_mesh(motion, tmp_path):
    meshes = []
    for name, moved in (("a", motion), ("b", under_world_root(motion, moving_root=True))):
        write_glb(moved, tmp_path / f"{name}.glb")
        clips, file, found = read_both(tmp_path / f"{name}.glb")
        meshes.append((found["JOINTS_0"][:, 0], skinned(file, clips[0][40:41], found)))
    (plain_joints, plain), (rooted_joints, rooted) = meshes
    np.testing.assert_array_equal(rooted_joints, plain_joints + 1)
    np.testing.assert_allclose(rooted, plain, atol=1e-4)


def test_write_glb_several_motions_become_animations(motion, tmp_path):
    grown = replace(transform_motion(motion[:30], 1.5), name="grown")
    write_glb([motion, grown], tmp_path / "m.glb", scale=1.0)
    clips = mg.read(tmp_path / "m.glb")
    assert clips.names == ("dance", "grown")
    for clip, expected in zip(clips, (motion, grown), strict=True):
        np.testing.assert_allclose(clip.world_positions(), expected.world_positions(), atol=0.01)


@pytest.mark.parametrize(
    ("size", "unit"), [(1, "cm"), (0.01, "m"), (10, "mm"), (0.01 / 0.0254, "inch"), (0.17, "CMU")]
)
def test_write_glb_guesses_unit_from_height(motion, tmp_path, size, unit):
    scaled, path = transform_motion(motion, size), tmp_path / "m.glb"
    assert guess_unit(scaled.skeleton) == unit
    write_glb(scaled, path)
    extras = read_container(path).document["asset"]["extras"]
    assert extras == {"metres_in_a_unit": UNITS[unit], "unit": unit, "up_in_the_motion": "y"}
    rest = mg.read(path)[0].skeleton.rest_positions()
    head, foot = (rest[motion.skeleton.index(name), 1] for name in ("Head", "LeftFoot"))
    assert 1.2 < head - foot < 1.7


def test_write_glb_invalid_argument_raises_error(motion, tmp_path):
    path = tmp_path / "m.glb"
    still = Motion(Skeleton(["a"], [-1], [[0, 0, 0]]), 0.1, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    for motions, options, error, message in (
        ([], {}, ValueError, "`motions` must hold at least one"),
        ("dance.bvh", {}, TypeError, "`motions` must be a Motion, got str"),
        *(
            (motion, {"scale": own}, ValueError, "`scale` must be")
            for own in (0, -1, np.nan, np.inf)
        ),
        (motion, {"groups": "wings"}, ValueError, "`preset` must be one of"),
        ([motion, still], {}, SkeletonMismatchError, "lacks"),
    ):
        with pytest.raises(error, match=message):
            write_glb(motions, path, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.client
def test_write_glb_passes_khronos_validator(motion, tmp_path):
    validate = gltf_validator()
    rng = np.random.default_rng(0)
    lone = Skeleton(["x"], [-1], [[0, 0, 0]], end_sites=(EndSite(0, [0, 0, 0]),))
    many = strategies.skeletons(rng, 300)
    quats = strategies.smooth_rotations(rng, 3, 300)
    motions = {
        "dance": motion,
        "two": [motion, motion[:1]],
        "lone": Motion(lone, 0.1, [[[0, 0, 0, 1]]], [[[0, 0, 0]]]),
        "many": Motion(many, 0.1, quats, np.tile(many.offsets, (3, 1, 1))),
        "far": replace(motion, positions=motion.positions + 1e5),
        "hostile": replace(motion, name=HOSTILE_NAMES[-2]),
    }
    for name, item in motions.items():
        write_glb(item, tmp_path / f"{name}.glb")
        assert validate(tmp_path / f"{name}.glb") == [], name


@pytest.mark.client
@pytest.mark.parametrize("ending", ["bvh", "glb", "usdc"])
def test_blender_joint_positions_agree(motion, tmp_path, ending):
    run = blender()
    path = tmp_path / f"m.{ending}"
    scale = 1.0 if ending == "bvh" else 0.01
    mg.write(motion, path)
    frames = [0, 1, 44, motion.n_frames - 1]
    report = run(path, frames, motion.rate)
    height = scale * mass_model(motion.skeleton).height
    world = scale * motion.world_positions()[frames]
    names = motion.skeleton.names
    actual = np.array([[heads[name] for name in names] for heads in report["heads"]])
    # In Blender, z is up.
    expected = np.stack([world[..., 0], -world[..., 2], world[..., 1]], axis=-1)
    assert np.abs(actual - expected).max() < 1e-4 * height


@st.composite
def transforms(draw):
    turned = rotations.from_axis_angle([1.0, 0.0, 0.0], draw(st.sampled_from([0.0, np.pi / 2])))
    scale = draw(st.sampled_from([1.0, 0.01, 0.0254]))
    return ExportTransform(scale, "given", 1, turned)


@strategies.few_examples(60)
@given(skeletons() | st.just(human()) | st.just(dance(strides=1).motion.skeleton), transforms())
def test_bone_mesh_any_skeleton_equals_oracle_bit_for_bit(skeleton, transform):
    found, wanted = bone_mesh(skeleton, transform)[:3], oracle.bone_mesh(skeleton, transform)
    for actual, expected in zip(found, wanted, strict=True):
        assert actual.dtype == expected.dtype
        assert actual.shape == expected.shape
        assert actual.tobytes() == expected.tobytes()
