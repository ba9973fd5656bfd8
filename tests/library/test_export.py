"""Properties of exported tables."""

import csv
import importlib
from dataclasses import replace

import numpy as np
import pytest

from mograft.library.data import library_tables
from mograft.library.export import export_tables


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
