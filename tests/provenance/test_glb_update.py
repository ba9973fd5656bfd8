"""Grafts that are animations of a GLB file: added, replaced, replayed, and no donors."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.io.gltf.container import read_container
from mograft.io.gltf.document import read_gltf_file
from mograft.io.gltf.writer import fit_motion
from mograft.library.discover import SourceFile, exclude_grafts, find_clips
from mograft.motion import rotations
from mograft.scenario import walk

KEPT = ("nodes", "meshes", "materials", "skins", "scenes", "asset")


@pytest.fixture(scope="module")
def hero(tmp_path_factory):
    """A GLB file with the clips a and b; beside it other.glb with the clip c of the same figure."""
    folder = tmp_path_factory.mktemp("hero")
    motion = replace(dance(seed=1, strides=1).motion, channel_values=None)
    clips = [replace(motion[i * 200 : i * 200 + 200], name="abc"[i]) for i in range(3)]
    formats.write_glb(clips[:2], folder / "hero.glb")
    formats.write_glb(clips[2], folder / "other.glb")
    return folder / "hero.glb"


@pytest.fixture(scope="module")
def library(hero):
    """The clips of both files."""
    return mg.Library.build([hero, hero.with_name("other.glb")])


@pytest.fixture(scope="module")
def grafts(hero):
    """Four grafts of the file; their library names it."""
    return list(mg.graft_many(mg.Library.build(hero), "a", 4, seed=1))


@pytest.fixture
def copy(hero):
    """Restore the file after the test."""
    content = hero.read_bytes()
    yield hero
    hero.write_bytes(content)


def named(graft, name):
    return replace(graft, motion=replace(graft.motion, name=name))


def assert_equal_to_float32(actual, desired):
    assert actual.n_frames == desired.n_frames
    (turns, places), (own_turns, own_places) = desired.world_transforms(), actual.world_transforms()
    np.testing.assert_allclose(own_places, places, atol=1e-6 * np.abs(places).max())
    np.testing.assert_allclose(rotations.angle(own_turns, turns), 0.0, atol=2e-6)


def assert_replays(address, graft):
    again = mg.replay(address)
    np.testing.assert_array_equal(again.motion.rotations, graft.motion.rotations)
    return again


@settings(max_examples=12)
@given(steps=st.lists(st.tuples(st.sampled_from("xyz"), st.integers(0, 3)), min_size=1, max_size=5))
def test_write_graft_update_has_the_bytes_of_the_last_graft_of_each_name(hero, grafts, steps):
    target = hero.with_name("updated.glb")
    target.write_bytes(hero.read_bytes())
    for name, index in steps:
        mg.write_graft(named(grafts[index], name), target, update=True)
    last = dict(steps)
    mg.write_graft([named(grafts[i], name) for name, i in last.items()], hero.with_name("all.glb"))
    assert target.read_bytes() == hero.with_name("all.glb").read_bytes()
    old, new = read_container(hero), read_container(target)
    for name in KEPT:
        assert new.document[name] == old.document[name]
    for name in ("animations", "accessors", "bufferViews"):
        assert new.items(name)[: len(old.items(name))] == old.items(name)
    data = bytes(old.buffer(0, ""))
    assert bytes(new.buffer(0, ""))[: len(data)] == data
    clips = mg.read(target)
    assert clips.names == ("a", "b", *last)
    assert tuple(clips.grafts) == tuple(last)
    for name, index in last.items():
        assert_equal_to_float32(clips[name], grafts[index].motion)


def test_write_graft_glb_holds_the_provenance_and_replays_to_the_same_bytes(grafts, tmp_path):
    mg.write_graft(grafts[0], tmp_path / "new.glb")
    again = assert_replays(tmp_path / "new.glb", grafts[0])
    assert [path.name for path in tmp_path.iterdir()] == ["new.glb"]
    mg.write_graft(again, tmp_path / "again.glb")
    assert (tmp_path / "again.glb").read_bytes() == (tmp_path / "new.glb").read_bytes()
    mg.write_graft(grafts, tmp_path / "new.glb", [{"take": i} for i in range(4)])
    documents = [json.loads(text) for text in mg.read(tmp_path / "new.glb").grafts.values()]
    assert [(own["schema"], own["take"]) for own in documents] == [
        ("mograft.graft/2", i) for i in range(4)
    ]
    for name in ("new.glb", "new.glb#none"):
        with pytest.raises(mg.ProvenanceError, match="expected a graft, as in"):
            mg.replay(tmp_path / name)


def tracks(path, name):
    """Return the sampler of each track of an animation by node and property."""
    container = read_container(path)
    nodes = [node["name"] for node in container.items("nodes")]
    (item,) = (own for own in container.items("animations") if own["name"] == name)
    return {
        (nodes[own["target"]["node"]], own["target"]["path"]): item["samplers"][own["sampler"]]
        for own in item["channels"]
    }


@pytest.mark.parametrize("base", ["clip", "scenario", "mirror"])
def test_write_graft_glb_has_new_tracks_where_no_clip_moves_as_it(library, hero, tmp_path, base):
    """Of the exchanged joints if the base is a clip of the file, else of all joints."""
    if base == "mirror":
        graft = mg.graft(library.with_mirror_images(), "a_mirrored", seed=1)
    else:
        scenario = walk(library, 4.0, seed=2) if base == "scenario" else None
        graft = mg.graft(library, scenario=scenario, seed=1)
    mg.write_graft(graft, tmp_path / "new.glb")
    assert_equal_to_float32(mg.read(tmp_path / "new.glb")[graft.motion.name], graft.motion)
    before, after = tracks(hero, "a"), tracks(tmp_path / "new.glb", graft.motion.name)
    new = {name for name, path in after if before.get((name, path)) != after[name, path]}
    exchanged = {library.skeleton.names[joint] for joint in library.joints("upper")}
    if base == "clip":
        assert before.keys() == after.keys()
        assert set() < new <= exchanged
    else:
        turned = {name for name, path in after if path == "rotation"}
        assert new >= turned == set(library.skeleton.names)


def test_write_graft_glb_copies_the_file_of_the_base(library, tmp_path):
    graft = mg.graft(library, "c", seed=1)
    mg.write_graft(graft, tmp_path / "new.glb")
    assert mg.read(tmp_path / "new.glb").names == ("c", graft.motion.name)
    with pytest.raises(ValueError, match="must be from one glTF file"):
        mg.write_graft([mg.graft(library, "a"), graft], tmp_path / "both.glb")
    assert [path.name for path in tmp_path.iterdir()] == ["new.glb"]


def test_write_graft_update_keeps_the_identity_of_the_file(copy, grafts):
    before = SourceFile.from_path(str(copy)).sha256
    mg.write_graft(grafts[0], copy, update=True)
    assert SourceFile.from_path(str(copy)).sha256 == before
    name = grafts[0].motion.name
    assert_replays(f"{copy}#{name}", grafts[0])
    library = mg.Library.build(exclude(copy))
    assert library.names == ("a", "b")
    edited = mg.edit(mg.replay(f"{copy}#{name}", library), mg.constraints.Ban(3))
    mg.write_graft(edited, copy, update=True)
    assert_equal_to_float32(mg.read(copy)[name], edited.motion)
    # Another program has changed the file: it is another file.
    copy.write_bytes(copy.read_bytes().replace(b'"name":"b"', b'"name":"B"'))
    assert SourceFile.from_path(str(copy)).sha256 != before
    with pytest.raises(mg.ProvenanceError, match="has changed: SHA-256"):
        mg.replay(f"{copy}#{name}")


def exclude(*sources):
    with pytest.warns(UserWarning, match="excluded as donors"):
        return [str(clip.source) for clip in exclude_grafts(find_clips(sources))]


def test_write_graft_update_of_a_captured_animation_needs_force(copy, grafts):
    content = copy.read_bytes()
    with pytest.raises(FileExistsError, match="has an animation b that mograft did not write"):
        mg.write_graft(named(grafts[0], "b"), copy, update=True)
    assert copy.read_bytes() == content
    before = SourceFile.from_path(str(copy)).sha256
    mg.write_graft(named(grafts[0], "b"), copy, update=True, force=True)
    clips = mg.read(copy)
    assert (clips.names, tuple(clips.grafts)) == (("a", "b"), ("b",))
    assert_equal_to_float32(clips["b"], grafts[0].motion)
    assert SourceFile.from_path(str(copy)).sha256 != before


def test_write_graft_update_of_another_format_or_skeleton_raises(copy, grafts, tmp_path):
    with pytest.raises(ValueError, match=r"`path` must be a \.glb file with `update`"):
        mg.write_graft(grafts[0], tmp_path / "a.bvh", update=True)
    clip = mg.read(copy)[0]
    names = ["Tail" if name == "Head" else name for name in clip.skeleton.names]
    offsets = clip.skeleton.offsets.copy()
    offsets[clip.skeleton.index("LeftLeg")] = np.roll(offsets[clip.skeleton.index("LeftLeg")], 1)
    for change, message in (
        ({"names": names}, r"unlike .*other\.glb; export each file by"),
        ({"offsets": offsets}, "has another rest pose than"),
    ):
        other = replace(clip, skeleton=replace(clip.skeleton, **change))
        formats.write_glb(other, tmp_path / "other.glb")
        with pytest.raises(mg.SkeletonMismatchError, match=message):
            mg.write_graft(grafts[0], tmp_path / "other.glb", update=True)


def test_write_graft_paths_of_copied_grafts_are_relative_to_the_copy(copy, grafts, tmp_path):
    mg.write_graft(grafts[0], copy, update=True)
    library = mg.Library.build(exclude(copy))
    target = tmp_path / "folder" / "new.glb"
    target.parent.mkdir()
    mg.write_graft(named(mg.graft(library, "b", seed=5), "new"), target)
    assert tuple(mg.read(target).grafts) == (grafts[0].motion.name, "new")
    for name, text in mg.read(target).grafts.items():
        for clip in json.loads(text)["clips"]:
            assert (target.parent / clip["file"]).resolve() == copy.resolve()
        mg.replay(f"{target}#{name}")


def test_write_graft_copy_replays_without_its_source(hero, tmp_path):
    source = tmp_path / "source.glb"
    source.write_bytes(hero.read_bytes())
    graft = mg.graft(mg.Library.build(source), "a", seed=2)
    mg.write_graft(graft, tmp_path / "moved.glb")
    source.unlink()
    assert_replays(tmp_path / "moved.glb", graft)


def test_grafts_in_files_are_no_donors_unless_named(copy, grafts):
    new = copy.with_name("new.glb")
    mg.write_graft(grafts[:2], new)
    names = [own.motion.name for own in grafts[:2]]
    assert exclude(new) == [f"{new}#a", f"{new}#b"]
    assert exclude(f"{new}#a*") == [f"{new}#a"]
    assert exclude(copy, new) == [f"{copy}#a", f"{copy}#b"]  # a copy adds no clips
    one = find_clips(f"{new}#{names[0]}")
    assert [str(clip.source) for clip in exclude_grafts(one)] == [f"{new}#{names[0]}"]
    assert mg.Library.build(new, include_grafts=True).names == ("a", "b", *names)
    folder = copy.parent / "folder"
    folder.mkdir()
    (folder / "new.glb").write_bytes(new.read_bytes())
    with pytest.warns(UserWarning, match="2 grafts of mograft excluded"):
        library = mg.Library.index(folder, copy.parent / "lib")
    assert library.names == ("a", "b")


def test_only_captured_clip_keeps_its_address(hero, tmp_path):
    path = tmp_path / "one.glb"
    path.write_bytes(hero.with_name("other.glb").read_bytes())
    graft = mg.graft(mg.Library.build(path), seed=2)
    mg.write_graft(graft, path, update=True)
    clips = mg.read(path)
    assert [clip.clip for clip in clips] == [None, graft.motion.name]
    assert [clips.address(i) for i in (0, 1)] == [str(path), f"{path}#{graft.motion.name}"]
    assert_replays(f"{path}#{graft.motion.name}", graft)


@pytest.mark.parametrize("suffix", [".glb", ".npz"])
def test_write_graft_of_bvh_writes_all_motions_to_one_file(tmp_path, suffix):
    mg.write_bvh(dance(seed=1, strides=1).motion[:300], tmp_path / "a.bvh")
    library = mg.Library.build(tmp_path / "a.bvh")
    grafts = list(mg.graft_many(library, count=3, seed=4))
    target = tmp_path / f"many{suffix}"
    mg.write_graft(grafts, target)
    names = tuple(own.motion.name for own in grafts)
    assert not target.with_suffix(".json").exists()
    clips = mg.read(target)
    assert clips.names == names
    for clip, graft in zip(clips, grafts, strict=True):
        motion = graft.motion
        expected = fit_motion(read_gltf_file(target), motion) if suffix == ".glb" else motion
        assert_equal_to_float32(clip, expected)
        assert_replays(f"{target}#{clip.name}", graft)
    first = mg.read(f"{target}#{names[0]}")
    assert (first.names, first[0].clip) == (names[:1], names[0])
    assert first.address(0) == f"{target}#{names[0]}"


TURNS = [rotations.IDENTITY, *map(np.array, ([np.sqrt(0.5), 0, 0, np.sqrt(0.5)], [0, 0, 1.0, 0]))]


@given(turn=st.sampled_from(TURNS), scale=st.floats(0.01, 100.0))
def test_fit_motion_undoes_a_change_of_unit_and_axes(hero, turn, scale):
    motion = mg.read(hero)["a"]
    skeleton = motion.skeleton
    offsets = scale * rotations.rotate(turn, skeleton.offsets)
    quats = rotations.multiply(rotations.multiply(turn, motion.rotations), rotations.inverse(turn))
    moved = replace(
        motion,
        skeleton=replace(skeleton, offsets=offsets),
        rotations=quats,
        positions=scale * rotations.rotate(turn, motion.positions),
    )
    fitted = fit_motion(read_gltf_file(hero), moved)
    places = motion.world_positions()
    height = np.ptp(places[..., 1])
    np.testing.assert_allclose(fitted.world_positions(), places, atol=1e-5 * height)


def test_graft_as_a_source_is_another_clip_after_its_replacement(copy, grafts):
    name = grafts[0].motion.name
    mg.write_graft(grafts[0], copy, update=True)
    second = named(mg.graft(mg.Library.build(f"{copy}#{name}"), seed=3), "second")
    mg.write_graft(second, copy, update=True)
    assert_equal_to_float32(mg.read(copy)["second"], second.motion)
    mg.write_graft(named(grafts[2], name), copy, update=True)
    mg.write_graft(second, copy, update=True)
    assert_equal_to_float32(mg.read(copy)["second"], second.motion)
    with pytest.raises(mg.ProvenanceError, match="has changed: SHA-256"):
        mg.replay(f"{copy}#second")
