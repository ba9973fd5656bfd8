"""The zip of the Blender extension: its content, its bytes and what is refused.

`tests.weekly.blender` checks the extension in Blender.
"""

import tomllib
import zipfile

import pytest

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
