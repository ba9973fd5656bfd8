"""GLB files, read back by an independent reader, the Khronos validator and Blender."""

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
from mograft.motion import rotations
from tests import strategies
from tests.clients import blender, gltf_validator
from tests.dialects import skeletons
from tests.hierarchies import human, under_world_root
from tests.io.gltf_scenes import Glb, assert_equal_up_to_rotation
from tests.oracles import bone_mesh as oracle
from tests.strategies import HOSTILE_NAMES, transform_motion, turn_motion


@settings(max_examples=60)
@given(strategies.motions(max_frames=12), st.sampled_from([0.01, 1.0, 0.056444]))
def test_write_glb_joint_positions_equal_forward_kinematics(tmp_path_factory, motion, scale):
    path = tmp_path_factory.mktemp("glb") / "m.glb"
    write_glb(motion, path, scale=scale)
    file = Glb(path)
    (animation,) = file.document["animations"]
    frames = [0, motion.n_frames // 2, motion.n_frames - 1]
    expected = scale * motion.world_positions()[frames]
    actual = np.empty_like(expected)
    for k, frame in enumerate(frames):
        world = file.matrices(animation, frame)
        actual[k] = [world[joint][:3, 3] for joint in range(motion.n_joints)]
        positions, joints = file.skin_vertices(animation, frame)
        # The first corner of a bone is at its joint.
        tolerance = 1e-6 * np.abs(expected).max()
        found, places = positions[::24], actual[k][joints[::24]]
        np.testing.assert_allclose(found, places, rtol=1e-5, atol=10 * tolerance)
    height = scale * mass_model(motion.skeleton).height
    assert_equal_up_to_rotation(actual, expected, 1e-4 * height + 1e-6 * np.abs(expected).max())
    times = file.array(animation["samplers"][-1]["input"])
    np.testing.assert_allclose(times[-1], times[0] if len(times) == 1 else motion.duration, 1e-6)


def test_write_glb_figure_is_upright_for_any_up_axis(motion, tmp_path):
    for axes in ([0, 0, 0], [np.pi / 2, 0, 0], [0, 0, np.pi / 2], [np.pi, 0, 0]):
        tilt = rotations.exp(np.array(axes, float))
        write_glb(turn_motion(motion, tilt), tmp_path / "m.glb")
        file = Glb(tmp_path / "m.glb")
        actual, joints = file.skin_vertices(file.document["animations"][0], 40)
        world = 0.01 * motion.world_positions()[40]
        # Upright, not mirrored: equal to the original up to a rotation about y.
        heights = actual[:, 1]
        head = motion.skeleton.index("Head")
        assert abs(heights[joints == head].min() - world[head, 1]) < 0.03
        assert heights.min() > -0.1


def test_write_glb_world_root_has_no_bone_in_mesh(motion, tmp_path):
    vertices = []
    for name, moved in (("a", motion), ("b", under_world_root(motion, moving_root=True))):
        write_glb(moved, tmp_path / f"{name}.glb")
        file = Glb(tmp_path / f"{name}.glb")
        vertices.append(file.skin_vertices(file.document["animations"][0], 40))
    (plain, plain_joints), (rooted, rooted_joints) = vertices
    np.testing.assert_array_equal(rooted_joints, plain_joints + 1)
    np.testing.assert_allclose(rooted, plain, atol=1e-4)


def test_write_glb_several_motions_become_animations(motion, tmp_path):
    grown = replace(transform_motion(motion[:30], 1.5), name="grown")
    write_glb([motion, grown], tmp_path / "m.glb", scale=1.0)
    file = Glb(tmp_path / "m.glb")
    names = [animation["name"] for animation in file.document["animations"]]
    assert names == ["dance", "grown"]
    for animation, expected in zip(file.document["animations"], (motion, grown), strict=True):
        world = file.matrices(animation, 20)
        actual = [world[joint][:3, 3] for joint in range(18)]
        np.testing.assert_allclose(actual, expected.world_positions()[20], atol=0.01)


@pytest.mark.parametrize(
    ("size", "unit"), [(1, "cm"), (0.01, "m"), (10, "mm"), (0.01 / 0.0254, "inch"), (0.17, "CMU")]
)
def test_write_glb_guesses_unit_from_height(motion, tmp_path, size, unit):
    scaled = transform_motion(motion, size)
    assert guess_unit(scaled.skeleton) == unit
    write_glb(scaled, tmp_path / "m.glb")
    extras = Glb(tmp_path / "m.glb").document["asset"]["extras"]
    assert extras == {"metres_in_a_unit": UNITS[unit], "unit": unit, "up_in_the_motion": "y"}
    world = Glb(tmp_path / "m.glb").matrices({"channels": []}, 0)
    head, foot = (world[motion.skeleton.index(name)][1, 3] for name in ("Head", "LeftFoot"))
    assert 1.2 < head - foot < 1.7


def test_write_glb_invalid_argument_raises_error(motion, tmp_path):
    path = tmp_path / "m.glb"
    with pytest.raises(ValueError, match="`motions` must hold at least one"):
        write_glb([], path)
    with pytest.raises(TypeError, match="`motions` must be a Motion, got str"):
        write_glb("dance.bvh", path)
    for scale in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="`scale` must be above 0"):
            write_glb(motion, path, scale=scale)
    with pytest.raises(ValueError, match="`preset` must be one of"):
        write_glb(motion, path, groups="wings")
    still = Motion(Skeleton(["a"], [-1], [[0, 0, 0]]), 0.1, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    with pytest.raises(SkeletonMismatchError):
        write_glb([motion, still], path)
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
