"""Grafts written as animations into a copy of the glTF file of their base."""

import json
from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.io.gltf.container import read_container
from mograft.motion import rotations
from mograft.scenario import walk


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two GLB files of one figure: first.glb with the clips a and b, second.glb with c."""
    folder = tmp_path_factory.mktemp("figures")
    motion = dance(seed=1, strides=1).motion
    clips = {"a": motion[:300], "b": motion[300:600], "c": motion[600:900]}
    named = {name: replace(own, channel_values=None, name=name) for name, own in clips.items()}
    formats.write_glb([named["a"], named["b"]], folder / "first.glb")
    formats.write_glb(named["c"], folder / "second.glb")
    return folder


@pytest.fixture(scope="module")
def library(folder):
    return mg.Library.build([folder / "first.glb", folder / "second.glb"])


def assert_equal_to_float32(actual, desired):
    assert actual.n_frames == desired.n_frames
    (turns, places), (own_turns, own_places) = desired.world_transforms(), actual.world_transforms()
    np.testing.assert_allclose(own_places, places, atol=1e-6 * np.abs(places).max())
    np.testing.assert_allclose(rotations.angle(own_turns, turns), 0.0, atol=2e-6)


def tracks(container, name):
    """Return the sampler of each track of an animation by node and property."""
    nodes = [node["name"] for node in container.items("nodes")]
    (item,) = (own for own in container.items("animations") if own["name"] == name)
    return {
        (nodes[own["target"]["node"]], own["target"]["path"]): item["samplers"][own["sampler"]]
        for own in item["channels"]
    }


def test_write_graft_glb_reads_back_to_float32_and_replays(library, tmp_path):
    graft = mg.graft(library, seed=3)
    mg.write_graft(graft, tmp_path / "new.glb")
    clips = mg.read(tmp_path / "new.glb")
    assert clips.names == ("a", "b", graft.motion.name)
    assert_equal_to_float32(clips[graft.motion.name], graft.motion)
    document = json.loads(clips.grafts[graft.motion.name])
    assert (document["schema"], document["name"]) == ("mograft.graft/2", graft.motion.name)
    assert [path.name for path in tmp_path.iterdir()] == ["new.glb"]
    again = mg.replay(tmp_path / "new.glb")
    np.testing.assert_array_equal(again.motion.rotations, graft.motion.rotations)
    mg.write_graft(again, tmp_path / "again.glb")
    assert (tmp_path / "again.glb").read_bytes() == (tmp_path / "new.glb").read_bytes()


def test_write_graft_glb_only_exchanged_joints_have_new_tracks(library, folder, tmp_path):
    graft = mg.graft(library, seed=3)
    mg.write_graft(graft, tmp_path / "new.glb")
    old, new = read_container(folder / "first.glb"), read_container(tmp_path / "new.glb")
    before, after = tracks(old, "a"), tracks(new, graft.motion.name)
    assert before.keys() == after.keys()
    changed = {name for name, path in before if before[name, path] != after[name, path]}
    exchanged = {library.skeleton.names[joint] for joint in library.joints("upper")}
    assert changed
    assert changed <= exchanged
    lengths = [len(own.buffer(0, "")) for own in (old, new)]
    assert bytes(new.buffer(0, ""))[: lengths[0]] == bytes(old.buffer(0, ""))


def test_write_graft_glb_several_grafts_share_one_file(library, tmp_path):
    grafts = mg.graft_many(library, "b", 3, seed=1)
    mg.write_graft(list(grafts), tmp_path / "new.glb", [{"take": i} for i in range(3)])
    clips = mg.read(tmp_path / "new.glb")
    names = [graft.motion.name for graft in grafts]
    assert clips.names == ("a", "b", *names)
    for graft in grafts:
        assert_equal_to_float32(clips[graft.motion.name], graft.motion)
    assert [json.loads(text)["take"] for text in clips.grafts.values()] == [0, 1, 2]
    again = mg.replay(f"{tmp_path / 'new.glb'}#{names[1]}")
    np.testing.assert_array_equal(again.motion.rotations, grafts[1].motion.rotations)
    for name in ("new.glb", "new.glb#none"):
        with pytest.raises(mg.ProvenanceError, match="expected a graft, as in"):
            mg.replay(tmp_path / name)


def test_write_graft_glb_copies_the_file_of_the_base(library, tmp_path):
    graft = mg.graft(library, "c", seed=1)
    mg.write_graft(graft, tmp_path / "new.glb")
    assert mg.read(tmp_path / "new.glb").names == ("c", graft.motion.name)
    with pytest.raises(ValueError, match="must be from one glTF file"):
        mg.write_graft([mg.graft(library, "a"), graft], tmp_path / "both.glb")
    assert not (tmp_path / "both.glb").exists()
    assert not (tmp_path / "both.json").exists()


@pytest.mark.parametrize("base", ["scenario", "mirror"])
def test_write_graft_glb_base_that_is_no_clip_has_new_tracks_of_all_joints(library, tmp_path, base):
    if base == "mirror":
        graft = mg.graft(library.with_mirror_images(), "a_mirrored", seed=1)
    else:
        graft = mg.graft(library, scenario=walk(library, 4.0, seed=2), seed=1)
    mg.write_graft(graft, tmp_path / "new.glb")
    assert_equal_to_float32(mg.read(tmp_path / "new.glb")[graft.motion.name], graft.motion)
    new = read_container(tmp_path / "new.glb")
    turned = {name for name, path in tracks(new, graft.motion.name) if path == "rotation"}
    assert turned == set(library.skeleton.names)


def test_write_graft_bvh_several_grafts_raise_value_error(tmp_path):
    library = mg.Library.build(dance(seed=1, strides=1).motion[:300])
    graft = mg.graft(library)
    for grafts in ([], [graft, graft]):
        with pytest.raises(ValueError, match="`graft` must be one graft"):
            mg.write_graft(grafts, tmp_path / "new.bvh")
    assert not list(tmp_path.iterdir())
