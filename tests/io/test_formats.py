"""The registry of formats, clip addresses, the change of the rest pose, NPZ, CSV and `export`."""

import csv
import io
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.cli import main
from mograft.dancer import dance
from mograft.io import formats as io_formats
from mograft.io.formats import find_addresses, read_clip, split_address
from mograft.io.gltf.container import read_container
from tests import strategies
from tests.io.bvh_helpers import assert_same_skeleton


def test_read_content_decides_over_suffix(tmp_path):
    motion = dance(strides=1).motion[:3]
    mg.formats.write_npz(motion, tmp_path / "dance.npz")
    (tmp_path / "dance.npz").rename(tmp_path / "dance.bvh")
    assert mg.read(tmp_path / "dance.bvh").format == "NPZ"
    for name in ("dance.txt", "dance"):
        mg.write_bvh(motion, tmp_path / name)
        assert mg.read(tmp_path / name).format == "BVH"


def test_read_clips_are_indexed_and_resampled(tmp_path):
    path = tmp_path / "dance.bvh"
    mg.write_bvh(dance(strides=1).motion[:61], path)
    clips = mg.read(path, rate=10)
    assert clips[-1].name == clips[np.int64(0)].name == "dance"
    assert clips[0].n_frames == 21
    with pytest.raises(IndexError, match=r"dance\.bvh has 1 clip, got the index 1"):
        clips[1]
    with pytest.raises(TypeError, match="must be an integer, name or slice, got float"):
        clips[0.0]
    with pytest.raises(ValueError, match="`rate` must be above 0"):
        mg.read(path, rate=0)


def test_split_address_prefers_longest_existing_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.glb", "a.glb#b", "c#d.bvh"):
        (tmp_path / name).touch()
    assert split_address("a.glb#b#c") == ("a.glb#b", "c")
    assert split_address("a.glb#x#c") == ("a.glb", "x#c")
    assert split_address("a.glb#b") == ("a.glb#b", None)
    assert split_address("c#d.bvh") == ("c#d.bvh", None)
    assert split_address("none.glb#a#b") == ("none.glb#a", "b")
    assert split_address("#b") == ("", "b")


@pytest.mark.parametrize(
    "error",
    [mg.FormatError("expected X", "a.glb", "byte 3"), mg.BvhError("expected X", "a.bvh", 3, 4)],
)
def test_format_error_survives_pickle(error):
    copy = pickle.loads(pickle.dumps(error))
    assert (str(copy), vars(copy), type(copy)) == (str(error), vars(error), type(error))
    assert isinstance(copy, ValueError)


def test_open_clips_parses_a_file_once_and_again_after_a_change(tmp_path, monkeypatch):
    motion, path, parsed = dance(strides=1).motion[:9], tmp_path / "a.glb", []
    mg.formats.write_glb([motion, motion[:4]], path)
    real = io_formats.read
    monkeypatch.setattr(
        io_formats, "read", lambda path, **options: parsed.append(path) or real(path, **options)
    )
    addresses = find_addresses(str(path))
    assert find_addresses(f"{path}#dance*") == addresses
    assert [read_clip(address).n_frames for address in addresses] == [9, 4]
    assert parsed == [str(path)]
    mg.formats.write_glb([motion[:5], motion[:6]], path)
    assert read_clip(addresses[-1]).n_frames == 6


@given(strategies.motions(max_frames=20) | st.just(dance(strides=1).motion[:9]))
def test_npz_round_trip_has_precision_of_float32_and_the_same_bytes(tmp_path_factory, motion):
    """The dance has end sites and other channels."""
    path = tmp_path_factory.mktemp("npz") / "m.npz"
    for target in (path, path.with_name("again.npz")):
        formats.write_npz(motion, target)
    assert path.read_bytes() == target.read_bytes()
    again = mg.read(path)[0]
    assert again.name == motion.name
    strategies.assert_same_rotations(again.rotations, motion.rotations, atol=1e-6)
    np.testing.assert_allclose(again.positions, motion.positions, rtol=1e-6, atol=1e-30)
    assert again.frame_time == motion.frame_time
    assert_same_skeleton(again.skeleton, motion.skeleton)
    with np.load(path, allow_pickle=False) as data:
        world = motion.world_positions().astype(np.float32)
        np.testing.assert_array_equal(data["world_positions"], world)


def test_write_csv_holds_world_positions(motion, tmp_path):
    formats.write_csv(motion, tmp_path / "m.csv")
    rows = list(csv.reader(io.StringIO((tmp_path / "m.csv").read_text())))
    assert rows[0][:5] == ["frame", "time", "Hips.x", "Hips.y", "Hips.z"]
    table = np.array(rows[1:], float)
    np.testing.assert_array_equal(table[:, 0], np.arange(motion.n_frames))
    np.testing.assert_allclose(table[:, 1], np.arange(motion.n_frames) / 30, rtol=1e-8)
    world = motion.world_positions().reshape(motion.n_frames, -1)
    np.testing.assert_allclose(table[:, 2:], world, rtol=1e-8, atol=1e-8)


def write(suffix, motion, path):
    """Write a GLB, USD or NPZ file, with lengths in metres."""
    if suffix == "usda":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    options = {} if suffix == "npz" else {"scale": 1.0}
    getattr(formats, f"write_{suffix.removesuffix('a')}")(motion, path / f"a.{suffix}", **options)


@pytest.mark.parametrize("suffix", ["glb", "usda", "npz"])
def test_write_value_beyond_single_precision_names_joint_and_frame(motion, tmp_path, suffix):
    name, skeleton = motion.skeleton.names[3], motion.skeleton
    offsets, positions = skeleton.offsets.copy(), motion.positions.copy()
    offsets[3, 1] = positions[2, 3, 1] = 1e39
    with pytest.raises(ValueError, match=rf"position of {name} in frame 2 .* got 1e\+39"):
        write(suffix, replace(motion, positions=positions), tmp_path)
    if suffix != "npz":
        with pytest.raises(ValueError, match=rf"rest position of {name} must"):
            write(suffix, replace(motion, skeleton=skeleton.with_offsets(offsets)), tmp_path)
    assert list(tmp_path.iterdir()) == []
    positions[2, 3, 1] = 1e30
    write(suffix, replace(motion, positions=positions), tmp_path)
    with pytest.raises(ValueError, match="rest position of"):
        formats.write_glb(motion, tmp_path / "b.glb", scale=1e39)


HOSTILE_NAMES = [*strategies.HOSTILE_NAMES, "=HYPERLINK(1)", 'a,"b"\n', "-1+2", "@x"]


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_hostile_names_are_escaped_in_all_formats(motion, tmp_path, name):
    skeleton = replace(motion.skeleton, names=(name, name, *motion.skeleton.names[2:]))
    renamed = replace(motion[:5], skeleton=skeleton, name=name)
    encoded = name.encode("utf-8", "replace").decode()
    formats.write_csv(renamed, tmp_path / "m.csv")
    text = (tmp_path / "m.csv").read_bytes().decode("utf-8")
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert [len(row) for row in rows] == [2 + 3 * 18] * 6
    formula = "'" if encoded[:1] in ("=", "-", "@") else ""
    assert rows[0][2] == f"{formula}{encoded}~0.x"
    formats.write_npz(renamed, tmp_path / "m.npz")
    # NumPy drops null characters at the end of strings; without a name, that of the file is read.
    assert mg.read(tmp_path / "m.npz")[0].name == (encoded.rstrip("\0") or "m")
    formats.write_glb(renamed, tmp_path / "m.glb")
    document = read_container(tmp_path / "m.glb").document
    assert document["nodes"][0]["name"] == encoded
    assert document["animations"][0]["name"] == (encoded or "motion")


@pytest.mark.parametrize("ending", ["glb", "npz", "csv"])
def test_export_command_states_unit_and_axes(motion, tmp_path, capsys, ending):
    source, target = str(tmp_path / "a.bvh"), tmp_path / f"x.{ending}"
    mg.write_bvh(motion, source)
    assert main(["export", source, "-o", str(target)]) == 0
    output = capsys.readouterr()
    assert output.out.strip() == str(target)
    assert ("y up" if ending == "glb" else "unit and axes of") in output.err
    assert main(["export", source, "-o", str(target), "--rate", "15", "--force", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mograft.export/1"
    assert document["rate"] == pytest.approx(15, rel=0.02)
    assert document.get("metres_in_a_unit") == (0.01 if ending == "glb" else None)
