"""The conda recipe and the Dockerfile require what the project states."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from release.distributions import DISTRIBUTIONS, ROOT

RECIPE = ROOT / "conda" / "recipe.yaml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def read_recipe():
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    return yaml.safe_load(RECIPE.read_text(encoding="utf-8"))


def test_recipe_states_version_and_requirements_of_project():
    recipe = read_recipe()
    project = PROJECT["project"]
    assert recipe["context"]["version"] == DISTRIBUTIONS[0].version
    assert f">={recipe['context']['python_min']}" == project["requires-python"]
    without_spaces = {word.replace(" ", "") for word in recipe["requirements"]["run"]}
    assert set(project["dependencies"]) == without_spaces - {"python"}
    host = {word.replace(" ", "") for word in recipe["requirements"]["host"]}
    assert set(PROJECT["build-system"]["requires"]) <= host
    points = recipe["build"]["python"]["entry_points"]
    assert points == [f"{name} = {target}" for name, target in project["scripts"].items()]
    assert recipe["about"]["license_file"] == project["license-files"]


def test_recipe_renders_with_rattler_build():
    rattler_build = pytest.importorskip("rattler_build", reason="needs py-rattler-build")
    recipe = rattler_build.Stage0Recipe.from_yaml(RECIPE.read_text(encoding="utf-8"))
    compilers = "c_compiler: [gcc]\nrust_compiler: [rust]\nc_stdlib: [sysroot]\n"
    (rendered,) = recipe.render(rattler_build.VariantConfig.from_yaml(compilers))
    assert rendered.recipe.to_dict()["package"]["name"] == "mograft"


def test_dockerfile_is_accepted_by_hadolint():
    program = Path(sys.executable).with_name("hadolint")
    found = str(program) if program.exists() else shutil.which("hadolint")
    if found is None:
        pytest.skip("hadolint is not installed")
    process = subprocess.run(
        [found, "Dockerfile"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stdout


def copy_image_context(target):
    """Copy the files that `.dockerignore` lets into the image."""
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert lines[0] == "*"
    kept = [line[1:] for line in lines if line.startswith("!")]
    ignored = [line.removeprefix("**/") for line in lines if line.startswith("**/")]
    for name in kept:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, target / name, ignore=shutil.ignore_patterns(*ignored))
        else:
            shutil.copyfile(source, target / name)


@pytest.mark.parametrize("folder", [".", "python-fbx"])
def test_files_of_image_suffice_for_source_distribution(tmp_path, folder):
    maturin = Path(sys.executable).with_name("maturin")
    if not maturin.exists() or shutil.which("cargo") is None:
        pytest.skip("maturin or cargo is not installed")
    context, out = tmp_path / "context", tmp_path / "out"
    context.mkdir()
    copy_image_context(context)
    words = ["sdist", "--out", str(out)]
    subprocess.run([maturin, *words], cwd=context / folder, check=True, capture_output=True)
    (sdist,) = out.iterdir()
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"Cargo.lock", "LICENSE", "THIRD-PARTY-LICENSES.txt"} <= names


def test_dockerfile_uses_stages_and_folders_that_exist():
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    stages = set(re.findall(r"^FROM \S+ AS (\w+)$", text, re.MULTILINE))
    assert set(re.findall(r"--from=(\w+)", text)) == stages == {"build"}
    for path in re.findall(r" (\./[\w-]+)", text):
        assert (ROOT / path / "pyproject.toml").exists()
