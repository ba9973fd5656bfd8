"""Tables of a library: exported ones, that of segments, and spans that occur twice."""

import csv
import importlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import mograft as mg
from mograft.body.contacts import detect_contacts
from mograft.dancer import dance
from mograft.library.data import library_tables
from mograft.library.duplicates import find_duplicates
from mograft.library.export import export_tables
from mograft.library.segment_table import stride_phases
from tests.strategies import few_examples, transform_motion


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_export_tables_hold_library_tables(stored_library, tmp_path, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow", reason="needs the extra parquet")
    # A spreadsheet would read the name as a formula.
    entries = (stored_library.entries[0]._replace(name="=A1"), *stored_library.entries[1:])
    library = replace(stored_library, entries=entries)
    tables = library_tables(library)
    for path in export_tables(library, tmp_path / "out", kind):
        if kind == "csv":
            with path.open(newline="") as stream:
                names, *rows = csv.reader(stream)
            got = dict(zip(names, zip(*rows, strict=True), strict=True))
        else:
            got = importlib.import_module("pyarrow.parquet").read_table(path).to_pydict()
        for name, column in tables[path.stem].items():
            expected, actual = np.asarray(column), np.asarray(got[name])
            if kind == "csv" and name == "name":
                expected = ["'=A1", *expected[1:]]
            elif kind == "csv":
                actual = actual == "True" if expected.dtype.kind == "b" else actual
                actual = actual.astype(expected.dtype)
            np.testing.assert_array_equal(actual, expected)
    with pytest.raises(ValueError, match="`kind` must be one of 'parquet', 'csv', got 'xlsx'"):
        export_tables(library, tmp_path / "x", "xlsx")


def test_to_dataframe_columns_agree_with_library(stored_library):
    library = stored_library
    assert library.names == tuple(entry.name for entry in library.entries)
    clips, segments = library.to_dataframe("clips"), library.to_dataframe()
    assert tuple(clips["name"]) == library.names
    np.testing.assert_array_equal(segments["segment"], np.arange(len(library.segments)))
    assert (segments["start"] >= 0).all()
    assert (segments["start"] < segments["stop"]).all()
    assert (segments["stop"] < clips["frames"][segments["clip"]]).all()
    np.testing.assert_array_equal(segments["label_upper"], library.labels["upper"])
    points = library.to_dataframe("points")
    axes = [points[name] for name in points if name.startswith("lower_")]
    np.testing.assert_array_equal(np.stack(axes, axis=1), library.embedding["lower"].points)
    with pytest.raises(ValueError, match="`table` must be one of clips, segments, points, got 'x'"):
        library.to_dataframe("x")


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


@pytest.mark.parametrize(
    ("seed", "start", "length", "is_turned"), [(0, 100, 400, False), (5, 311, 300, True)]
)
def test_find_duplicates_planted_piece_is_found_and_spans_have_equal_poses(
    seed, start, length, is_turned
):
    take = dance(seed=seed, strides=1).motion
    piece = replace(take[start : start + length], name="piece")
    if is_turned:
        piece = transform_motion(piece, yaw=1.0, offset=(50.0, 0.0, 9.0))
    library = mg.Library.build([take, piece])
    clips = dict(zip(library.names, library.clips, strict=True))
    spans = find_duplicates(library)
    found = [own for own in spans if own.other == "piece" and own.clip == "dance"]
    shifts = [own.frames[0] - own.other_frames[0] for own in found]
    covered = np.zeros(length, bool)
    for own, shift in zip(found, shifts, strict=True):
        covered[own.other_frames[0] : own.other_frames[1] + 1] |= shift == start
    # Segments near the ends of the piece can have other boundaries than in the take.
    assert covered[60:-60].mean() > 0.5
    for own in spans:
        first, second = (
            clips[name].rotations[frames[0] : frames[1] + 1, 1:]
            for name, frames in ((own.clip, own.frames), (own.other, own.other_frames))
        )
        if len(first) == len(second):
            assert mg.rotations.angle(first, second).max() < np.radians(1.0)


def test_find_duplicates_without_any_returns_none():
    assert find_duplicates(mg.Library.build(dance(seed=1, strides=1).motion[:400])) == []


def test_find_duplicates_of_three_takes_lists_each_pair():
    take = dance(strides=1).motion[:300]
    library = mg.Library.build([replace(take, name=name) for name in "abc"])
    pairs = [(own.clip, own.other) for own in find_duplicates(library)]
    assert pairs == [("a", "b"), ("a", "c"), ("b", "c")]
