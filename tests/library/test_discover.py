"""The search for clips, paths of source files, and files that hold several clips."""

import json
import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.cli.files import expand_folders
from mograft.library.discover import exclude_grafts, find_clips, relative_path
from tests.library.checks import DANCE, PACK_NAMES

FOLDER_PATHS = st.lists(st.sampled_from(["a", "b", "..", ".", "a b"]), max_size=5).map("/".join)


@given(FOLDER_PATHS, FOLDER_PATHS, st.booleans())
def test_relative_path_matches_os_path_relpath(folders, folder, is_absolute):
    path = f"{folders}/take.bvh".lstrip("/")
    path = os.path.abspath(path) if is_absolute else path
    expected = Path(os.path.relpath(path, folder or "."))
    assert relative_path(path, Path(folder)) == expected


VISIBLE = st.sampled_from(["walk.bvh", "RUN.BVH", "a b.Bvh"])
INVISIBLE = st.sampled_from(["._walk.bvh", ".walk.0a1b2c3d.bvh", "walk.bvh.part", "walk.txt"])
FOLDERS = st.lists(st.sampled_from(["x", "y.bvh"]), max_size=2)
HIDDEN_FOLDERS = st.sampled_from([[".a.part"], ["x", ".git"], [".b", "y.bvh"]])


def create(folder, parts):
    path = folder.joinpath(*parts)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return str(path)


@given(
    st.sets(st.tuples(FOLDERS.map(tuple), VISIBLE), min_size=1),
    st.sets(st.tuples(FOLDERS.map(tuple), INVISIBLE)),
    st.sets(st.tuples(HIDDEN_FOLDERS.map(tuple), VISIBLE)),
)
def test_find_clips_folder_takes_only_visible_regular_files(
    tmp_path_factory, visible, invisible, hidden
):
    folder = tmp_path_factory.mktemp("clips")
    expected = sorted(create(folder, (*folders, name)) for folders, name in visible)
    for folders, name in invisible | hidden:
        create(folder, (*folders, name))
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "pipe.bvh")
    (folder / "gone.bvh").symlink_to(folder / "no such file")
    assert sorted(found.source for found in find_clips(folder)) == expected
    assert expand_folders([str(folder)]) == [found.source for found in find_clips(folder)]
    at_top = [path for path in expected if os.path.dirname(path) == str(folder)]
    if at_top:
        assert sorted(found.source for found in find_clips(f"{folder}/*.[bB][vV][hH]")) == at_top


def test_find_clips_folder_of_hidden_files_holds_no_clip(tmp_path):
    create(tmp_path, ["._walk.bvh"])
    with pytest.raises(FileNotFoundError, match="no motion file"):
        find_clips(tmp_path)
    (found,) = find_clips(tmp_path / "._walk.bvh")
    assert found.source == str(tmp_path / "._walk.bvh")


GRAFT = json.dumps({"schema": "mograft.graft/2"})
SIDECARS = {
    GRAFT: True,
    json.dumps({"mograft": "1.0", "schema": "mograft.graft/2", "name": "walk"}): True,
    json.dumps({"schema": "mograft.graftings/1"}): False,
    json.dumps({"schema": 1}): False,
    json.dumps(["mograft.graft/2"]): False,
    '{"schema": "mograft.graft/2"': False,
    "[" * 9999: False,
    "\xff": False,
}


@given(st.lists(st.sampled_from([None, *SIDECARS]), min_size=1, max_size=6))
def test_find_clips_files_with_provenance_are_grafts(tmp_path_factory, sidecars):
    folder = tmp_path_factory.mktemp("clips")
    for index, text in enumerate(sidecars):
        create(folder, [f"{index}.bvh"])
        if text is not None:
            (folder / f"{index}.json").write_text(text, encoding="latin-1")
    clips = find_clips([folder, *sorted(folder.glob("*.bvh")), f"{folder}/*.bvh"])
    n, expected = len(sidecars), [SIDECARS.get(text, False) for text in sidecars]
    assert [clip.is_graft for clip in clips] == [*expected, *[False] * 2 * n]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        kept = exclude_grafts(clips)
    assert kept == [clip for clip in clips if not clip.is_graft]
    assert [str(warning.message).split(" of ")[0] for warning in caught] == (
        [f"{sum(expected)} graft{'s'[: sum(expected) > 1]}"] if any(expected) else []
    )


def test_exclude_grafts_folder_of_grafts_raises_file_not_found(tmp_path):
    create(tmp_path, ["a.bvh"])
    (tmp_path / "a.json").write_text(GRAFT)
    with pytest.raises(FileNotFoundError, match="--include-grafts"):
        exclude_grafts(find_clips(tmp_path))


@pytest.fixture(scope="module")
def several(tmp_path_factory):
    """A GLB file of four clips in a subfolder."""
    folder = tmp_path_factory.mktemp("several")
    (folder / "sub").mkdir()
    clips = [
        replace(DANCE[90 * number : 90 * number + 160], name=name)
        for number, name in enumerate(PACK_NAMES)
    ]
    formats.write_glb(clips, folder / "sub" / "pack.glb")
    return folder


def addresses(found):
    return [clip.source for clip in found]


def test_find_clips_file_stands_for_all_of_its_clips(several):
    path = several / "sub" / "pack.glb"
    expected = [f"{path}#{name}" for name in PACK_NAMES]
    for source in (several, path, several / "sub", f"{several}/*/*.glb", f"{path}#*"):
        assert addresses(find_clips(source)) == expected
    assert addresses(find_clips(f"{path}#walk*")) == [expected[0], expected[2]]
    assert addresses(find_clips(f"{several}/*/*.glb#jump")) == [expected[1]]
    assert find_clips(several)[0].folders == ("sub",)
    with pytest.raises(ValueError, match="has no clip named 'jmup'; did you mean 'jump'"):
        find_clips(f"{path}#jmup")


def test_find_clips_folder_leaves_out_files_without_motion(several, tmp_path):
    mg.write_bvh(DANCE[:50], tmp_path / "a.bvh")
    # An export of a.bvh, arrays without a motion, and a mesh are no further clips.
    formats.write_glb(DANCE[:50], tmp_path / "a.glb")
    formats.write_npz(DANCE[:50], tmp_path / "a.npz")
    np.savez(tmp_path / "features.npz", points=np.zeros(3))
    (tmp_path / "mesh.gltf").write_text('{"asset": {"version": "2.0"}, "nodes": [{}]}')
    assert addresses(find_clips(tmp_path)) == [str(tmp_path / "a.bvh")]
    # A damaged file is a clip, so that ingest states what is wrong.
    (tmp_path / "broken.glb").write_bytes((several / "sub" / "pack.glb").read_bytes()[:99])
    assert len(find_clips(tmp_path)) == 2
    library = mg.Library.index(tmp_path, tmp_path / "l")
    assert library.names == ("a",)
    (reason,) = library.refused.values()
    assert "broken.glb: byte 8: expected" in reason


def test_index_remembers_format_clip_and_hash(several, tmp_path):
    library = mg.Library.index(several, tmp_path / "l")
    built = mg.Library.build(several)
    assert sorted(library.names) == sorted(PACK_NAMES)
    clips, entries = [*library.clips, *built.clips], library.entries + built.entries
    for clip, info in zip(clips, entries, strict=True):
        file = info.source_file
        assert (file.format, file.clip, clip.clip) == ("glTF", info.name, info.name)
        again = mg.read(file.path)[file.clip]
        np.testing.assert_array_equal(again.rotations, clip.rotations)
    assert len({info.source_file.sha256 for info in library.entries}) == 1
    assert set(library.to_dataframe("clips")["file_clip"]) == set(PACK_NAMES)


def test_tags_and_frame_rates_name_clips_of_files(several):
    library = mg.Library.build(
        several,
        tags={"pack.glb": ["all"], "walk": ["one"], "sub/pack.glb#jump": ["two"]},
        frame_rates={"pack.glb#*": 20.0},
    )
    tags = [info.tags[1:] for info in library.entries]
    assert tags == [("all", "one"), ("all", "two"), ("all",), ("all",)]
    assert library.rate == 20.0


def test_replay_finds_clips_of_a_file_that_moved(several):
    library = mg.Library.build(several)
    graft = mg.graft(library, "walk", seed=3)
    document = json.loads(json.dumps(mg.graft_record(graft)))
    assert {clip["clip"] for clip in document["clips"]} <= set(PACK_NAMES)
    for clip in document["clips"]:
        clip["file"] = "gone/pack.glb"
    again = mg.replay(document, sources=[str(several / "sub")])
    np.testing.assert_array_equal(again.motion.rotations, graft.motion.rotations)


def test_build_with_warnings_of_single_frame_poses_leaves_them_out(tmp_path):
    clips = [replace(DANCE[:100], name="walk"), replace(DANCE[:1], name="pose")]
    formats.write_glb(clips, tmp_path / "pack.glb")
    assert addresses(find_clips(tmp_path)) == [str(tmp_path / "pack.glb#walk")]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert mg.Library.build(tmp_path).names == ("walk",)
    assert mg.read(tmp_path / "pack.glb")["pose"].n_frames == 1
