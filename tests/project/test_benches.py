"""Benches: too slow to run here, but each still finds what it measures."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BENCHES = sorted((ROOT / "benches").glob("*.py"))


@pytest.mark.parametrize("path", BENCHES, ids=lambda path: path.stem)
def test_bench_imports_resolve(path):
    code = "import runpy, sys; sys.path.insert(0, 'benches'); runpy.run_path(sys.argv[1])"
    told = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    missing = told.stderr.rsplit("No module named ", 1)[-1].strip().strip("'").split(".")[0]
    if "ModuleNotFoundError" in told.stderr and missing not in ("mograft", "benches", "tests"):
        pytest.skip(f"{missing} is not installed")
    assert told.returncode == 0, told.stderr[-2000:]
