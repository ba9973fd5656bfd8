"""Invalid glTF files: each raises a FormatError that names the file and the place."""

import json
import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from tests.fuzz import gltf as fuzz_gltf
from tests.io.gltf_scenes import Scene, Track, pack_glb, write_gltf

TIMES = np.array([0.0, 0.5, 1.0])
HOSTILE = (None, True, -1, 0, 1, 7, 1e9, 2**31, 2**64, 0.5, float("nan"), "x", [], [0], {}, [{}])


def scene():
    """Three nodes; the second turns, the third moves."""
    quats = np.array([[0, 0, 0, 1.0], [0, 0, 0.6, 0.8], [0, 0, 0, 1.0]])
    tracks = [
        Track(1, "rotation", "LINEAR", TIMES, quats),
        Track(2, "translation", "STEP", TIMES, np.arange(9.0).reshape(3, 3)),
    ]
    identity = np.tile([0, 0, 0, 1.0], (3, 1))
    return Scene([-1, 0, 1], np.eye(3), identity, np.ones((3, 3)), tracks, [0, 1, 2])


class Plain:
    """A generator that chooses the plain form of every accessor."""

    def integers(self, _):
        return 0


def document():
    return scene().document(Plain())


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
        (
            ("nodes", 1, "children"),
            [9],
            r"nodes\[1\].children: expected an index of 3 nodes, got 9",
        ),
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
        (
            ("bufferViews", 1, "extensions"),
            {"EXT_meshopt_compression": {}},
            r"bufferViews\[1\]: expected uncompressed data, got meshopt",
        ),
        (("buffers", 0, "byteLength"), 10**10, r"buffers\[0\]: expected 10000000000 bytes, got"),
        (("buffers", 0, "uri"), "../a.bin", r"buffers\[0\].uri: expected a file in the folder"),
        (("buffers", 0, "uri"), "%2e%2e/a.bin", r"buffers\[0\].uri: expected a file in the folder"),
        (("buffers", 0, "uri"), "/etc/passwd", r"buffers\[0\].uri: expected a relative path"),
        (
            ("buffers", 0, "uri"),
            "file:///etc/passwd",
            r"buffers\[0\].uri: expected a relative path",
        ),
        (("buffers", 0, "uri"), "no.bin", r"buffers\[0\].uri: expected a file, found none"),
        (("buffers", 0, "uri"), "data:;base64,*", r"buffers\[0\].uri: expected base64 data"),
        (
            ("animations", 0, "samplers", 0, "interpolation"),
            "SPLINE",
            r"animations\[0\].samplers\[0\].interpolation: expected an interpolation",
        ),
        (
            ("animations", 0, "channels", 1, "target"),
            {"node": 1, "path": "rotation"},
            r"animations\[0\].channels\[1\]: expected one track of the rotation of node 1",
        ),
        (
            ("accessors", 1),
            {"count": 10**10, "componentType": 5126, "type": "VEC4"},
            r"accessors\[1\].count: expected elements in the file, got 10000000000 zeros",
        ),
    ],
)
def test_read_gltf_invalid_document_raises_format_error(tmp_path, place, value, message):
    path = tmp_path / "bad.glb"
    path.write_bytes(change(place, value))
    with pytest.raises(mg.FormatError, match=rf"bad\.glb: {message}"):
        read_all(path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"glTF", "byte 0: expected a header of 12 bytes"),
        (struct.pack("<4sII", b"glTF", 1, 12), "byte 4: expected version 2 of GLB, got 1"),
        (struct.pack("<4sII", b"glTF", 2, 2**32 - 1), "byte 8: expected 4294967295 bytes"),
        (struct.pack("<4sII", b"glTF", 2, 12), "byte 12: expected a JSON chunk"),
        (
            struct.pack("<4sIII4s", b"glTF", 2, 20, 2**32 - 1, b"JSON"),
            "byte 12: expected a chunk of at most 0 bytes, got 4294967295",
        ),
        (struct.pack("<4sIII4s", b"glTF", 2, 20, 0, b"JSON"), "JSON chunk: expected JSON"),
        (struct.pack("<4sIII4s", b"glTF", 2, 24, 4, b"JSON") + b"\xff" * 4, "JSON chunk: expected"),
    ],
)
def test_read_gltf_invalid_container_raises_format_error(tmp_path, data, message):
    path = tmp_path / "bad.glb"
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=rf"bad\.glb: {message}"):
        mg.read(path)


def test_read_gltf_nested_json_raises_format_error(tmp_path):
    path = tmp_path / "deep.gltf"
    path.write_text('{"asset":' + "[" * 100_000)
    with pytest.raises(mg.FormatError, match=r"deep\.gltf: JSON: expected JSON"):
        mg.read(path)


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


def test_read_gltf_every_truncation_raises_format_error(tmp_path):
    data = pack_glb(*document())
    path = tmp_path / "short.glb"
    for length in range(4, len(data), 7):
        path.write_bytes(data[:length])
        with pytest.raises(mg.FormatError, match=r"short\.glb: byte"):
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


@given(data=st.data())
def test_read_gltf_hostile_value_raises_format_error_or_reads(tmp_path_factory, data):
    found, binary = document()
    inner = found
    while True:
        keys = list(inner) if isinstance(inner, dict) else list(range(len(inner)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(inner[key], list | dict) or not inner[key] or data.draw(st.booleans()):
            break
        inner = inner[key]
    inner[key] = data.draw(st.sampled_from(HOSTILE))
    path = tmp_path_factory.mktemp("hostile") / "hostile.glb"
    path.write_bytes(pack_glb(json.loads(json.dumps(found)), binary))
    outcome = None
    try:
        read_all(path)
    except mg.FormatError as error:
        outcome = str(error)
    assert outcome is None or outcome.startswith(f"{path}: ")


@pytest.mark.parametrize("seed", [*fuzz_gltf.SEEDS, *range(60)])
def test_read_gltf_damaged_file_is_refused_or_read(seed, tmp_path):
    fuzz_gltf.check(seed, tmp_path)
