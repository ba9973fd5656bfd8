"""Properties of exported tables."""

import csv

import numpy as np
import pytest

from mograft.library.export import export_tables, library_tables


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet"])
def test_export_tables_hold_library_tables(stored_library, tmp_path, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow", reason="needs the extra parquet")
    tables = library_tables(stored_library)
    files = export_tables(stored_library, tmp_path / "out", kind)
    if kind == "npz":
        read = np.load(files[0], allow_pickle=False)
        got = {table: {c: read[f"{table}/{c}"] for c in tables[table]} for table in tables}
    elif kind == "csv":
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
