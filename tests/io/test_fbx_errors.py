"""Invalid FBX files: every one raises `FormatError` with file and place, in bounded memory."""

import resource
import struct
import zlib

import numpy as np
import pytest

import mograft as mg
from tests.fuzz import fbx as fuzz_fbx
from tests.fuzz import outcome
from tests.io import fbx_scenes as fbx
from tests.io.fbx_scenes import Layer, Node, Scene, Take


@pytest.fixture(autouse=True)
def _extension():
    reason = "mograft-fbx is not installed: pip install ./python-fbx"
    pytest.importorskip("mograft_fbx", reason=reason)


def one_node(values=((1.0, 2.0, 3.0), (2.0, 3.0, 4.0)), first=0):
    values = np.array(values)
    takes = (Take("walk", len(values), (Layer({(0, "T"): values}),), first),)
    return Scene((Node("hips"),), takes)


def assert_refused(path, data, message):
    path.write_bytes(data)
    with pytest.raises(mg.FormatError, match=message) as caught:
        mg.read(path)[0]
    assert str(caught.value).startswith(f"{path}: ")
    return caught.value


@pytest.fixture
def path(tmp_path):
    return tmp_path / "walk.fbx"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no FBX",
        b"Kaydara FBX Binary  \0\x1a\0",
        b"Kaydara FBX Binary  \0\x1a\0\xe8\x1c\0\0" + 99 * b"\xff",
    ],
)
def test_fbx_other_content_is_refused(path, data):
    assert_refused(path, data, "expected an FBX file, got one that the library ufbx cannot read: ")


@pytest.mark.parametrize("version", [5800, 6000, 7800, 9000])
@pytest.mark.parametrize("write", [fbx.to_text, fbx.to_binary])
def test_fbx_other_version_is_refused(path, version, write):
    known = 7400 if version > 7000 else 6100
    data = write(one_node(), known).replace(struct.pack("<I", known), struct.pack("<I", version), 1)
    for text in ("FBXVersion: {}", "FBX {0[0]}.{0[1]}.0"):
        data = data.replace(text.format(str(known)).encode(), text.format(str(version)).encode())
    assert_refused(path, data, rf"version.*\D{version}\b")


@pytest.mark.parametrize("container", sorted(fbx.CONTAINERS))
def test_fbx_truncated_file_is_refused_or_has_fewer_takes(path, container):
    data = fbx.CONTAINERS[container](one_node())
    n_refused = 0
    for size in range(0, len(data) - 30, len(data) // 60):
        path.write_bytes(data[:size])
        clips = outcome(mg.read, path)
        n_refused += isinstance(clips, mg.FormatError)
        if not isinstance(clips, mg.FormatError):
            assert "text" in container
    assert n_refused


def test_fbx_duration_beyond_size_of_file_is_refused(path):
    data = fbx.to_text(one_node())
    stop = str(fbx.TICKS // 30).encode()
    claimed = data.replace(
        b'"LocalStop", "KTime", "Time", "", ' + stop,
        b'"LocalStop", "KTime", "Time", "", ' + str(fbx.TICKS * 10**7).encode(),
    )
    assert claimed != data
    error = assert_refused(path, claimed, r"expected at most 2097152 frames .*, got 300000001")
    assert error.place == "take 'walk'"


def test_fbx_hierarchy_deeper_than_limit_is_refused(path):
    nodes = tuple(Node(f"joint{number}", number - 1) for number in range(1001))
    assert_refused(path, fbx.to_binary(Scene(nodes, one_node().takes)), "Node depth limit exceeded")
    path.write_bytes(fbx.to_binary(Scene(nodes[:-2], one_node().takes)))
    assert mg.read(path)[0].n_joints == 999


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
def test_fbx_transform_that_is_not_finite_is_refused(path, value):
    scene = one_node(((0.0, 0.0, 0.0), (value, 0.0, 0.0)))
    if np.isfinite(value):  # finite in the file, and not after three scales
        layer = Layer({(0, "T"): np.full((2, 3), value)})
        nodes = (Node("hips", S=(1e308,) * 3), Node("spine", 0, S=(1e308,) * 3), Node("head", 1))
        scene = Scene(nodes, (Take("walk", 2, (layer,)),))
    error = assert_refused(path, fbx.to_binary(scene), "expected finite|finite rest pose")
    assert error.place in {"take 'walk'", None}


def test_fbx_frame_rate_that_is_not_credible_needs_rate(path):
    data = fbx.to_text(one_node())
    mode = b'"TimeMode", "enum", "", "", 6'
    custom = (
        b'"TimeMode", "enum", "", "", 14\n\t\tP: "CustomFrameRate", "double", "Number", "", 1e300'
    )
    assert mode in data
    path.write_bytes(data.replace(mode, custom))
    with pytest.raises(mg.FormatError, match=r"GlobalSettings: expected a frame time .*1e-300"):
        mg.read(path)
    assert mg.read(path, rate=30)[0].n_frames == 2


def test_fbx_array_of_16_gib_is_refused_in_bounded_memory(path):
    packed = zlib.compress(bytes(1 << 20))
    array = b"l" + struct.pack("<III", 1 << 31, 1, len(packed)) + packed
    keys = np.arange(2) * (fbx.TICKS // 30)
    small = b"l" + struct.pack("<III", 2, 0, 16) + keys.astype("<i8").tobytes()
    data = fbx.to_binary(one_node())
    assert data.count(small) == 3
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert_refused(path, data.replace(small, array, 1), "ufbx cannot read: Memory limit")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


@pytest.mark.parametrize("seed", [*range(40), *fuzz_fbx.SEEDS])
def test_fbx_damaged_file_is_read_or_refused(tmp_path, seed):
    fuzz_fbx.check(seed, tmp_path)


def test_fbx_names_with_control_characters_are_printable(path):
    scene = Scene((Node("hi\nps\t"), Node(" ", 0)), one_node().takes)
    path.write_bytes(fbx.to_binary(scene))
    assert mg.read(path)[0].skeleton.names == ("hi_ps_", "node2")
