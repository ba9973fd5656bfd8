"""The notebook on data sets runs from top to bottom."""

import json
from pathlib import Path

import numpy as np

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs/notebooks/datasets.ipynb"


def test_notebook_runs_in_a_new_folder(tmp_path, monkeypatch):
    document = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    names = {}
    for cell in document["cells"]:
        assert not cell.get("outputs")
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), str(NOTEBOOK), "exec"), names)
    assert names["batch"].shape == (4, 60, 18, 4)
    clips = {own.clip for own in names["hits"]}
    assert clips <= set(names["library"].names)
    assert len(names["hits"]) == 3
    assert set(names["choice"].kept) <= set(names["library"].names)
    is_trained = np.isin(names["library"].names, ["p0", "p1"])
    assert np.array_equal(names["windows"].part.clips, is_trained)
    assert len(names["table"]["id"]) == len(names["library"].segments)
