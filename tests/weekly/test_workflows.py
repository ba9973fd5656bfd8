"""Workflows, the conda recipe, the Dockerfile and downloads state what exists in the project."""

import base64
import json
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from release.__main__ import STEPS
from release.build import PLATFORMS
from release.distributions import DISTRIBUTIONS, ROOT
from tests import fetch

SET_UP = ("rustup toolchain install", "rustup target add", "python -m pip install")
MODULES = ("tests", "release", "release.links", "release.tag")
BIN = Path(sys.executable).parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def read_text(name):
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def yaml():
    return pytest.importorskip("yaml", reason="PyYAML is not installed")


def test_workflow_commands_are_scripts_of_the_repository_with_steps_that_exist(yaml):
    steps = set()
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values()
        for text in [step.get("run", "") for job in jobs for step in job.get("steps", ())]:
            # Expressions of the workflow become one word.
            words = shlex.split(re.sub(r"\$\{\{.*?\}\}", "VALUE", text))
            if not text or text.startswith(SET_UP):
                continue
            assert words[0] in ("python", "python3"), words
            assert words[1] == "-m", words
            assert words[2] in MODULES, words
            if words[2] == "release":
                line = " ".join(words[4:]).replace("--strict ", "")
                steps |= set(re.sub(r"--(platform|interpreter|python) \S+", "", line).split())
    # Debian's Pythons and QEMU replace runners that the workflows have.
    assert steps == set(STEPS) - {"try-pythons", "try-aarch64", "check-targets"}
    wheels = read_text(".github/workflows/wheels.yml")
    assert all(f"name: {platform.name}" in wheels for platform in PLATFORMS)


@pytest.mark.parametrize("words", [["actionlint"], ["hadolint", "Dockerfile"]], ids=lambda w: w[0])
def test_workflows_and_dockerfile_are_accepted_by_linters(words):
    program = shutil.which(words[0], path=BIN) or shutil.which(words[0])
    if program is None:
        pytest.skip(f"{words[0]} is not installed")
    command = [program, *words[1:]]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout


def test_recipe_states_version_and_requirements_of_project(yaml):
    recipe, project = yaml.safe_load(read_text("conda/recipe.yaml")), PROJECT["project"]
    assert recipe["context"]["version"] == DISTRIBUTIONS[0].version
    assert f">={recipe['context']['python_min']}" == project["requires-python"]
    lists = (recipe["requirements"][name] for name in ("host", "run"))
    host, needed = ({word.replace(" ", "") for word in words} for words in lists)
    assert set(project["dependencies"]) == needed - {"python"}
    assert set(PROJECT["build-system"]["requires"]) <= host
    points = recipe["build"]["python"]["entry_points"]
    assert points == [f"{name} = {target}" for name, target in project["scripts"].items()]
    assert recipe["about"]["license_file"] == project["license-files"]


@pytest.mark.parametrize("folder", [".", "python-fbx"])
def test_files_of_image_suffice_for_source_distribution(tmp_path, folder):
    maturin = BIN / "maturin"
    if not maturin.exists() or shutil.which("cargo") is None:
        pytest.skip("maturin or cargo is not installed")
    first, *lines = read_text(".dockerignore").split()
    assert first == "*"
    ignored = [line.removeprefix("**/") for line in lines if line.startswith("**/")]
    for source in [ROOT / line[1:] for line in lines if line.startswith("!")]:
        if source.is_dir():
            ignore = shutil.ignore_patterns(*ignored)
            shutil.copytree(source, tmp_path / source.name, ignore=ignore)
        else:
            shutil.copy(source, tmp_path)
    words = [maturin, "sdist", "--out", tmp_path / "out"]
    subprocess.run(words, cwd=tmp_path / folder, check=True, capture_output=True)
    (sdist,) = (tmp_path / "out").iterdir()
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"Cargo.lock", "LICENSE", "THIRD-PARTY-LICENSES.txt"} <= names


def test_lock_of_downloads_pins_one_version_and_hash_for_each_package():
    wanted, lock = (
        json.loads((fetch.LOCKED / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("package", "package-lock")
    )
    packages = {name: entry for name, entry in lock["packages"].items() if name}
    for name, version in wanted["dependencies"].items():
        assert re.fullmatch(r"[0-9][\w.-]*", version), "ranges would install another version later"
        assert packages[f"node_modules/{name}"]["version"] == version
    for entry in packages.values():
        kind, _, digest = entry["integrity"].partition("-")
        assert (kind, len(base64.b64decode(digest))) == ("sha512", 64)
