"""Properties of the search for clips, and of paths of source files."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.cli.files import expand_folders
from mograft.library.discover import find_clips, relative_path

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
    with pytest.raises(FileNotFoundError, match="no BVH file"):
        find_clips(tmp_path)
    assert [found.source for found in find_clips(tmp_path / "._walk.bvh")] == [
        str(tmp_path / "._walk.bvh")
    ]
