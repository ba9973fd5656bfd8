"""The package `mograft_linkage` by itself: imports, README, and its wheel in a new environment."""

import ast
import doctest
import importlib.util
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from mograft._standalone import mograft_linkage
from tests.running import run_python

ROOT = Path(__file__).resolve().parents[2]
PROJECT = ROOT / "python" / "mograft" / "_standalone"
MODULES = sorted((PROJECT / "mograft_linkage").glob("*.py"))


def absolute_imports(path):
    """Return the top-level packages that a module imports absolutely."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module)
    return {name.partition(".")[0] for name in names}


@pytest.mark.parametrize("path", MODULES, ids=[path.stem for path in MODULES])
def test_modules_import_numpy_and_standard_library_only(path):
    allowed = {"numpy"}
    if path.stem == "_kernels":
        allowed |= {"mograft"}  # the extension module
    if path.stem == "estimator":
        allowed |= {"sklearn"}  # in a method that only scikit-learn calls
    assert absolute_imports(path) - allowed <= sys.stdlib_module_names


def test_readme_examples_run(monkeypatch, tmp_path):
    """The package is that which mograft contains."""
    pytest.importorskip("seaborn", reason="seaborn is not installed")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "mograft_linkage", mograft_linkage)
    result = doctest.testfile(str(PROJECT / "README.md"), module_relative=False)
    pyplot.close("all")
    assert result.attempted > 15
    assert not result.failed


def test_readme_names_every_public_name():
    text = (PROJECT / "README.md").read_text(encoding="utf-8")
    names = {*mograft_linkage.__all__, *mograft_linkage.dendrogram.__all__}
    for name in names - {"__version__", "TruncatedTree"}:
        assert re.search(rf"`{name}\b|\b{name}`", text), name


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """Build the wheels of both distributions; return their paths by name."""
    if shutil.which("cargo") is None or importlib.util.find_spec("maturin") is None:
        pytest.skip("needs cargo and maturin")
    folder = tmp_path_factory.mktemp("wheels")
    for project in (ROOT, PROJECT):
        command = [sys.executable, "-m", "maturin", "build", "--out", str(folder)]
        subprocess.run([*command, "--interpreter", sys.executable], cwd=project, check=True)
    return {path.name.partition("-")[0]: path for path in folder.glob("*.whl")}


def files_of(wheel):
    return [name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name]


@pytest.mark.thorough
def test_wheels_share_modules_and_no_file_name(wheels):
    whole, slim = files_of(wheels["mograft"]), files_of(wheels["mograft_linkage"])
    assert not set(whole) & set(slim)
    inside = "mograft/_standalone/"
    contained = {name.removeprefix(inside) for name in whole if name.startswith(inside)}
    assert contained - {"__init__.py"} == {name for name in slim if "_core.abi3" not in name}
    one, two = (zipfile.ZipFile(wheels[name]) for name in ("mograft", "mograft_linkage"))
    for name in contained - {"__init__.py"}:
        assert one.read(inside + name) == two.read(name), name


@pytest.mark.thorough
def test_wheel_needs_and_imports_numpy_only(wheels, tmp_path):
    with zipfile.ZipFile(wheels["mograft_linkage"]) as wheel:
        wheel.extractall(tmp_path)
    (metadata,) = tmp_path.glob("*.dist-info/METADATA")
    needed = re.findall(r"^Requires-Dist: (\w+)(?!.*extra ==)", metadata.read_text("utf-8"), re.M)
    assert needed == ["numpy"]
    code = "import sys, numpy; old = {*sys.modules}; import mograft_linkage; "
    code += "print(*{*sys.modules} - old)"
    modules = run_python(code, cwd=tmp_path).split()
    added = {name.partition(".")[0] for name in modules}
    assert added <= {"mograft_linkage", "numpy", *sys.stdlib_module_names}
    assert " ".join(modules).count("mograft_linkage") == len(MODULES) + 1
