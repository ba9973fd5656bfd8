"""Commands on files that hold several clips, and on formats other than BVH."""

import json
from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from mograft.dancer import dance


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


def test_info_lists_clips(run, pack):
    code, out, _ = run("info", pack)
    assert code == 0
    assert "glTF, 3 clips, 18 joints" in out
    assert "#Rig|walk_b: 120 frames at 30 fps, 3.97 s" in out
    code, out, _ = run("info", "--json", f"{pack}#walk*")
    files = json.loads(out)["files"]
    assert [(own["format"], own["clip"]) for own in files] == [
        ("glTF", "Rig|walk_a"),
        ("glTF", "Rig|walk_b"),
    ]
    code, out, _ = run("info", f"{pack}#jump")
    assert out.startswith(f"{pack}#Rig|jump\n  18 joints")
    assert "note: nodes that are not joints: bones" in out


def test_graft_base_by_address_equals_base_by_name(run, pack, tmp_path):
    for name, base in (("a", f"{pack}#jump"), ("b", "Rig|jump")):
        options = ("--base", base, "--seed", "3", "-o", tmp_path / name)
        code, _, _ = run("graft", pack, *options)
        assert code == 0
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


def test_check_damaged_glb_gives_exit_code_3(run, pack, tmp_path):
    path = tmp_path / "bad.glb"
    path.write_bytes(pack.read_bytes()[:1000])
    for command in (("check", path), ("info", path), ("export", path, "-o", "x.bvh")):
        code, _, err = run(*command)
        assert code == 3
        assert "bad.glb: byte 8: expected" in err
