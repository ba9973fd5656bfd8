"""The zip of the Blender extension: its content, its bytes and what is refused.

`tests.weekly.blender` checks the extension in Blender.
"""

import ast
import inspect
import tomllib
import zipfile
from functools import reduce
from importlib import import_module

import pytest

import mograft as mg
from release.blender import SOURCES, build, check_imports, main

NAME = "mograft-1.2.3-cp311-abi3-{}.whl"


def make_wheel(folder, system):
    wheel = folder / NAME.format(system)
    wheel.write_bytes(b"wheel")
    return wheel


@pytest.mark.parametrize(
    ("system", "platforms"),
    [
        ("manylinux_2_17_x86_64.manylinux2014_x86_64", ["linux-x64"]),
        ("manylinux_2_35_x86_64", ["linux-x64"]),
        ("win_amd64", ["windows-x64"]),
        (
            "macosx_10_12_x86_64.macosx_11_0_arm64.macosx_10_12_universal2",
            ["macos-arm64", "macos-x64"],
        ),
    ],
)
def test_build_wheel_gives_zip_of_its_platform(tmp_path, system, platforms):
    wheel = make_wheel(tmp_path, system)
    with zipfile.ZipFile(build(wheel, tmp_path / "dist")) as archive:
        names = set(archive.namelist())
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        assert archive.read(f"wheels/{wheel.name}") == wheel.read_bytes()
        assert archive.read("LICENSE").lstrip().startswith(b"GNU GENERAL PUBLIC LICENSE")
    modules = {path.name for path in SOURCES.glob("*.py")}
    assert names == {"LICENSE", "blender_manifest.toml", f"wheels/{wheel.name}", *modules}
    assert manifest["platforms"] == platforms
    assert manifest["version"] == "1.2.3"
    assert manifest["wheels"] == [f"./wheels/{wheel.name}"]
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]


def test_build_same_wheel_gives_same_bytes(tmp_path):
    wheel = make_wheel(tmp_path, "win_amd64")
    first, second = (build(wheel, tmp_path / name) for name in "ab")
    assert first.read_bytes() == second.read_bytes()
    assert [path.name for path in first.parent.iterdir()] == [first.name]


@pytest.mark.parametrize(
    "name",
    [
        NAME.format("linux_riscv64"),
        "mograft-1.2.3-cp311-cp311-win_amd64.whl",
        "mograft_linkage-1.2.3-cp311-abi3-win_amd64.whl",
        "mograft-1.2.3.tar.gz",
    ],
)
def test_main_other_wheel_is_refused_and_nothing_written(tmp_path, capsys, name):
    (tmp_path / name).write_bytes(b"")
    assert main([str(tmp_path / name), "-o", str(tmp_path / "dist")]) == 1
    assert name in capsys.readouterr().err
    assert not (tmp_path / "dist").exists()


@pytest.mark.parametrize(
    "line", ["import socket", "from urllib.request import urlopen", "import os"]
)
def test_check_imports_connections_and_processes_are_refused(tmp_path, line):
    module = tmp_path / "module.py"
    module.write_text(f"import bpy\n\ndef call():\n    {line}\n")
    with pytest.raises(ValueError, match=r"module.py:4: \S+ is not an allowed import"):
        check_imports(module)


def names_of_mograft(tree):
    """The names that a module imports from mograft, and their objects."""
    for own in ast.walk(tree):
        if isinstance(own, ast.Import):
            aliases = [alias for alias in own.names if alias.name == "mograft"]
            yield from ((alias.asname, mg) for alias in aliases)
        elif isinstance(own, ast.ImportFrom) and not own.level and "mograft" in own.module:
            module = import_module(own.module)
            yield from ((alias.name, getattr(module, alias.name)) for alias in own.names)


@pytest.mark.parametrize("name", ["armature", "change", "grafting", "groups", "scene_constraints"])
def test_calls_of_mograft_fit_the_signatures_of_its_functions(name):
    tree = ast.parse((SOURCES / f"{name}.py").read_text(encoding="utf-8"))
    known, n_checked = dict(names_of_mograft(tree)), 0
    for call in (own for own in ast.walk(tree) if isinstance(own, ast.Call)):
        first, *parts = ast.unparse(call.func).split(".")
        is_name = all(map(str.isidentifier, parts))
        if first in known and is_name and parts != ["ProvenanceError"]:
            signature = inspect.signature(reduce(getattr, parts, known[first]))
            given = [own for own in call.args if not isinstance(own, ast.Starred)]
            options = {own.arg: own for own in call.keywords if own.arg}
            is_whole = len(given) + len(options) == len(call.args) + len(call.keywords)
            (signature.bind if is_whole else signature.bind_partial)(*given, **options)
            n_checked += 1
    assert n_checked
