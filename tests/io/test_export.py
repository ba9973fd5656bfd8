"""The export command, and hostile names in all formats."""

import csv
import io
import json
from dataclasses import replace

import pytest

from mograft import read_bvh, write_bvh
from mograft.cli import main
from mograft.formats import read_npz, write_csv, write_glb, write_npz, write_usd
from tests.io.glb_file import Glb
from tests.strategies import HOSTILE_NAMES


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "=HYPERLINK(1)", 'a,"b"\n', "-1+2", "@x"])
def test_hostile_names_are_escaped_in_all_formats(motion, tmp_path, name):
    skeleton = replace(motion.skeleton, names=(name, name, *motion.skeleton.names[2:]))
    renamed = replace(motion[:5], skeleton=skeleton, name=name)
    encoded = name.encode("utf-8", "replace").decode()
    write_csv(renamed, tmp_path / "m.csv")
    text = (tmp_path / "m.csv").read_bytes().decode("utf-8")
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert [len(row) for row in rows] == [2 + 3 * 18] * 6
    formula = "'" if encoded[:1] in ("=", "-", "@") else ""
    assert rows[0][2] == f"{formula}{encoded}~0.x"
    write_npz(renamed, tmp_path / "m.npz")
    # NumPy drops null characters at the end of strings; without a name, that of the file is read.
    assert read_npz(tmp_path / "m.npz").name == (encoded.rstrip("\0") or "m")
    write_glb(renamed, tmp_path / "m.glb")
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
        ["a.bvh", "-o", "x.fbx"],
        ["a.bvh", "-o", "x.txt"],
        ["a.bvh", "b.bvh", "-o", "x.npz"],
        ["a.bvh", "-o", "x.npz", "--scale", "cm"],
        ["a.bvh", "-o", "x.glb", "--scale", "0"],
        ["a.bvh", "-o", "x.glb", "--scale", "feet"],
        ["a.bvh", "-o", "x.glb", "--rate", "-1"],
    ],
)
def test_export_command_wrong_usage_exits_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["export", *arguments])
    assert stop.value.code == 2
    assert capsys.readouterr().err


@pytest.mark.parametrize("write", [write_glb, write_usd])
def test_positions_beyond_single_precision_are_refused_by_joint_and_frame(motion, tmp_path, write):
    if write is write_usd:
        pytest.importorskip("pxr", reason="usd-core is not installed")
    positions = motion.positions.copy()
    positions[7, 0, 1] = 1e39
    far = replace(motion, positions=positions, name="far")
    message = f"position of {motion.skeleton.names[0]} in frame 7 of far must be within the range"
    with pytest.raises(ValueError, match=message):
        write(far, tmp_path / "far.usda", scale=1.0)
    assert not (tmp_path / "far.usda").exists()
