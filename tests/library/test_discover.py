"""Properties of the search for clips, and of paths of source files."""

import json
import os
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.cli.files import expand_folders
from mograft.library.discover import exclude_grafts, find_clips, relative_path

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
