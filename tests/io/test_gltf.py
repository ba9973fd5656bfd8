"""Reading of glTF files: agreement with a slow evaluation of the same scenes."""

import json
import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.io.gltf.document import read_gltf_file
from tests.fuzz import gltf as fuzz_gltf
from tests.io.gltf_scenes import Scene, Track, pack_glb, random_scene, write_gltf

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
    rate=st.none() | st.sampled_from([10, 24, 59.94, 120]),
)
def test_read_gltf_random_scene_equals_evaluation(
    tmp_path_factory, seed, scale, has_skin, way, rate
):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, scale=scale, has_skin=has_skin)
    path = write_gltf(tmp_path_factory.mktemp("gltf"), *scene.document(rng), way)
    clips = mg.read(path, rate=rate)
    file = read_gltf_file(path)
    assert set(file.joints.tolist()) == expected_joints(scene)
    moved = set(file.moved_nodes.tolist())
    moving = [track for track in scene.tracks if track.node in moved]
    if not moving:
        assert len(clips) == 0
        return
    motion = clips["move"]
    start = min(track.times[0] for track in moving)
    stop = max(track.times[-1] for track in moving)
    assert motion.duration == pytest.approx(stop - start, abs=1e-9)
    if rate is not None and stop > start:
        assert motion.n_frames == max(round((stop - start) * rate), 1) + 1
    times = start + np.arange(motion.n_frames) * motion.frame_time
    worlds = [[scene.world_matrix(node, time) for node in file.joints] for time in times]
    expected = np.array(worlds)[..., :3, 3]
    size = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(motion.world_positions(), expected, atol=2e-5 * size)
    rest = np.array([scene.world_matrix(node, None)[:3, 3] for node in file.joints])
    np.testing.assert_allclose(motion.skeleton.rest_positions(), rest, atol=1e-5 * size)
    # Joints without scale and translation above them keep the rotation of the file.
    if scale == "none":
        assert motion.skeleton.names == tuple(f"n{node}" for node in file.joints)


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


TARGET = {"node": 1, "path": "rotation"}
SAMPLER, CHANNEL = ("animations", 0, "samplers", 0), ("animations", 0, "channels", 1)
ZEROS = {"count": 10**10, "componentType": 5126, "type": "VEC4"}
TIMES = np.array([0.0, 0.5, 1.0])


def document():
    """The document and buffer of three nodes; the second turns, the third moves."""
    quats = np.array([[0, 0, 0, 1.0], [0, 0, 0.6, 0.8], [0, 0, 0, 1.0]])
    places = np.arange(9.0).reshape(3, 3)
    turning = Track(1, "rotation", "LINEAR", TIMES, quats)
    tracks = [turning, Track(2, "translation", "STEP", TIMES, places)]
    identity = np.tile([0, 0, 0, 1.0], (3, 1))
    return Scene([-1, 0, 1], np.eye(3), identity, np.ones((3, 3)), tracks, [0, 1, 2]).document()


def read_all(path):
    for motion in mg.read(path):
        assert np.isfinite(motion.world_positions()).all()


def change(place, value):
    """Return the GLB bytes of the scene with a value of its document changed."""
    found, binary = document()
    inner = found
    for key in place[:-1]:
        inner = inner[key]
    if value is KeyError:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    return pack_glb(found, binary)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("asset",), KeyError, "JSON: expected an object with `asset`"),
        (("asset", "version"), "1.0", "asset.version: expected glTF 2.0, got '1.0'"),
        (("nodes",), 3, "nodes: expected a list, got 3"),
        (("nodes", 1), 3, r"nodes\[1\]: expected an object, got 3"),
        (("nodes", 2, "children"), [0], "nodes: expected trees"),
        (("nodes", 2, "children"), [1], r"nodes\[1\]: expected one parent, got 0 and 2"),
        (("nodes", 1, "children"), [9], r"nodes\[1\].children: expected an index of 3 nodes, got"),
        (("nodes", 0, "rotation"), [0, 0, 0, 0], r"nodes\[0\].rotation: expected a unit"),
        (("nodes", 0, "scale"), [1, 1], r"nodes\[0\].scale: expected 3 numbers"),
        (("nodes", 0, "matrix"), [1] * 15, r"nodes\[0\].matrix: expected 16 numbers"),
        (("skins", 0, "joints"), [5], r"skins\[0\].joints: expected an index of 3 nodes, got 5"),
        (("accessors", 1, "count"), 10**10, r"accessors\[1\]: expected elements within 48 bytes"),
        (("accessors", 1, "count"), 2, r"animations\[0\]: the rotation tracks: expected 3 elem"),
        (("accessors", 1, "count"), 0, r"accessors\[1\].count: expected an integer of at least 1"),
        (("accessors", 1, "componentType"), 5125.5, r"accessors\[1\].componentType: expected"),
        (("accessors", 1, "type"), "VEC3", r"accessors\[1\].type: expected 4 components"),
        (("accessors", 1, "byteOffset"), 4, r"accessors\[1\]: expected elements within 48 bytes"),
        (("accessors", 1, "bufferView"), 99, r"accessors\[1\].bufferView: expected an index of"),
        (("bufferViews", 1, "byteOffset"), 10**9, r"bufferViews\[1\]: expected an end within"),
        (("bufferViews", 1, "byteStride"), 4, r"bufferViews\[1\].byteStride: expected at least 16"),
        (("bufferViews", 1, "buffer"), 1, r"bufferViews\[1\].buffer: expected an index of 1 buff"),
        (("bufferViews", 1, "extensions"), {"EXT_meshopt_compression": {}}, r".*got meshopt"),
        (("buffers", 0, "byteLength"), 10**10, r"buffers\[0\]: expected 10000000000 bytes, got"),
        (("buffers", 0, "uri"), "../a.bin", r"buffers\[0\].uri: expected a file in the folder"),
        (("buffers", 0, "uri"), "%2e%2e/a.bin", r"buffers\[0\].uri: expected a file in the folder"),
        (("buffers", 0, "uri"), "/etc/passwd", r"buffers\[0\].uri: expected a relative path"),
        (("buffers", 0, "uri"), "file:///etc/passwd", r"buffers\[0\].uri: expected a relative"),
        (("buffers", 0, "uri"), "no.bin", r"buffers\[0\].uri: expected a file, found none"),
        (("buffers", 0, "uri"), "data:;base64,*", r"buffers\[0\].uri: expected base64 data"),
        ((*SAMPLER, "interpolation"), "X", r".*\[0\].interpolation: expected"),
        ((*CHANNEL, "target"), TARGET, r".*expected one track of the rotation of node 1"),
        (("accessors", 1), ZEROS, r"accessors\[1\].count: expected elements in the file, got 1000"),
    ],
)
def test_read_gltf_invalid_document_raises_format_error(tmp_path, place, value, message):
    assert_refused(tmp_path / "bad.glb", change(place, value), message)


def assert_refused(path, data, message):
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=rf"bad\.glb: {message}"):
        read_all(path)


def pack_head(length, chunk_length):
    return struct.pack("<4sIII4s", b"glTF", 2, length, chunk_length, b"JSON")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"glTF", "byte 0: expected a header of 12 bytes"),
        (struct.pack("<4sII", b"glTF", 1, 12), "byte 4: expected version 2 of GLB, got 1"),
        (struct.pack("<4sII", b"glTF", 2, 2**32 - 1), "byte 8: expected 4294967295 bytes"),
        (struct.pack("<4sII", b"glTF", 2, 12), "byte 12: expected a JSON chunk"),
        (pack_head(20, 2**32 - 1), "byte 12: expected a chunk of at most 0 bytes, got 4294967295"),
        (pack_head(20, 0), "JSON chunk: expected JSON"),
        (pack_head(24, 4) + b"\xff" * 4, "JSON chunk: expected"),
        (b'{"asset":' + b"[" * 100_000, "JSON: expected JSON"),
    ],
)
def test_read_gltf_invalid_container_raises_format_error(tmp_path, data, message):
    assert_refused(tmp_path / "bad.glb", data, message)


def test_read_gltf_link_out_of_folder_raises_format_error(tmp_path):
    (tmp_path / "outside.bin").write_bytes(bytes(1000))
    folder = tmp_path / "in"
    folder.mkdir()
    path = write_gltf(folder, *document(), "external")
    read_all(path)
    (folder / "a b.bin").unlink()
    (folder / "a b.bin").symlink_to(tmp_path / "outside.bin")
    with pytest.raises(mg.FormatError, match=r"buffers\[0\].uri: expected a file in the folder"):
        read_all(path)


def test_read_gltf_long_duration_of_few_keys_raises_format_error(tmp_path):
    found, binary = document()
    binary = bytearray(binary)
    for view in (0, 2):
        end = found["bufferViews"][view]["byteOffset"] + 12
        binary[end - 4 : end] = struct.pack("<f", 1e30)
    path = tmp_path / "long.glb"
    path.write_bytes(pack_glb(*document()))
    read_all(path)  # modules that are imported by the first use are not measured
    path.write_bytes(pack_glb(found, bytes(binary)))
    tracemalloc.start()
    with pytest.raises(mg.FormatError, match=r"animations\[0\]: a duration of 1e\+30 s at 30"):
        read_all(path)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


@pytest.mark.parametrize("is_shared", ["times", "values"])
def test_read_gltf_keys_that_share_bytes_raises_format_error_in_bounded_memory(tmp_path, is_shared):
    """A file of 1.7 MB with 300 tracks claims 30 million keys, 0.9 GB of numbers."""
    n_tracks, n_keys = 300, 100_000
    binary = np.linspace(0, 3, 4 * n_keys, dtype="<f4").tobytes()
    accessors = [{"bufferView": 0, "componentType": 5126, "count": n_keys, "type": "SCALAR"}]
    accessors *= n_tracks if is_shared == "times" else 1
    outputs = len(accessors)
    accessors.append({"bufferView": 0, "componentType": 5126, "count": n_keys, "type": "VEC4"})
    numbers = range(n_tracks)
    samplers = [{"input": i % outputs, "output": outputs} for i in numbers]
    channels = [{"sampler": i, "target": {"node": i + 1, "path": "rotation"}} for i in numbers]
    found = {
        "asset": {"version": "2.0"},
        "nodes": [{"children": [i + 1 for i in numbers]}, *({} for _ in numbers)],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(binary)}],
        "accessors": accessors,
        "animations": [{"channels": channels, "samplers": samplers}],
    }
    path = tmp_path / "shared.glb"
    path.write_bytes(pack_glb(found, binary))
    tracemalloc.start()
    with pytest.raises(mg.FormatError, match=r"animations\[0\]: expected at most \d+ keys"):
        mg.read(path, rate=1)[0]
    assert tracemalloc.get_traced_memory()[1] < 50 * path.stat().st_size
    tracemalloc.stop()


@pytest.mark.parametrize("seed", [*fuzz_gltf.SEEDS, *range(120)])
def test_read_gltf_damaged_file_is_refused_or_read(seed, tmp_path):
    fuzz_gltf.check(seed, tmp_path)
