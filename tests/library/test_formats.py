"""Libraries of clips in files that hold several clips."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from mograft.library.discover import find_clips
from tests.library.checks import DANCE, PACK_NAMES


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
