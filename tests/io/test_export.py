"""NPZ and CSV files, the export command, and names and numbers that formats cannot store."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from mograft import formats, read_bvh, write_bvh
from mograft.cli import main
from tests import strategies
from tests.io.gltf_scenes import Glb


@given(strategies.motions(max_frames=20))
def test_npz_round_trip_has_precision_of_float32(tmp_path_factory, motion):
    path = tmp_path_factory.mktemp("npz") / "m.npz"
    formats.write_npz(motion, path)
    again = formats.read_npz(path)
    strategies.assert_same_rotations(again.rotations, motion.rotations, atol=1e-6)
    np.testing.assert_allclose(again.positions, motion.positions, rtol=1e-6, atol=1e-30)
    assert again.frame_time == motion.frame_time
    assert again.skeleton.names == motion.skeleton.names
    np.testing.assert_array_equal(again.skeleton.offsets, motion.skeleton.offsets)
    with np.load(path, allow_pickle=False) as data:
        world = motion.world_positions().astype(np.float32)
        np.testing.assert_array_equal(data["world_positions"], world)


def test_npz_keeps_channels_and_end_sites_and_is_deterministic(motion, tmp_path):
    for name in ("a", "b"):
        formats.write_npz(motion, tmp_path / f"{name}.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = formats.read_npz(tmp_path / "a.npz")
    assert again.skeleton.channels == motion.skeleton.channels
    assert again.name == "dance"
    found, expected = (
        [(own.parent, own.before, own.name, own.offset.tolist()) for own in skeleton.end_sites]
        for skeleton in (again.skeleton, motion.skeleton)
    )
    assert found == expected


@pytest.mark.parametrize("content", [b"", b"PK\3\4broken", b"no archive"])
def test_read_npz_invalid_file_raises_value_error_naming_it(tmp_path, content):
    (tmp_path / "m.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"m\.npz"):
        formats.read_npz(tmp_path / "m.npz")
    with pytest.raises(FileNotFoundError):
        formats.read_npz(tmp_path / "none.npz")


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
    assert formats.read_npz(tmp_path / "m.npz").name == (encoded.rstrip("\0") or "m")
    formats.write_glb(renamed, tmp_path / "m.glb")
    document = Glb(tmp_path / "m.glb").document
    assert document["nodes"][0]["name"] == encoded
    assert document["animations"][0]["name"] == (encoded or "motion")


def test_export_command_writes_each_format_once(motion, tmp_path, capsys):
    write_bvh(motion, tmp_path / "a.bvh")
    source = str(tmp_path / "a.bvh")
    for ending in ("glb", "npz", "csv"):
        target = tmp_path / f"x.{ending}"
        assert main(["export", source, "-o", str(target)]) == 0
        output = capsys.readouterr()
        assert output.out.strip() == str(target)
        assert ("y up" if ending == "glb" else "unit and axes of") in output.err
        before = target.read_bytes()
        assert main(["export", source, "-o", str(target)]) == 1
        assert target.read_bytes() == before
    assert main(["export", source, source, "-o", str(tmp_path / "y.glb"), "--scale", "cm"]) == 0
    capsys.readouterr()
    options = ["-o", str(tmp_path / "z.glb"), "--scale", "0.02", "--rate", "15", "--json"]
    assert main(["export", source, *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mograft.export/1"
    assert document["metres_in_a_unit"] == 0.02
    assert document["rate"] == pytest.approx(15, rel=0.02)
    assert main(["export", source, "-o", str(tmp_path / "z.bvh"), "--rate", "15"]) == 0
    assert read_bvh(tmp_path / "z.bvh").n_frames == document["frames"][0]


@pytest.mark.parametrize(
    "arguments",
    [
        *("a.bvh -o x.fbx", "a.bvh -o x.txt", "a.bvh b.bvh -o x.npz", "a.bvh -o x.npz --scale cm"),
        *(f"a.bvh -o x.glb {rest}" for rest in ("--scale 0", "--scale feet", "--rate -1")),
    ],
)
def test_export_command_wrong_usage_exits_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["export", *arguments.split()])
    assert stop.value.code == 2
    assert capsys.readouterr().err
