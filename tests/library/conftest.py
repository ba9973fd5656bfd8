"""Fixtures of the tests of libraries in folders."""

import pytest

from mograft import Library, write_bvh
from tests.library.checks import DANCE


@pytest.fixture(scope="session")
def clip_folder(tmp_path_factory):
    """A folder of clips, some of them in subfolders."""
    folder = tmp_path_factory.mktemp("clips")
    for number, name in enumerate(("walk/b", "walk/a", "jump/a", "c", "d")):
        (folder / name).parent.mkdir(exist_ok=True)
        write_bvh(DANCE[number * 90 : number * 90 + 160], folder / f"{name}.bvh")
    return folder


@pytest.fixture(scope="session")
def stored_library(clip_folder, tmp_path_factory):
    """The clips of `clip_folder`, indexed."""
    return Library.index(clip_folder, tmp_path_factory.mktemp("libraries") / "dance.mograft")


@pytest.fixture(scope="session")
def small_library(tmp_path_factory):
    """The folder of a library of one short clip."""
    folder = tmp_path_factory.mktemp("small")
    write_bvh(DANCE[:70], folder / "a.bvh")
    Library.index(folder, folder / "l")
    return folder / "l"
