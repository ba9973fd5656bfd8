"""Commands on files of several clips, on formats other than BVH, and grafts in glTF files."""

import json
from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.viewing.scene import Scene


@pytest.fixture(scope="module")
def pack(tmp_path_factory):
    """A GLB file of three clips."""
    motion = dance(seed=1, strides=1).motion
    clips = [
        replace(motion[120 * number : 120 * number + 120], name=name)
        for number, name in enumerate(("Rig|walk_a", "Rig|walk_b", "Rig|jump"))
    ]
    path = tmp_path_factory.mktemp("pack") / "pack.glb"
    formats.write_glb(clips, path)
    return path


def test_info_lists_clips(run, succeed, pack):
    out = succeed("info", pack)[0]
    assert "glTF, 3 clips, 18 joints" in out
    assert "#Rig|walk_b: 120 frames at 30 fps, 3.97 s" in out
    files = json.loads(succeed("info", "--json", f"{pack}#walk*")[0])["files"]
    assert [(own["format"], own["clip"]) for own in files] == [
        ("glTF", "Rig|walk_a"),
        ("glTF", "Rig|walk_b"),
    ]
    _, out, _ = run("info", f"{pack}#jump")
    assert out.startswith(f"{pack}#Rig|jump\n  18 joints")
    assert "note: nodes that are not joints: bones" in out


def test_graft_base_by_address_equals_base_by_name(succeed, pack, tmp_path):
    for name, base in (("a", f"{pack}#jump"), ("b", "Rig|jump")):
        options = ("--base", base, "--seed", "3", "-o", tmp_path / name)
        succeed("graft", pack, *options)
        # The names of files have no characters that some systems refuse.
    (first,) = (tmp_path / "a").glob("*.bvh")
    (second,) = (tmp_path / "b").glob("*.bvh")
    assert first.name == "jump_graft0.bvh"
    assert first.read_bytes() == second.read_bytes()


def test_graft_of_several_clips_as_base_names_them(run, pack, tmp_path):
    code, _, err = run("graft", pack, "--base", f"{pack}#walk*", "-o", tmp_path / "x")
    assert code == 3
    assert "expected the name of one clip" in err
    assert "got 2 clips: Rig|walk_a, Rig|walk_b" in err


def test_commands_accept_addresses(run, pack):
    one = f"{pack}#jump"
    for words in (
        ("check", one),
        ("groups", one),
        ("view", one, "-o", "a.html"),
        ("plot", "strip", one, "-o", "a.svg"),
        ("plot", "timeline", pack, "-o", "b.svg"),
        ("export", one, "-o", "a.bvh"),
        ("export", f"{pack}#walk*", "-o", "b.glb"),
        ("candidates", pack, "--clip", "Rig|jump", "--segment", "1"),
        ("index", pack, "-o", "l"),
        ("lib", "verify", "l"),
    ):
        code, _, err = run(*words)
        assert code == 0, (words, err)
    np.testing.assert_allclose(
        mg.read_bvh("a.bvh").world_positions(),
        mg.read(pack)["Rig|jump"].world_positions(),
        atol=1e-4,
    )
    assert mg.read("b.glb").names == ("Rig|walk_a", "Rig|walk_b")
    assert mg.Library.open("l").names == ("Rig|jump", "Rig|walk_a", "Rig|walk_b")


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


def test_graft_glb_count_two_writes_both_to_one_file(run, succeed, figure, tmp_path):
    out = tmp_path / "out.glb"
    code, printed, err = run("graft", figure, "--base", f"{figure}#b", "-n", 2, "-o", out)
    assert (code, printed) == (0, f"{out}\n")
    assert "b_graft1: 300 frames of b" in err
    assert mg.read(out).names == ("a", "b", "b_graft0", "b_graft1")
    assert [*mg.read(out).grafts] == ["b_graft0", "b_graft1"]
    succeed("graft", "--from", f"{out}#b_graft1", "-o", tmp_path / "one.glb")
    clips, again = mg.read(out), mg.read(tmp_path / "one.glb")
    assert again.names == ("a", "b", "b_graft1")
    assert (again["b_graft1"].rotations == clips["b_graft1"].rotations).all()
    code, _, err = run("graft", "--from", out, "-o", tmp_path / "two.glb")
    assert code == 3
    assert "out.glb#b_graft0, got none" in err
    code, _, err = run("graft", figure, "-o", out)
    assert code == 1
    assert "out.glb exists; use --force to overwrite" in err


def test_graft_glb_stored_library_and_report(run, succeed, figure, tmp_path):
    assert run("index", figure, "-o", tmp_path / "lib")[0] == 0
    out = tmp_path / "out.glb"
    printed = succeed("graft", tmp_path / "lib", "-o", out, "-n", 2, "--report", "--json")[0]
    document = json.loads(printed)
    assert [own["file"] for own in document["grafts"]] == [str(out)] * 2
    assert out.with_suffix(".html").exists()
    edited = tmp_path / "edited.glb"
    words = ["--from", f"{out}#a_graft0", "--keep", "0-100"]
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
