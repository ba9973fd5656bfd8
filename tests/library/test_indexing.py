"""Properties of indexing and adding: a library in a folder equals one in memory."""

import os
import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import BvhError, Library, SkeletonMismatchError, graft, graft_many, write_bvh
from mograft.library import ingest
from mograft.library.clip_keys import read_tags
from mograft.library.files import storage
from tests.library.checks import CLIP_NAMES, DANCE, assert_same_libraries, copy_clips


def test_index_equals_build(clip_folder, stored_library):
    built = Library.build([clip_folder / f"{name}.bvh" for name in CLIP_NAMES])
    assert_same_libraries(stored_library, built)
    assert [info.name for info in stored_library.entries] == ["c", "d", "a", "a~2", "b"]
    ours, theirs = graft(stored_library, seed=3), graft(built, seed=3)
    documents = [mg.graft_record(own) for own in (ours, theirs)]
    for document in documents:
        del document["library"]["folder"]
    assert documents[0] == documents[1]
    np.testing.assert_array_equal(ours.motion.rotations, theirs.motion.rotations)
    np.testing.assert_array_equal(ours.motion.channel_values, theirs.motion.channel_values)
    assert len(graft_many(stored_library, "a", 2, seed=1)) == 2
    for segment in range(0, len(built.segments), 7):
        expected = mg.candidates(built, segment, "upper")
        assert mg.candidates(stored_library, segment, "upper") == expected


@settings(max_examples=8, suppress_health_check=list(HealthCheck))
@given(st.lists(st.sampled_from(CLIP_NAMES), min_size=1, max_size=4, unique=True))
def test_add_equals_index_of_all_files(clip_folder, stored_library, tmp_path, first):
    shutil.rmtree(tmp_path / "part", ignore_errors=True)
    shutil.rmtree(tmp_path / "l", ignore_errors=True)
    folder = copy_clips(clip_folder, tmp_path / "part", first)
    part = Library.index(folder, tmp_path / "l")
    before = [info.name for info in part.entries]
    whole = part.add(copy_clips(clip_folder, folder, CLIP_NAMES))
    assert_same_libraries(whole, stored_library)
    # The library that was open before has not changed, and its clips can still be read.
    assert [info.name for info in part.entries] == before
    assert len(part.clips[0].rotations) > 0
    assert storage.verify(tmp_path / "l") == []
    assert storage.list_leftovers(tmp_path / "l") == []


def test_add_reads_new_and_changed_files_only(clip_folder, tmp_path, monkeypatch):
    folder = copy_clips(clip_folder, tmp_path / "part", CLIP_NAMES[:3])
    library = Library.index(folder, tmp_path / "l")
    read = []
    read_clip = ingest.read_clip

    def read_and_list(path, **options):
        read.append(path)
        return read_clip(path, **options)

    monkeypatch.setattr(ingest, "read_clip", read_and_list)
    library = library.add(copy_clips(clip_folder, folder, CLIP_NAMES[:4]))
    assert [os.path.basename(path) for path in read] == ["a.bvh"]
    (folder / "c.bvh").write_bytes((clip_folder / "d.bvh").read_bytes())
    os.utime(folder / "d.bvh", (1, 1))
    read.clear()
    library = library.add(folder)
    assert [os.path.basename(path) for path in read] == ["c.bvh"]
    np.testing.assert_array_equal(library.clips[0].rotations, library.clips[1].rotations)
    assert_same_libraries(library, Library.index(folder, tmp_path / "fresh"))
    assert library.add(folder).entries == library.entries


def test_add_changed_majority_rate_ingests_all_clips_again(clip_folder, tmp_path):
    """The library rate is that of most frames; a new file can change it."""
    folder = copy_clips(clip_folder, tmp_path / "part", ["c", "walk/a"])
    fast = replace(DANCE[:500].resample(60.0), channel_values=None)
    write_bvh(fast[:120], folder / "fast.bvh")
    with pytest.warns(UserWarning, match="resampled to 30 fps"):
        library = Library.index(folder, tmp_path / "l")
    assert library.rate == pytest.approx(30)
    write_bvh(fast, folder / "faster.bvh")
    with pytest.warns(UserWarning, match="resampled to 60 fps"):
        library = library.add(folder)
    with pytest.warns(UserWarning, match="resampled"):
        assert_same_libraries(library, Library.index(folder, tmp_path / "fresh"))
    assert library.rate == pytest.approx(60)
    with pytest.warns(UserWarning, match="resampled"):
        fixed = Library.index(folder, tmp_path / "fixed", rate=30)
    assert [clip.rate for clip in fixed.clips] == pytest.approx([30.0] * 4, rel=1e-2)


def test_index_frame_rates_override_file_rates(clip_folder, tmp_path):
    folder = copy_clips(clip_folder, tmp_path / "part", ["c", "d"])
    with pytest.warns(UserWarning, match="resampled to 30 fps"):
        library = Library.index(folder, tmp_path / "l", frame_rates={"d": 15.0}, rate=30)
    uncorrected = Library.index(folder, tmp_path / "uncorrected")
    assert library.entries[1].rate_override == 15
    assert library.clips[1].duration == 2 * uncorrected.clips[1].duration
    assert library.clips[1].rate == pytest.approx(30)
    with pytest.raises(ValueError, match="`frame_rates` must be above 0"):
        Library.index(folder, tmp_path / "no", frame_rates={"*": 0})
    assert not (tmp_path / "no").exists()


def test_index_unusable_clips_are_left_out_or_raise_if_strict(clip_folder, tmp_path):
    folder = copy_clips(clip_folder, tmp_path / "part", ["c", "d"])
    names = ["Tail" if name == "Head" else name for name in DANCE.skeleton.names]
    other = replace(DANCE[:60], skeleton=replace(DANCE.skeleton, names=names))
    write_bvh(other, folder / "a_goat.bvh")
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT")
    write_bvh(DANCE[:1], folder / "still.bvh")
    with pytest.warns(UserWarning, match="3 of 3 clips fit with --match anatomy") as caught:
        library = Library.index(folder, tmp_path / "l")
    joints = DANCE.skeleton.n_joints
    table = [f"     2 with  {joints} joints below Hips: c, d (used)"]
    table += [f"     1 with  {joints} joints below Hips: a_goat"]
    assert str(caught[0].message).splitlines()[1:3] == table
    assert [info.name for info in library.entries] == ["c", "d"]
    reasons = [library.refused[str(folder / f"{n}.bvh")] for n in ("a_goat", "broken", "still")]
    assert "lacks Head and also has Tail" in reasons[0]
    assert "broken.bvh:2" in reasons[1]
    assert "at least 2 frames" in reasons[2]
    with pytest.raises(BvhError):
        Library.index(folder, tmp_path / "strict", strict=True)
    (folder / "broken.bvh").unlink()
    (folder / "still.bvh").unlink()
    with pytest.raises(SkeletonMismatchError, match="a_goat"):
        Library.index(folder, tmp_path / "strict", strict=True)
    with pytest.raises(SkeletonMismatchError, match="a_goat"):
        library.add(folder, strict=True)
    assert not (tmp_path / "strict").exists()
    assert list(tmp_path.glob(".*partial*")) == []
    assert_same_libraries(Library.open(tmp_path / "l"), library)


def test_index_tags_combine_folders_and_table(clip_folder, stored_library, tmp_path):
    assert list(map(set, stored_library.tags)) == [set(), set(), {"jump"}, {"walk"}, {"walk"}]
    table = tmp_path / "tags.csv"
    table.write_text("clip,tags\nc,calm,slow\n*/a.bvh,short\nd.bvh,calm\n")
    tagged = Library.index(clip_folder, tmp_path / "l", tags=read_tags(table))
    expected = [{"calm", "slow"}, {"calm"}, {"jump", "short"}, {"walk", "short"}, {"walk"}]
    assert [set(tags) for tags in tagged.tags] == expected
    stages = []
    later = tagged.add(clip_folder, tags={"b": ["late"]}, progress=lambda *own: stages.append(own))
    assert set(later.tags[4]) == {"walk", "late"}
    assert_same_libraries(later, stored_library)
    assert {stage for stage, *_ in stages} == {"writing"}  # new tags do not change the clusters
    assert_same_libraries(Library.open(later.folder), stored_library)
    assert storage.verify(later.folder) == []


POOLS = {
    "threads": lambda: ThreadPoolExecutor(2),
    "processes": lambda: ProcessPoolExecutor(2, mp_context=get_context("spawn")),
}


@contextmanager
def executor_of(kind):
    """Yield two workers: threads, spawned processes, or those of a local cluster of Dask."""
    if kind in POOLS:
        with POOLS[kind]() as pool:
            yield pool
        return
    dask = pytest.importorskip("dask", reason="needs the extra dask")
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    names = ("comm.timeouts.connect", "comm.timeouts.tcp", "deploy.lost-worker-timeout")
    with (
        dask.config.set({f"distributed.{name}": "600s" for name in names}),  # on a busy machine
        # The default of the limit depends on the machine.
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=0
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()


@pytest.mark.filterwarnings("ignore:.*taking a surprisingly long time")
@pytest.mark.parametrize("kind", ["threads", "processes", "dask"])
def test_index_any_executor_gives_the_same_library(
    clip_folder, stored_library, tmp_path, monkeypatch, kind
):
    monkeypatch.setattr(ingest, "BATCH_CLIPS", 1)  # five clips in several batches
    with executor_of(kind) as executor:
        indexed = Library.index(clip_folder, tmp_path / "l", executor=executor)
        assert_same_libraries(indexed, stored_library)
        files = [info.source_file.path for info in stored_library.entries]
        assert_same_libraries(Library.build(files, executor=executor), stored_library)


def test_open_moved_library_finds_moved_clips(clip_folder, tmp_path):
    folder = copy_clips(clip_folder, tmp_path / "here" / "clips", CLIP_NAMES)
    Library.index(folder, tmp_path / "here" / "l")
    (tmp_path / "here").rename(tmp_path / "there")
    library = Library.open(tmp_path / "there" / "l")
    assert all(os.path.exists(info.source_file.path) for info in library.entries)
    assert library.add(tmp_path / "there" / "clips").entries == library.entries
