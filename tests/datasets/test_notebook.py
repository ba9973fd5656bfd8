"""The notebook on data sets runs from top to bottom."""

import json
from pathlib import Path

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
    assert len(names["hits"]) == 3
