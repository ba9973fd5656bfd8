"""Libraries, grafts, streams and pictures with a chosen segmentation."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import mograft as mg
from mograft.dancer import dance

DANCE = dance(seed=2, strides=1).motion


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two clips, of 600 and 500 frames."""
    folder = tmp_path_factory.mktemp("clips")
    mg.write_bvh(DANCE[:600], folder / "a.bvh")
    mg.write_bvh(DANCE[600:1100], folder / "b.bvh")
    return folder


def every_eighth(motion):
    return np.arange(8, motion.n_frames - 8, 8)


def test_library_with_cut_frames_is_stored_and_replayed(folder, tmp_path):
    cuts = {"a": [10, 30, 200], "b": list(range(20, 480, 20))}
    config = mg.Config(segmentation=cuts)
    with ThreadPoolExecutor(2) as executor:
        library = mg.Library.index(folder, tmp_path / "lib", config=config, executor=executor)
    assert mg.Library.open(tmp_path / "lib").config == config
    first = library.segments[library.segments.of_clip(0)]
    assert first.start.tolist() == [0, 10, 30, 200]
    graft = mg.graft(library, "b", seed=1)
    mg.write_graft(graft, tmp_path / "new.bvh")
    again = mg.replay(tmp_path / "new.json")
    np.testing.assert_array_equal(again.motion.rotations, graft.motion.rotations)
    with pytest.raises(ValueError, match="must have cut frames for every clip, got none for 'c'"):
        mg.graft(library, mg.Motion(**{**vars(DANCE[:50]), "name": "c"}))


def test_cut_frames_of_a_clip_count_at_its_own_rate(folder):
    cuts = {"a": [20, 61, 300], "b": [11]}
    with pytest.warns(UserWarning, match="resampled to 60 fps"):
        library = mg.Library.build(folder, config=mg.Config(segmentation=cuts), rate=60.0)
    assert library.segments.start.tolist() == [0, 40, 122, 600, 0, 22]


def test_invalid_cut_frames_exclude_the_clip(folder, tmp_path):
    config = mg.Config(segmentation={"a": range(20, 580, 20), "b": [9, 900]})
    library = mg.Library.index(folder, tmp_path / "lib", config=config)
    assert [entry.name for entry in library.entries] == ["a"]
    (reason,) = library.refused.values()
    assert reason == "cut frames of b must be at most 499, its last frame, got 900"


def test_library_with_a_function_works_in_memory_and_cannot_be_stored(folder, tmp_path):
    config = mg.Config(segmentation=every_eighth)
    library = mg.Library.build(folder, config=config)
    assert library.segments.start[:4].tolist() == [0, 8, 16, 24]
    graft = mg.graft(library, DANCE[1100:1200], seed=1)
    assert graft.motion.n_frames == 100
    document = json.loads(json.dumps(mg.graft_record(graft)))
    with pytest.raises(mg.ProvenanceError, match=r"`segmentation` was the function .*every_eighth"):
        mg.replay(document)
    for store in (
        lambda: library.save(tmp_path / "saved"),
        lambda: mg.Library.index(folder, tmp_path / "indexed", config=config),
    ):
        with pytest.raises(ValueError, match="must be 'energy' or the cut frames of each"):
            store()
    assert not list(tmp_path.iterdir())


def test_view_and_plot_show_the_segments_of_the_configuration():
    config = mg.Config(segmentation=every_eighth)
    page = mg.view(DANCE[:300], config=config, show=False)
    expected = mg.segment(DANCE[:300], config)
    assert str(expected.stop.tolist()).replace(" ", "") in page.html
    pytest.importorskip("matplotlib")
    axes = mg.plot.energy(DANCE[:300], config)
    assert f"{len(expected)} segments" in axes.get_title(loc="left")
