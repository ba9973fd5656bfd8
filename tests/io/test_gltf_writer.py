"""Writing of motions into copies of glTF files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.io.gltf.container import read_container
from mograft.io.gltf.document import read_gltf_file
from mograft.motion import rotations
from tests import clients, strategies
from tests.io.gltf_scenes import random_scene, write_gltf

SCALES = st.sampled_from(["none", "uniform", "mirrored", "any"])
WAYS = st.sampled_from(["glb", "external", "embedded"])


def write_scene(tmp_path_factory, seed, scale="none", way="glb"):
    """Write a random scene with at least one clip; return the file, its clip and the generator."""
    rng = np.random.default_rng(seed)
    while True:
        scene = random_scene(rng, scale=scale, has_skin=bool(rng.integers(2)))
        path = write_gltf(tmp_path_factory.mktemp("gltf"), *scene.document(rng), way)
        clips = mg.read(path)
        if len(clips):
            return path, clips[0], rng


def change_joints(motion, rng):
    """Return a motion with other rotations or positions of some joints."""
    turned, places = motion.rotations.copy(), motion.positions.copy()
    is_turned, is_moved = rng.random((2, motion.n_joints)) < 0.4
    quats = rng.normal(size=turned[:, is_turned].shape)
    turned[:, is_turned] = quats / np.linalg.norm(quats, axis=2, keepdims=True)
    places[:, is_moved] += rng.uniform(-1, 1, places[:, is_moved].shape)
    return replace(motion, rotations=turned, positions=places, channel_values=None, name="new")


def assert_same_motion(actual, desired, atol):
    """Compare world transforms; `atol` is that of positions as a fraction of their size."""
    assert actual.skeleton.names == desired.skeleton.names
    assert actual.n_frames == desired.n_frames
    assert actual.frame_time == pytest.approx(desired.frame_time, rel=1e-6)
    (turns, places), (own_turns, own_places) = desired.world_transforms(), actual.world_transforms()
    size = max(1.0, np.abs(places).max())
    np.testing.assert_allclose(own_places, places, atol=atol * size)
    np.testing.assert_allclose(rotations.angle(own_turns, turns), 0.0, atol=2e-6)


@given(seed=st.integers(0, 2**32 - 1), scale=SCALES, way=WAYS, has_base=st.booleans())
def test_write_glb_animations_adds_a_motion_to_float32_and_keeps_all_content(
    tmp_path_factory, seed, scale, way, has_base
):
    path, clip, rng = write_scene(tmp_path_factory, seed, scale, way)
    motion, target = change_joints(clip, rng), path.with_name("out.glb")
    formats.write_glb_animations(path, motion, target, bases=[clip if has_base else None])
    written = mg.read(target, rate=clip.rate)
    # Scales of 0.5 to 2 along each axis stretch an error by up to 4 at every level.
    stretch = 4.0**clip.n_joints if scale == "any" else 8.0
    assert_same_motion(written["new"], motion, 1e-7 * stretch + 1e-6)
    assert_same_motion(written["move"], clip, 0.0)
    old, new = read_container(path), read_container(target)
    assert new.document.keys() == old.document.keys()
    for name, value in old.document.items():
        if name in ("animations", "accessors", "bufferViews"):
            assert new.document[name][: len(value)] == value
        elif name == "nodes":
            for before, after in zip(value, new.document[name], strict=True):
                assert after == before or ("matrix" in before and "matrix" not in after)
        elif name != "buffers":
            assert new.document[name] == value
    (length,) = (buffer["byteLength"] for buffer in old.document["buffers"])
    assert bytes(new.buffer(0, ""))[:length] == bytes(old.buffer(0, ""))


@pytest.mark.parametrize("rate", [None, 24])
def test_write_glb_animations_unchanged_joints_keep_their_tracks(tmp_path_factory, rate):
    path, _, _ = write_scene(tmp_path_factory, 5)
    clip = mg.read(path, rate=rate)[0]
    turned = clip.rotations.copy()
    swing = rotations.from_axis_angle([0, 1, 0], np.linspace(0, 1, clip.n_frames))
    turned[:, -1] = rotations.multiply(turned[:, -1], swing)
    target, motion = path.with_name("out.glb"), replace(clip, rotations=turned)
    formats.write_glb_animations(path, [clip, motion], target, bases=[clip, clip])
    old, new = read_container(path), read_container(target)
    before, same, after = (
        {(*own["target"].values(),): item["samplers"][own["sampler"]] for own in item["channels"]}
        for item in new.items("animations")
    )
    assert same == before
    changed = [key for key, sampler in after.items() if before.get(key) != sampler]
    assert changed == [(read_gltf_file(path).joints[-1], "rotation")]
    assert 1 <= len(new.items("accessors")) - len(old.items("accessors")) <= 2


def test_write_glb_animations_repeated_names_are_made_unique(tmp_path_factory):
    path, clip, _ = write_scene(tmp_path_factory, 6)
    target = path.with_name("out.glb")
    formats.write_glb_animations(path, [clip, clip, replace(clip, name="")], target)
    assert mg.read(target).names == ("move", "move~2", "move~3", "motion")


@pytest.mark.parametrize("scale", [[0, 0, 0], [1, 0, 1]])
def test_write_glb_animations_below_zero_scale_keeps_translations(tmp_path, scale):
    document = {
        "asset": {"version": "2.0"},
        "nodes": [
            {"name": "a", "children": [1]},
            {"name": "b", "children": [2], "scale": scale, "translation": [0, 1, 0]},
            {"name": "c", "translation": [0, 2, 0]},
        ],
        "skins": [{"joints": [0, 1, 2]}],
    }
    path = tmp_path / "still.gltf"
    path.write_text(json.dumps(document))
    skeleton = mg.Skeleton(["a", "b", "c"], [-1, 0, 1], [[0, 0, 0], [0, 1, 0], [0, 0, 0]])
    quats = np.tile(rotations.from_axis_angle([0, 0, 1], 0.5), (3, 3, 1))
    motion = replace(strategies.motion_of(skeleton, quats, name="turn"), frame_time=0.1)
    formats.write_glb_animations(path, motion, tmp_path / "out.glb")
    assert_same_motion(mg.read(tmp_path / "out.glb", rate=10)["turn"], motion, 1e-6)


def test_write_glb_animations_keeps_the_matrix_of_a_node_with_only_other_channels(tmp_path):
    sheared = [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 3, 0, 1]
    turns = np.float32([[0, 0, 0, 1], [0, 0, 0.6, 0.8]])
    numbers = np.concatenate([np.float32([0, 1]), turns.ravel(), np.float32([0, 1])])
    starts, shapes = (0, 8, 40), ((2, "SCALAR"), (2, "VEC4"), (2, "SCALAR"))
    views = [*zip(starts, (8, 32, 8), strict=True)]
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"name": "a", "children": [1]}, {"name": "b", "matrix": sheared}],
        "skins": [{"joints": [0]}],
        "buffers": [{"byteLength": numbers.nbytes}],
        "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
        "accessors": [
            {"bufferView": view, "componentType": 5126, "count": count, "type": kind}
            for view, (count, kind) in enumerate(shapes)
        ],
        "animations": [
            {
                "name": "move",
                "samplers": [{"input": 0, "output": 1}, {"input": 0, "output": 2}],
                "channels": [
                    {"sampler": 0, "target": {"node": 0, "path": "rotation"}},
                    {"sampler": 1, "target": {"node": 1, "path": "weights"}},
                ],
            }
        ],
    }
    document["accessors"][0] |= {"min": [0], "max": [1]}
    path, target = write_gltf(tmp_path, document, numbers.tobytes(), "glb"), tmp_path / "out.glb"
    clip = mg.read(path)[0]
    motion = change_joints(clip, np.random.default_rng(1))
    formats.write_glb_animations(path, motion, target, bases=[clip])
    assert read_container(target).items("nodes")[1]["matrix"] == sheared
    assert len(read_container(target).items("animations")[1]["channels"]) >= 2


def test_write_glb_animations_buffers_and_images_of_other_files_become_one(
    tmp_path, tmp_path_factory
):
    path, clip, rng = write_scene(tmp_path_factory, 8, way="external")
    document = json.loads(path.read_text())
    picture = b"\x89PNG\r\n\x1a\n" + bytes(range(90))
    (path.parent / "skin.png").write_bytes(picture)
    document["images"] = [{"uri": "skin.png", "name": "skin"}, {"uri": "none.png"}, {"uri": "../x"}]
    (path.parent / "more.bin").write_bytes(b"abcde")
    document["buffers"] += [{"uri": "more.bin", "byteLength": 5}, {"byteLength": 9, "name": "none"}]
    last = len(document["bufferViews"])
    compression = {"EXT_meshopt_compression": {"buffer": 1, "byteOffset": 1, "byteLength": 3}}
    document["bufferViews"].append({"buffer": 1, "byteOffset": 1, "byteLength": 3})
    document["bufferViews"].append({"buffer": 2, "byteLength": 9, "extensions": compression})
    path.write_text(json.dumps(document))
    formats.write_glb_animations(path, change_joints(clip, rng), tmp_path / "out.glb")
    new = read_container(tmp_path / "out.glb")
    assert [own.get("name") for own in new.items("buffers")] == [None, "none"]
    image, *others = new.document["images"]
    assert others == document["images"][1:]
    assert image == {"name": "skin", "mimeType": "image/png", "bufferView": image["bufferView"]}
    first, second = new.items("bufferViews")[last : last + 2]
    assert (first["buffer"], second["buffer"]) == (0, 1)
    data = bytes(new.buffer(0, ""))
    compressed = second["extensions"]["EXT_meshopt_compression"]
    pairs = [(new.items("bufferViews")[image["bufferView"]], picture)]
    for view, content in [*pairs, (first, b"bcd"), (compressed, b"bcd")]:
        assert data[view["byteOffset"] :][: view["byteLength"]] == content
    assert_same_motion(mg.read(tmp_path / "out.glb")["move"], clip, 0.0)


def test_write_glb_animations_invalid_argument_raises_error(tmp_path, tmp_path_factory):
    path, clip, _ = write_scene(tmp_path_factory, 9)
    target = tmp_path / "out.glb"

    def fails(error, match, motions, **options):
        with pytest.raises(error, match=match):
            formats.write_glb_animations(path, motions, target, **options)

    fails(ValueError, "`motions` must hold at least one motion", [])
    fails(TypeError, "`motions` must be a Motion", [3])
    fails(TypeError, "`bases` must be a Motion", clip, bases=[3])
    fails(ValueError, "`bases` must have 1 items, got 0", clip, bases=[])
    fails(ValueError, "which has no 'other'", clip, bases=[replace(clip, name="other")])
    slow = replace(clip, frame_time=2 * clip.frame_time)
    fails(ValueError, "whose clip move does not last", clip, bases=[slow])
    fails(ValueError, "as many frames and joints as their motions", clip[:-1], bases=[clip])
    other = replace(clip, skeleton=replace(clip.skeleton, names=("x",) * clip.n_joints))
    fails(mg.SkeletonMismatchError, "lacks", other)
    assert not target.exists()


def issue_codes(path):
    """Return the codes of the errors and warnings of the Khronos validator."""
    messages = clients.gltf_validator()(path)
    return {own["code"] for own in messages if own["severity"] < 2}


@pytest.mark.client
@pytest.mark.parametrize("way", ["glb", "embedded"])
def test_write_glb_animations_adds_no_issue_of_khronos_validator(tmp_path_factory, way):
    for seed in range(4):
        path, clip, rng = write_scene(tmp_path_factory, seed, way=way)
        target = path.with_name("out.glb")
        motions = [change_joints(clip, rng), clip]
        formats.write_glb_animations(path, motions, target, bases=[clip, None])
        assert issue_codes(target) <= issue_codes(path)
