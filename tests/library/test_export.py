"""Properties of exported tables."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from mograft import Library
from mograft.dancer import dance
from mograft.library.data import library_tables
from mograft.library.export import export_tables


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_export_tables_hold_library_tables(stored_library, tmp_path, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow", reason="needs the extra parquet")
    tables = library_tables(stored_library)
    files = export_tables(stored_library, tmp_path / "out", kind)
    if kind == "csv":
        got = {}
        for path in files:
            with path.open(newline="") as stream:
                names, *rows = csv.reader(stream)
            columns = zip(*rows, strict=True)
            got[path.stem] = dict(zip(names, map(list, columns), strict=True))
    else:
        import pyarrow.parquet

        got = {path.stem: pyarrow.parquet.read_table(path).to_pydict() for path in files}
    for table, columns in tables.items():
        for name, column in columns.items():
            expected = np.asarray(column)
            actual = np.asarray(got[table][name])
            if actual.dtype.kind == "U" and expected.dtype.kind == "b":
                actual = actual == "True"
            np.testing.assert_array_equal(actual.astype(expected.dtype), expected)
    with pytest.raises(ValueError, match="`kind` must be"):
        export_tables(stored_library, tmp_path / "x", "xlsx")


def test_export_csv_formulas_in_names_are_prefixed(tmp_path):
    motion = replace(dance(strides=1).motion, name="=HYPERLINK(1)")
    files = export_tables(Library.build([motion]), tmp_path / "out", "csv")
    (clips,) = (path for path in files if path.stem == "clips")
    with clips.open(newline="") as stream:
        names, first = list(csv.reader(stream))[:2]
    assert first[names.index("name")] == "'=HYPERLINK(1)"


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
