"""`mograft graft -o FILE.glb`: animations in a copy of the glTF file of the base."""

import json
from dataclasses import replace

import pytest

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.viewing.scene import Scene


@pytest.fixture(scope="module")
def figures(tmp_path_factory):
    """A folder of dance.glb with the clips a and b, and walk.bvh."""
    folder = tmp_path_factory.mktemp("figures")
    motion = dance(seed=1, strides=1).motion
    clips = [replace(motion[i * 300 : i * 300 + 300], name="ab"[i]) for i in range(2)]
    formats.write_glb(clips, folder / "dance.glb")
    mg.write_bvh(clips[0], folder / "walk.bvh")
    return folder


@pytest.fixture(scope="module")
def figure(figures):
    return figures / "dance.glb"


def test_graft_glb_count_two_writes_both_to_one_file(run, figure, tmp_path):
    out = tmp_path / "out.glb"
    code, printed, err = run("graft", figure, "--base", f"{figure}#b", "-n", 2, "-o", out)
    assert (code, printed) == (0, f"{out}\n")
    assert "b_graft1: 300 frames of b" in err
    assert mg.read(out).names == ("a", "b", "b_graft0", "b_graft1")
    names = [own["name"] for own in json.loads(out.with_suffix(".json").read_text())["grafts"]]
    assert names == ["b_graft0", "b_graft1"]
    code, printed, _ = run(
        "graft", "--from", f"{out.with_suffix('.json')}#b_graft1", "-o", tmp_path / "one.glb"
    )
    assert code == 0
    clips, again = mg.read(out), mg.read(tmp_path / "one.glb")
    assert again.names == ("a", "b", "b_graft1")
    assert (again["b_graft1"].rotations == clips["b_graft1"].rotations).all()
    code, _, err = run("graft", "--from", out.with_suffix(".json"), "-o", tmp_path / "two.glb")
    assert code == 3
    assert "out.json#b_graft0, one of b_graft0, b_graft1; got none" in err
    code, _, err = run("graft", figure, "-o", out)
    assert code == 1
    assert "out.glb and 1 other file exist; use --force to overwrite" in err


def test_graft_glb_stored_library_and_report(run, figure, tmp_path):
    assert run("index", figure, "-o", tmp_path / "lib")[0] == 0
    out = tmp_path / "out.glb"
    code, printed, _ = run("graft", tmp_path / "lib", "-o", out, "-n", 2, "--report", "--json")
    assert code == 0
    document = json.loads(printed)
    assert [own["file"] for own in document["grafts"]] == [str(out)] * 2
    assert out.with_suffix(".html").exists()
    edited = tmp_path / "edited.glb"
    words = ["--from", f"{out.with_suffix('.json')}#a_graft0", "--keep", "0-100"]
    assert run("graft", *words, "-o", edited)[0] == 0
    assert mg.read(edited).names == ("a", "b", "a_graft0")
    bvh = tmp_path / "other.bvh"
    assert run("graft", *words, "-o", bvh)[0] == 0
    assert mg.read_bvh(bvh).n_frames == 300


def test_graft_glb_in_folder_is_excluded_as_donor(run, figure, tmp_path):
    out = tmp_path / "out.glb"
    assert run("graft", figure, "-o", out, "-n", 2)[0] == 0
    (tmp_path / "dance.glb").write_bytes(figure.read_bytes())
    assert run("index", tmp_path, "-o", tmp_path / "lib")[0] == 0
    assert mg.Library.open(tmp_path / "lib").names == ("a", "b")


def test_scene_of_glb_shows_donors_of_grafts_only(run, figure, tmp_path):
    out = tmp_path / "out.glb"
    assert run("graft", figure, "-o", out)[0] == 0
    (old,) = Scene.of([f"{out}#a"]).figures
    assert [row.group for row in old.rows] == ["segments"]
    base, new = Scene.of([f"{out}#a_graft0"]).figures
    assert (base.name, new.name) == ("a", "a_graft0")
    assert [row.group for row in new.rows] == ["upper"]
    assert any(part.is_exchanged for part in new.rows[0].parts)


def test_graft_glb_with_digits_is_usage_error(usage_error, figure):
    message = usage_error("graft", figure, "-o", "out.glb", "--digits", 8)
    assert "--digits requires .bvh; got out.glb" in message
