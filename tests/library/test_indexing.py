"""Properties of indexing and adding: a library in a folder equals one in memory."""

import os
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import BvhError, Library, SkeletonMismatchError, graft, write_bvh
from mograft.library import ingest
from mograft.library.clip_keys import read_tags
from mograft.library.files import storage
from mograft.library.origin import hash_library
from tests.fingerprint import fingerprint
from tests.library.checks import CLIP_NAMES, DANCE, PACK_NAMES, assert_same_libraries, copy_clips
from tests.library.other_figures import as_other_figure
from tests.strategies import few_examples


def test_index_equals_build(clip_folder, stored_library):
    built = Library.build([clip_folder / f"{name}.bvh" for name in CLIP_NAMES])
    assert_same_libraries(stored_library, built)
    assert [info.name for info in stored_library.entries] == ["c", "d", "a", "a~2", "b"]
    grafts = [graft(own, seed=3) for own in (stored_library, built)]
    assert fingerprint(grafts[0]) == fingerprint(grafts[1])
    documents = [mg.graft_record(own) for own in grafts]
    for document in documents:
        del document["library"]["folder"]
    assert documents[0] == documents[1]
    for segment in range(0, len(built.segments), 7):
        expected = mg.candidates(built, segment, "upper")
        assert mg.candidates(stored_library, segment, "upper") == expected


FAST = replace(DANCE[:500].resample(60.0), channel_values=None)  # more frames than all others
OTHER = as_other_figure(DANCE[180:320])
VERSIONS = (DANCE[:160], DANCE[90:250], FAST, OTHER)
PACKED = {name: DANCE[60 * i : 60 * i + 90] for i, name in enumerate(PACK_NAMES)}
CONTENTS = st.dictionaries(st.sampled_from(CLIP_NAMES), st.sampled_from(range(4)), max_size=3)
PACKS = st.none() | st.sets(st.sampled_from(PACK_NAMES), min_size=1)


def index_quietly(place, name, match):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Library.index(place / "clips", place / name, match=match)


def write_clips(folder, contents, pack, start):
    """Write versions of clips, and a file with the clips `pack`, each from a frame on."""
    for name, version in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_bvh(VERSIONS[version][start:], folder / f"{name}.bvh")
    if pack is not None:
        clips = [replace(own[start:], name=n) for n, own in PACKED.items() if n in pack]
        mg.formats.write_glb(clips, folder / "pack.glb")


@few_examples(12)
@given(
    steps=st.lists(st.tuples(CONTENTS, PACKS), min_size=1, max_size=2),
    match=st.sampled_from(["names", "anatomy"]),
    is_moved=st.booleans(),
)
def test_add_after_any_changes_equals_index_of_all_files(tmp_path_factory, steps, match, is_moved):
    """Files are added, changed, moved with the library, or only touched; they may change its rate.

    Only new and changed files are read. Clips that a file no longer contains are removed.
    """
    place = tmp_path_factory.mktemp("changes") / "here"
    write_clips(place / "clips", {"c": 0, "d": 1}, {PACK_NAMES[0]}, 0)
    # Matched by anatomy the library keeps its rate, by names its hierarchy.
    other = {"anatomy": FAST, "names": OTHER}[match]
    steps = [({k: v for k, v in own.items() if VERSIONS[v] is not other}, p) for own, p in steps]
    library, held = index_quietly(place, "l", match), {PACK_NAMES[0]}
    for number, (contents, pack) in enumerate(steps, 1):
        if is_moved:
            place = place.rename(place.with_name(f"there{number}"))
            library = Library.open(place / "l")
        before, names = library, library.names
        os.utime(place / "clips/d.bvh", (number, number))
        write_clips(place / "clips", contents, pack, number)
        with (
            patch.object(ingest, "read_clip", wraps=ingest.read_clip) as reads,
            warnings.catch_warnings(record=True) as caught,
        ):
            warnings.simplefilter("always")
            library = library.add(place / "clips")
        paths = {own.args[0].partition("#")[0] for own in reads.call_args_list}
        read = {os.path.relpath(own, place / "clips") for own in paths}
        packs = set() if pack is None else {"pack.glb"}
        assert read == packs | {f"{name}.bvh" for name in contents}
        fresh = index_quietly(place, f"fresh{number}", match)
        assert_same_libraries(library, fresh)
        assert (library.tags, hash_library(library)) == (fresh.tags, hash_library(fresh))
        removed = held - pack if packs and len(held) > 1 else set()
        held = pack or held
        told = [str(own.message) for own in caught if "no longer contains" in str(own.message)]
        assert len(told) == bool(removed)
        assert all(name in told[0] for name in removed)
        # The library that was open before has not changed, and its clips can still be read.
        assert before.names == names
        assert len(before.clips[0].rotations) > 0
        assert storage.verify(place / "l") == storage.list_leftovers(place / "l") == []


def test_index_frame_rates_override_file_rates(clip_folder, tmp_path):
    folder = copy_clips(clip_folder, tmp_path / "part", ["c", "d"])
    with pytest.warns(UserWarning, match="resampled to 30 fps"):
        library = Library.index(folder, tmp_path / "l", frame_rates={"d": 15.0}, rate=30)
    uncorrected = Library.index(folder, tmp_path / "uncorrected")
    assert library.entries[1].rate_override == 15
    assert library.clips[1].duration == 2 * uncorrected.clips[1].duration
    assert [clip.rate for clip in library.clips] == pytest.approx([30.0] * 2, rel=1e-2)
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


def test_add_only_tags_keeps_the_segments_of_clips_in_any_order(clip_folder, tmp_path):
    files = [clip_folder / f"{name}.bvh" for name in reversed(CLIP_NAMES)]
    built = Library.build(files)
    built.save(tmp_path / "l")
    later = Library.open(tmp_path / "l").add(clip_folder, tags={"*": ["late"]})
    assert_same_libraries(later, built)
    assert_same_libraries(Library.open(tmp_path / "l"), built)
    assert all("late" in tags for tags in later.tags)


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
