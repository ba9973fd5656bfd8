"""Properties of pickled libraries: equality with the original, and size."""

import multiprocessing
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import Config, Library, LibraryError, graft
from tests.library.checks import DANCE, assert_same_libraries

BASE = replace(DANCE[700:900], name="base")
# 3.7 and 4 intervals cannot have the same rate: the rate stays above the library's.
FAST = replace(BASE[:5], frame_time=BASE.frame_time * 0.92)


def test_pickle_of_library_in_memory_holds_its_arrays(stored_library):
    library = Library.build(DANCE[:160])
    again = pickle.loads(pickle.dumps(library))
    assert_same_libraries(again, library)
    # A library with replaced fields is no longer that of the folder.
    changed = replace(stored_library, is_donor=np.zeros_like(stored_library.is_donor))
    again = pickle.loads(pickle.dumps(changed))
    assert_same_libraries(again, changed)
    assert not again.is_donor.any()


@settings(max_examples=20)
@given(st.lists(st.sampled_from(["relabelled", "extended", "resampled"]), max_size=3), st.data())
def test_pickle_of_stored_or_derived_library_is_small_and_equal(stored_library, steps, data):
    """Whatever was derived from a stored library, and in which order; unpickling does not warn."""
    library, n_motions = stored_library, 0
    for step in steps:
        if step == "extended":
            library, n_motions = library.with_clip(BASE), n_motions + 1
        elif step == "resampled":
            with pytest.warns(UserWarning, match="is resampled from"):
                library, n_motions = library.with_clip(FAST), n_motions + 1
        else:
            scale = data.draw(st.sampled_from([0.3, 0.5, 1.0, 2.0]))
            library = library.relabelled(Config(sigma_scale=scale))
    pickled = pickle.dumps(library)
    again = pickle.loads(pickled)
    assert_same_libraries(again, library)
    assert again.refused == library.refused
    assert len(pickled) < 100_000 + n_motions * len(pickle.dumps(BASE))
    assert len(pickle.dumps(again)) == len(pickled)


def test_unpickle_changed_folder_raises_library_error(stored_library, clip_folder, tmp_path):
    shutil.copytree(stored_library.folder, tmp_path / "l")
    data = pickle.dumps(Library.open(tmp_path / "l"))
    Library.index(clip_folder / "c.bvh", tmp_path / "l", force=True)
    with pytest.raises(LibraryError, match="has changed since the library was pickled"):
        pickle.loads(data)
    shutil.rmtree(tmp_path / "l")
    with pytest.raises(FileNotFoundError):
        pickle.loads(data)


def test_pickle_relative_folder_opens_from_another_directory(stored_library, tmp_path, monkeypatch):
    monkeypatch.chdir(stored_library.folder.parent)
    data = pickle.dumps(Library.open(stored_library.folder.name))
    monkeypatch.chdir(tmp_path)
    assert_same_libraries(pickle.loads(data), stored_library)


def test_graft_of_stored_library_in_another_process_is_identical(stored_library):
    expected = graft(stored_library, BASE, seed=3)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        received = pool.apply(graft, (stored_library, BASE), {"seed": 3})
    np.testing.assert_array_equal(received.motion.rotations, expected.motion.rotations)
    assert mg.graft_record(received) == mg.graft_record(expected)
