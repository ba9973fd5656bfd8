"""The table of all segments: ids that stay, contacts, phases and copies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import mograft as mg
from mograft.body.contacts import detect_contacts
from mograft.dancer import dance
from mograft.library.segment_table import stride_phases
from tests.strategies import few_examples


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """Five short clips in two folders, two of one name; the last is a copy of the first."""
    folder = tmp_path_factory.mktemp("clips")
    take = dance(seed=3, strides=1).motion
    names = ["b/walk", "a/walk", "a/run", "c", "0"]
    starts = [100, 300, 500, 700, 100]
    for name, start in zip(names, starts, strict=True):
        (folder / name).parent.mkdir(exist_ok=True)
        mg.write_bvh(take[start : start + 150], folder / f"{name}.bvh")
    return folder, names


@few_examples(3)
@given(data=st.data())
def test_table_ids_stay_when_clips_are_added(clips, tmp_path_factory, data):
    folder, names = clips
    order = data.draw(st.permutations(names))
    n = data.draw(st.integers(1, 4))
    target = tmp_path_factory.mktemp("library") / "lib"
    files = [folder / f"{name}.bvh" for name in order]
    libraries = [mg.Library.index(files[:n], target)]
    libraries.append(libraries[0].add(files[n:]))
    known = {}
    for library in libraries:
        table = library.table()
        assert len(set(table["id"].tolist())) == len(library.segments)
        for name, column in library.to_dataframe().items():
            assert np.array_equal(table[name], column)
        for row, segment in enumerate(table["id"].tolist()):
            path = library.entries[table["clip"][row]].source_file.path
            place = path, int(table["start"][row]), int(table["stop"][row])
            assert known.setdefault(segment, place) == place
    assert len(known) == len(libraries[1].segments)


def test_table_twins_are_copies_and_contacts_those_of_the_clips(clips):
    library = mg.Library.build(clips[0])
    table = library.table()
    assert table["id"].dtype == table["twin"].dtype == np.uint64
    names = np.array(library.names)[table["clip"]]
    copies, twins = [names == own for own in ("0", "walk~2")], np.zeros(len(names), np.uint64)
    for one, other in (copies, copies[::-1]):
        twins[one] = table["id"][other]
    np.testing.assert_array_equal(table["twin"], twins)
    for row, clip in enumerate(table["clip"].tolist()):
        stands = detect_contacts(library.clips[clip]).any(axis=2)
        frames = slice(table["start"][row], table["stop"][row] + 1)
        for leg, side in enumerate(("Left", "Right")):
            share = stands[frames, leg].mean()
            assert table[f"contact_{side}Foot"][row] == pytest.approx(share)
        phase = stride_phases(stands, library.rate)[table["start"][row]]
        assert np.array_equal(table["phase"][row], phase, equal_nan=True)
    assert np.isfinite(table["phase"]).any()


@given(arrays(bool, st.tuples(st.integers(1, 40), st.just(2))), st.sampled_from([4.0, 30.0]))
def test_stride_phases_grow_between_contacts_of_both_legs(stands, rate):
    found = stride_phases(stands, rate)
    begins = [
        (frame, leg)
        for frame in range(1, len(stands))
        for leg in (0, 1)
        if stands[frame, leg] and not stands[frame - 1, leg]
    ]
    for frame in range(len(stands)):
        before = max((own for own in begins if own[0] <= frame), default=None)
        after = min((own for own in begins if own[0] > frame), default=None)
        expected = np.nan
        if before and after and before[1] != after[1] and after[0] - before[0] <= 1.5 * rate:
            share = (frame - before[0]) / (after[0] - before[0])
            expected = before[1] / 2 + share / 2
        assert found[frame] == pytest.approx(expected, nan_ok=True)


def test_table_of_mirrored_library_has_ids_of_its_own():
    library = mg.Library.build(dance(seed=3, strides=1).motion[:200]).with_mirror_images()
    assert len(set(library.table()["id"].tolist())) == len(library.segments)


def test_stride_phases_need_two_legs():
    assert np.isnan(stride_phases(np.zeros((9, 1), bool), 30.0)).all()
