"""Properties of paths of source files."""

import os
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from mograft.library.discover import relative_path

FOLDER_PATHS = st.lists(st.sampled_from(["a", "b", "..", ".", "a b"]), max_size=5).map("/".join)


@given(FOLDER_PATHS, FOLDER_PATHS, st.booleans())
def test_relative_path_matches_os_path_relpath(folders, folder, is_absolute):
    path = f"{folders}/take.bvh".lstrip("/")
    path = os.path.abspath(path) if is_absolute else path
    expected = Path(os.path.relpath(path, folder or "."))
    assert relative_path(path, Path(folder)) == expected
