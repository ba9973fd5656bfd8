"""Every bench runs to its end on a small input."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMES = sorted(path.stem for path in ROOT.glob("benches/[!_]*.py"))
MARKS = {"view": pytest.mark.browser, "studio": pytest.mark.browser, "growth": pytest.mark.thorough}
BENCHES = [pytest.param(name, marks=MARKS.get(name, ())) for name in NAMES]


def import_bench(name):
    """Import a bench; skip the test if a package that it needs is not installed."""
    try:
        return importlib.import_module(f"benches.{name}")
    except ModuleNotFoundError as error:
        if error.name.split(".")[0] in ("mograft", "benches", "tests"):
            raise
        pytest.skip(f"{error.name} is not installed")


@pytest.mark.parametrize("name", BENCHES)
def test_bench_tiny_run_completes_without_output(name, capsys):
    assert not import_bench(name).main(["--tiny"])
    assert capsys.readouterr().out == ""


def test_timing_bench_debug_build_is_refused(monkeypatch):
    monkeypatch.setattr("benches._common._core.BUILD_PROFILE", "debug")
    with pytest.raises(SystemExit, match="refusing to time a debug build"):
        import_bench("bvh").main([])
