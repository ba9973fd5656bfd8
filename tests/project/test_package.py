"""Imports of the package: no heavy modules for help, and all public names."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import mograft
from tests.running import run_python


@pytest.mark.parametrize("words", ["['--help']", "['--version']", "['graft', '--help']"])
def test_help_does_not_import_numpy(words):
    code = f"""
import sys
from mograft.cli import main
try:
    main({words})
except SystemExit as stop:
    print("code", stop.code)
heavy = {{"numpy", "matplotlib", "webbrowser", "sqlite3", "multiprocessing", "importlib.metadata"}}
heavy &= set(sys.modules)
print("heavy", *heavy)
"""
    assert run_python(code).split()[-3:] == ["code", "0", "heavy"]


def test_public_names_resolve_and_are_listed_by_dir():
    code = """
import mograft
names = list(mograft.__all__)
assert set(names) <= set(dir(mograft))
print(*(name for name in names if getattr(mograft, name) is None))
import mograft.viewing.page, mograft.analysis.segmentation
print(mograft.view.__name__, mograft.segment.__name__)
"""
    assert run_python(code).split() == ["view", "segment"]
    assert sorted(set(mograft.__all__)) == sorted(mograft.__all__)


def test_stub_imports_match_lazy_table():
    # `__init__.pyi` repeats the lazy table for type checkers.
    import ast

    tree = ast.parse(Path(mograft.__file__).with_suffix(".pyi").read_text("utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    imported = {alias.asname: node.module for node in imports for alias in node.names}
    declared = {name: f"mograft.{home}" for name, home in mograft._HOME_OF.items()}
    declared |= {name: path.rpartition(".")[0] for name, path in mograft._MODULES.items()}
    assert imported == declared
    assert set(mograft.__all__) <= set(imported) | {"__version__"}


def test_unknown_attribute_raises_attribute_error():
    with pytest.raises(AttributeError, match="module 'mograft' has no attribute 'wings'"):
        _ = mograft.wings


def test_closed_output_pipe_ends_without_message(tmp_path):
    from mograft import write_bvh
    from mograft.dancer import dance

    write_bvh(dance(strides=1).motion[:20], tmp_path / "a.bvh")
    read_end, write_end = os.pipe()
    os.close(read_end)
    words = [sys.executable, "-m", "mograft", "groups", tmp_path / "a.bvh"]
    with open(write_end, "wb") as closed:
        pipes = {"stdout": closed, "stderr": subprocess.PIPE}
        process = subprocess.run(words, text=True, check=False, **pipes)
    assert (process.returncode, process.stderr) == (1, "")
