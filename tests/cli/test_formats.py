"""Commands on files of several clips, on formats other than BVH, and grafts in glTF files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from mograft.constraints import Avoid, Capsule
from mograft.dancer import dance
from mograft.io.gltf.container import read_accessor, read_container
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


def test_info_lists_clips(succeed, pack):
    out = succeed("info", pack)[0]
    assert "glTF, 3 clips, 18 joints" in out
    assert "#Rig|walk_b: 120 frames at 30 fps, 3.97 s" in out
    files = json.loads(succeed("info", "--json", f"{pack}#walk*")[0])["files"]
    assert [own["clip"] for own in files] == ["Rig|walk_a", "Rig|walk_b"]
    out = succeed("info", f"{pack}#jump")[0]
    assert out.startswith(f"{pack}#Rig|jump\n  18 joints")
    assert "note: nodes that are not joints: bones" in out


def test_graft_base_is_found_by_its_address_and_any_unique_pattern(succeed, pack, tmp_path):
    bases = (f"{pack}#jump", "Rig|jump", "#Rig|jump", "jump", "*jump")
    for number, base in enumerate(bases):
        succeed("graft", pack, "--base", base, "--seed", 3, "-o", tmp_path / f"{number}.bvh")
    assert len({path.read_bytes() for path in tmp_path.glob("*.bvh")}) == 1
    # The names of files have no characters that some systems refuse.
    succeed("graft", pack, "--base", bases[0], "-o", tmp_path / "out")
    assert (tmp_path / "out" / "jump_graft0.bvh").exists()


def test_graft_of_several_clips_as_base_names_them(fail, pack, tmp_path):
    err = fail(3, "graft", pack, "--base", f"{pack}#walk*", "-o", tmp_path / "x")
    assert "expected the name of one clip" in err
    assert "got 2 clips: Rig|walk_a, Rig|walk_b" in err


@pytest.fixture(scope="module")
def figure(tmp_path_factory):
    """A GLB file of the clips a and b."""
    path = tmp_path_factory.mktemp("figure") / "dance.glb"
    motion = dance(seed=1, strides=1).motion
    clips = [replace(motion[:300], name="a"), replace(motion[300:600], name="b")]
    formats.write_glb(clips, path)
    return path


def test_graft_glb_count_two_writes_both_to_one_file(fail, succeed, figure, tmp_path):
    out = tmp_path / "out.glb"
    printed, err = succeed("graft", figure, "--base", f"{figure}#b", "-n", 2, "-o", out)
    assert printed == f"{out}\n"
    assert "b_graft1: 300 frames of b" in err
    assert mg.read(out).names == ("a", "b", "b_graft0", "b_graft1")
    (old,), (base, new) = (Scene.of([f"{out}#{name}"]).figures for name in ("a", "b_graft0"))
    assert (base.name, new.rows[0].group, old.rows[0].group) == ("b", "upper", "segments")
    err = fail(3, "graft", "--from", out, "-o", tmp_path / "two.glb")
    assert "out.glb#b_graft0, got no name" in err
    assert "out.glb exists; use --force to overwrite" in fail(1, "graft", figure, "-o", out)


def test_graft_into_adds_to_the_file_itself(fail, succeed, figure, tmp_path):
    hero = tmp_path / "hero.glb"
    hero.write_bytes(figure.read_bytes())
    words = ["graft", "hero.glb", "--base", "hero.glb#b", "--into", "hero.glb"]
    assert succeed(*words, "-n", 2)[0] == "hero.glb\n"
    before = mg.read("hero.glb")["b_graft0"].rotations
    err = succeed("graft", "--from", "hero.glb#b_graft0", "-o", "hero.glb", "--ban", 3)[1]
    assert "2 grafts of mograft excluded as donors" in err
    assert (mg.read("hero.glb")["b_graft0"].rotations != before).any()
    succeed("graft", "--from", "hero.glb#b_graft1", "--into", "hero.glb", "--as", "new")
    clips = mg.read("hero.glb")
    assert clips.names == ("a", "b", "b_graft0", "b_graft1", "new")
    assert (clips["new"].rotations == clips["b_graft1"].rotations).all()
    words = ["graft", "--from", "hero.glb#new", "--into", "hero.glb", "--as", "a"]
    assert "has an animation a that mograft did not write" in fail(1, *words)
    succeed(*words, "--force")
    assert "a" in mg.read("hero.glb").grafts


def vertices(path):
    container = read_container(Path(path))
    return [
        bytes(read_accessor(container, own["attributes"]["POSITION"], "", 3))
        for mesh in container.items("meshes")
        for own in mesh["primitives"]
    ]


def test_export_keeps_the_meshes_of_the_first_file_that_has_some(fail, succeed, figure):
    motion = mg.read(figure)["a"]
    scaled = replace(motion.skeleton, offsets=100 * motion.skeleton.offsets, end_sites=())
    other = replace(motion[:90], skeleton=scaled, positions=100 * motion[:90].positions)
    mg.write_bvh(replace(other, channel_values=None), "jump.bvh")
    err = succeed("export", "jump.bvh", figure, "-o", "both.glb")[1]
    assert f"meshes and skin of {figure}" in err
    clips = mg.read("both.glb")
    assert clips.names == ("a", "b", "jump")
    places = motion[:90].world_positions()
    height = np.ptp(places[..., 1])
    np.testing.assert_allclose(clips["jump"].world_positions(), places, atol=1e-5 * height)
    succeed("export", figure, "-o", "copy.glb")
    assert Path("copy.glb").read_bytes() == figure.read_bytes()
    succeed("export", f"{figure}#b", "--frames", "10-40", "-o", "part.glb")
    assert (mg.read("part.glb").names, mg.read("part.glb")[0].n_frames) == (("b",), 31)
    for path in ("both.glb", "part.glb"):
        assert vertices(path) == vertices(figure)
    err = succeed("export", figure, "--scale", "m", "-o", "bones.glb")[1]
    assert f"warning: bones.glb does not have the meshes of {figure}" in err
    names = ["Tail" if name == "Head" else name for name in motion.skeleton.names]
    formats.write_glb(replace(motion, skeleton=replace(motion.skeleton, names=names)), "goat.glb")
    err = fail(1, "export", figure, "goat.glb", "-o", "no.glb")
    assert "a lacks Head and also has Tail" in err
    assert "export each file by itself, or graft them together with --match anatomy" in err


def test_graft_folder_leaves_out_clips_in_one_line(succeed, fail, folder, tmp_path):
    for name in "ab":
        (tmp_path / f"{name}.bvh").write_bytes((folder / f"{name}.bvh").read_bytes())
    pose = mg.read_bvh(folder / "a.bvh")[:1]
    for number in range(5):
        mg.write_bvh(pose, tmp_path / f"0pose{number}.bvh")
    err = succeed("graft", tmp_path, "-o", "out")[1]
    assert err.count("excluded: ") == 4
    assert "excluded: 2 other clips; -v states the reasons" in err
    assert (tmp_path / "out" / "a_graft0.bvh").exists()
    assert succeed("graft", tmp_path, "-o", "out", "-v", "--force")[1].count("excluded: ") == 5
    succeed("graft", "--from", "out/a_graft0.json", "-o", "new.bvh", "--ban", 2)
    err = fail(1, "graft", tmp_path / "a.bvh", tmp_path / "0pose1.bvh", "-o", "other")
    assert "must have at least 2 frames, got 1" in err


def test_export_cycle_writes_what_cut_cycle_returns(succeed):
    mg.write_bvh(dance(strides=4).motion[550:700], "walk.bvh")
    walk = mg.read_bvh("walk.bvh")
    for words, first, whole, seconds in (
        (["--cycle"], 0, walk, None),
        (["--frames", "5-140", "--cycle", "2"], 5, walk[5:141], 2.0),
    ):
        cycle, (start, stop) = mg.cut_cycle(whole, seconds)
        mg.write_bvh(cycle, "python.bvh")
        out = succeed("export", "walk.bvh", *words, "-o", "program.bvh", "--json", "--force")[0]
        assert json.loads(out)["cycles"] == [[first + start, first + stop]]
        assert Path("program.bvh").read_bytes() == Path("python.bvh").read_bytes()
    assert json.loads(succeed("info", "program.bvh", "--json")[0])["files"][0]["loop"]


def test_export_turn_and_avoid_write_what_bend_returns(succeed):
    mg.write_bvh(dance(strides=8).motion[2040:2281], "walk.bvh")
    walk = mg.read_bvh("walk.bvh")
    x, _, z = walk.world_positions()[160, 0].tolist()
    pillar = Avoid(Capsule((x, 0.0, z), (x, 200.0, z), 10.0), frames=(120, 200))
    mg.write_bvh(mg.scenario.bend(walk, np.radians(-20.0), [pillar]), "python.bvh")
    place = f"capsule:{x!r},0,{z!r},{x!r},200,{z!r},10@120-200"
    words = "export", "walk.bvh", "--turn", "-20", "--avoid", place
    succeed(*words, "-o", "program.bvh")
    assert Path("program.bvh").read_bytes() == Path("python.bvh").read_bytes()


def test_export_of_grafts_keeps_their_provenance(succeed, figure, tmp_path):
    (tmp_path / "in").mkdir()
    succeed("graft", figure, "-n", 2, "-o", "in/new.glb")
    succeed("export", figure, "in/new.glb#*graft*", "-o", "all.glb")
    clips = mg.read("all.glb")
    assert (clips.names, [*clips.grafts]) == (("a", "b", *clips.grafts), ["a_graft0", "a_graft1"])
    succeed("graft", "--from", "all.glb#a_graft1", "-o", "again.bvh")


@pytest.mark.parametrize("suffix", ["bvh", "npz", "csv", "glb"])
def test_export_format_writes_each_motion_as_a_single_export_does(suffix, succeed, fail, clip):
    """Also clips of one file, clips of one name in two folders, and a folder."""
    motion = mg.read_bvh(clip)
    Path("in").mkdir()
    Path("in", "other").mkdir()
    for path in ("in/a.bvh", "in/other/a.bvh", "in/b.bvh"):
        formats.write_bvh(motion[: 30 + len(path)], path)
    formats.write_glb(
        [replace(motion[:40], name="x|run"), replace(motion[:50], name="w")], "two.glb"
    )
    sources = ["in/a.bvh", "in/b.bvh", "in/other/a.bvh", "two.glb#x|run", "two.glb#w"]
    names = ["a", "b", "a~2", "x_run", "w"]
    out = succeed("export", "in", "two.glb", "-o", "out", "--format", suffix)[0]
    assert out.split() == [str(Path("out", f"{name}.{suffix}")) for name in names]
    for source, name in zip(sources, names, strict=True):
        succeed("export", source, "-o", f"one.{suffix}", "--force")
        assert Path("out", f"{name}.{suffix}").read_bytes() == Path(f"one.{suffix}").read_bytes()
    err = fail(1, "export", "in", "-o", "out", "--format", suffix)
    assert f"a.{suffix} and 2 other files exist; use --force to overwrite" in err
