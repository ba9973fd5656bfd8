"""Properties of writing: locks, interruptions, full disks, existing folders."""

import os
import shutil

import numpy as np
import pytest

import mograft as mg
from mograft import Library, LibraryError, write_bvh
from mograft.library.files import generation, storage
from tests.library.checks import DANCE, assert_same_libraries, list_files


def test_index_existing_folder_is_kept_without_force(clip_folder, stored_library, tmp_path):
    library = Library.index(clip_folder / "c.bvh", tmp_path / "l")
    with pytest.raises(FileExistsError, match="force"):
        Library.index(clip_folder, tmp_path / "l")
    assert_same_libraries(Library.open(tmp_path / "l"), library)
    assert_same_libraries(Library.index(clip_folder, tmp_path / "l", force=True), stored_library)
    other = tmp_path / "mine"
    other.mkdir()
    (other / "thesis.txt").write_text("chapter 1")
    with pytest.raises(LibraryError, match="not overwritten"):
        Library.index(clip_folder, other, force=True)
    (tmp_path / "empty").mkdir()
    assert_same_libraries(Library.index(clip_folder, tmp_path / "empty"), stored_library)
    with pytest.raises(ValueError, match="in memory: save it first"):
        Library.build(DANCE[:200]).add(clip_folder)
    with pytest.raises(TypeError, match="`rate` is fixed"):
        stored_library.add(clip_folder, rate=30.0)
    with pytest.raises(TypeError, match="`sources` must be files"):
        Library.index(DANCE, tmp_path / "no")
    with pytest.raises(ValueError, match="appended base motion cannot be saved"):
        stored_library.with_clip(DANCE[700:900]).save(tmp_path / "no")


@pytest.mark.parametrize("change", ["folder of a year", "manifest", "link"])
@pytest.mark.parametrize("source", ["folder", "missing"])
def test_index_force_leaves_folders_that_hold_foreign_files(clip_folder, tmp_path, change, source):
    folder = Library.index(clip_folder / "c.bvh", tmp_path / "l").folder
    if change == "manifest":
        (folder / "manifest.json").write_text('{"format": "web app", "version": 1}')
    elif change == "link":
        (folder / "0009").symlink_to(folder / "0001", target_is_directory=True)
    else:
        (folder / "2024").mkdir()
        (folder / "2024" / "tax.pdf").write_bytes(b"tax")
    before = list_files(tmp_path / "l")
    clips = clip_folder if source == "folder" else tmp_path / "no.bvh"
    with pytest.raises((LibraryError, OSError, ValueError)):
        Library.index(clips, tmp_path / "l", force=True)
    assert list_files(tmp_path / "l") == before


def test_index_force_that_fails_keeps_the_library(clip_folder, tmp_path):
    library = Library.index(clip_folder / "c.bvh", tmp_path / "l")
    (tmp_path / "bad.bvh").write_text("no motion")
    with pytest.raises(ValueError, match=r"no clip can be used: .*bad\.bvh"):
        Library.index(tmp_path / "bad.bvh", tmp_path / "l", force=True)
    assert_same_libraries(Library.open(tmp_path / "l"), library)
    assert storage.list_leftovers(tmp_path / "l") == []


def test_write_generation_second_writer_raises_library_error(clip_folder, tmp_path):
    library = Library.index(clip_folder / "c.bvh", tmp_path / "l")
    with generation.write_generation(tmp_path / "l", add=True):
        with pytest.raises(LibraryError, match="another process is writing"):
            library.add(clip_folder)
        assert_same_libraries(Library.open(tmp_path / "l"), library)
    assert storage.list_leftovers(tmp_path / "l") == []


@pytest.mark.parametrize("stage", ["write_array", "write_clip_table", "commit"])
def test_write_error_at_any_stage_leaves_old_library(clip_folder, tmp_path, monkeypatch, stage):
    library = Library.index(clip_folder / "c.bvh", tmp_path / "l")

    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(generation.GenerationWriter, stage, fail)
    with pytest.raises(KeyboardInterrupt):
        library.add(clip_folder)
    with pytest.raises(KeyboardInterrupt):
        Library.index(clip_folder, tmp_path / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["l"]
    assert storage.list_leftovers(tmp_path / "l") == []
    assert_same_libraries(Library.open(tmp_path / "l"), library)


def test_write_full_disk_names_the_file(clip_folder, tmp_path):
    """A limit on the size of files stands for a full disk."""
    resource = pytest.importorskip("resource", reason="needs limits on the size of files")
    library = Library.index(clip_folder / "c.bvh", tmp_path / "l")
    largest = max(path.stat().st_size for path in list_files(tmp_path / "l"))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest + 4096, before[1]))
    try:
        with pytest.raises(OSError, match="File too large") as error:
            library.add(clip_folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert error.value.filename.startswith(str(tmp_path / "l"))
    assert storage.list_leftovers(tmp_path / "l") == []


@pytest.mark.skipif(os.name != "posix", reason="open files cannot be removed here")
@pytest.mark.parametrize("change", ["add", "force"])
def test_open_library_keeps_its_clips_and_samples_when_another_generation_is_written(
    small_library, tmp_path, change
):
    folder = tmp_path / "l"
    shutil.copytree(small_library, folder)
    library, wanted = Library.open(folder), Library.open(small_library)
    write_bvh(DANCE[70:200], tmp_path / "b.bvh")
    if change == "add":
        Library.open(folder).add(tmp_path / "b.bvh")
    else:
        Library.index(tmp_path / "b.bvh", folder, force=True)
    assert len(Library.open(folder).names) == (2 if change == "add" else 1)
    library.save(tmp_path / "copy")
    for got in (library, Library.open(tmp_path / "copy")):
        assert_same_libraries(got, wanted)
    new = mg.graft(library, seed=3).motion
    np.testing.assert_array_equal(new.rotations, mg.graft(wanted, seed=3).motion.rotations)
