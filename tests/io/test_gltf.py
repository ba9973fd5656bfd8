"""Reading of glTF files: agreement with a slow evaluation of the same scenes."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.io.gltf.document import read_gltf_file
from tests import strategies
from tests.clients import blender_player
from tests.io.glb_file import Glb
from tests.io.gltf_scenes import random_scene, to_scene, write_gltf
from tests.io.recorded_files import DATA, require

SCALES = st.sampled_from(["none", "uniform", "mirrored", "any"])


def expected_joints(scene):
    """Return the joints of a scene: by definition, without code of the package."""
    members = scene.skin or sorted({track.node for track in scene.tracks})

    def line(node):
        found = []
        while node >= 0:
            found.append(node)
            node = scene.parents[node]
        return found

    common = set.intersection(*(set(line(node)) for node in members))
    root = max(common, key=lambda node: len(line(node)))
    return {root} | {n for node in members for n in line(node) if root in line(n)}


@given(
    seed=st.integers(0, 2**32 - 1),
    scale=SCALES,
    has_skin=st.booleans(),
    way=st.sampled_from(["glb", "external", "embedded"]),
)
def test_read_gltf_random_scene_equals_evaluation(tmp_path_factory, seed, scale, has_skin, way):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, scale=scale, has_skin=has_skin)
    path = write_gltf(tmp_path_factory.mktemp("gltf"), *scene.document(rng), way)
    clips = mg.read(path)
    joints = expected_joints(scene)
    file = read_gltf_file(path)
    assert set(file.joints.tolist()) == joints
    moved = set(file.moved_nodes.tolist())
    moving = [track for track in scene.tracks if track.node in moved]
    if not moving:
        assert len(clips) == 0
        return
    motion = clips["move"]
    start = min(track.times[0] for track in moving)
    stop = max(track.times[-1] for track in moving)
    assert motion.duration == pytest.approx(stop - start, abs=1e-9)
    times = start + np.arange(motion.n_frames) * motion.frame_time
    expected = np.array(
        [[scene.world_position(node, time) for node in file.joints] for time in times]
    )
    size = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(motion.world_positions(), expected, atol=2e-5 * size)
    rest = np.array([scene.world_position(node, None) for node in file.joints])
    np.testing.assert_allclose(motion.skeleton.rest_positions(), rest, atol=1e-5 * size)
    # Joints without scale and translation above them keep the rotation of the file.
    if scale == "none":
        assert motion.skeleton.names == tuple(f"n{node}" for node in file.joints)


@strategies.few_examples(30)
@given(motion=strategies.motions(max_frames=12))
def test_read_gltf_written_motion_is_identical_to_float32(tmp_path_factory, motion):
    path = tmp_path_factory.mktemp("gltf") / "m.glb"
    formats.write_glb(motion, path, scale=0.01)
    (clip,) = mg.read(path)
    # Joints are in depth-first order.
    order = [motion.skeleton.index(name) for name in clip.skeleton.names]
    assert sorted(order) == list(range(motion.n_joints))
    assert clip.n_frames == motion.n_frames
    assert clip.duration == pytest.approx(motion.duration, rel=1e-6)
    # The writer may turn the figure to y up.
    own, given_positions = clip.world_positions(), 0.01 * motion.world_positions()[:, order]
    size = np.abs(given_positions).max()
    np.testing.assert_allclose(
        np.linalg.norm(own, axis=-1), np.linalg.norm(given_positions, axis=-1), atol=1e-5 * size
    )


def test_read_gltf_rate_gives_exact_duration(tmp_path):
    rng = np.random.default_rng(4)
    scene = random_scene(rng, scale="none", has_skin=False)
    path = write_gltf(tmp_path, *scene.document(rng), "glb")
    own = mg.read(path)[0]
    for rate in (10, 24, 59.94, 120):
        motion = mg.read(path, rate=rate)[0]
        assert motion.duration == pytest.approx(own.duration)
        assert motion.n_frames == round(own.duration * rate) + 1


GLB_FILES = sorted((DATA / "glb").glob("*.glb")) or [None]


@pytest.mark.parametrize("path", GLB_FILES, ids=lambda path: "none" if path is None else path.stem)
def test_read_gltf_recorded_file_agrees_with_slow_reader(path):
    require(path, DATA / "glb")
    clips = mg.read(path)
    file, oracle = read_gltf_file(path), Glb(path)
    rest = clips[0].skeleton.rest_positions()
    height = np.ptp(rest, axis=0).max()
    for clip in range(0, len(clips), 4):
        motion = clips[clip]
        animation = oracle.document["animations"][file.animations[clip]]
        scene = to_scene(oracle, animation)
        start = min(track.times[0] for track in scene.tracks)
        found = motion.world_positions()
        for frame in np.linspace(0, motion.n_frames - 1, 4).astype(int):
            time = start + frame * motion.frame_time
            expected = [scene.world_position(node, time) for node in file.joints]
            np.testing.assert_allclose(found[frame], expected, atol=2e-6 * height)


@pytest.mark.client
@pytest.mark.parametrize("path", GLB_FILES, ids=lambda path: "none" if path is None else path.stem)
def test_read_gltf_recorded_file_agrees_with_blender(path):
    require(path, DATA / "glb")
    play = blender_player()
    clips = mg.read(path)
    height = np.ptp(clips[0].skeleton.rest_positions(), axis=0).max()
    file = read_gltf_file(path)
    requests, expected = {}, {}
    for clip in clips:
        animation = file.container.items("animations")[
            file.animations[clips.names.index(clip.name)]
        ]
        start = read_start(file.container, animation)
        frames = np.linspace(0, clip.n_frames - 1, 5).astype(int)
        requests[clip.name] = (start + frames * clip.frame_time).tolist()
        x, y, z = np.moveaxis(clip.world_positions()[frames], -1, 0)
        expected[clip.name] = np.stack([x, -z, y], axis=-1)  # z is up in Blender
    found = play(path, requests)
    names = clips[0].skeleton.names
    joints = [joint for joint, name in enumerate(names) if name in found[clips.names[0]][0]]
    assert len(joints) >= len(names) - 1  # the common ancestor may be the armature itself
    for name in clips.names:
        heads = np.array([[pose[names[joint]] for joint in joints] for pose in found[name]])
        np.testing.assert_allclose(
            heads, expected[name][:, joints], atol=1e-4 * height, err_msg=name
        )


def read_start(container, animation):
    """Return the time of the first key of an animation."""
    inputs = {sampler["input"] for sampler in animation["samplers"]}
    return min(container.items("accessors")[index]["min"][0] for index in inputs)


def test_read_gltf_of_several_figures_takes_the_largest(tmp_path):
    nodes = [{"name": name} for name in "abcdef"]
    nodes[5]["children"], nodes[1]["children"], nodes[2]["children"] = [1], [2, 0], [4]
    document = {"asset": {"version": "2.0"}, "nodes": nodes, "skins": [{"joints": [3, 0, 4]}]}
    (tmp_path / "pair.gltf").write_text(json.dumps(document))
    file = read_gltf_file(tmp_path / "pair.gltf")
    assert file.joints.tolist() == [1, 2, 4, 0]
    assert file.moved_nodes.tolist() == [5, 1, 2, 4, 0]
    assert file.rest.parents.tolist() == [-1, 0, 1, 0]
    assert file.notes[0] == "left out the figures below the nodes d"
