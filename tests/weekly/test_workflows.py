"""The workflows run scripts of the repository, with steps and options that exist."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from release.__main__ import STEPS
from release.build import PLATFORMS
from release.distributions import ROOT
from release.links import make_absolute
from release.tag import find_other_versions

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
SET_UP = ("rustup toolchain install", "rustup target add", "python -m pip install")
MODULES = ("tests", "release", "release.links", "release.tag")


def read(name):
    return yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yml").read_text())


def list_commands(document):
    """Return the commands of all jobs as words; expressions of the workflow become one word."""
    texts = [
        step["run"]
        for job in document["jobs"].values()
        for step in job.get("steps", ())
        if "run" in step
    ]
    return [shlex.split(re.sub(r"\$\{\{.*?\}\}", "VALUE", text)) for text in texts]


@pytest.mark.parametrize("path", WORKFLOWS, ids=[path.stem for path in WORKFLOWS])
def test_workflow_commands_are_scripts_of_the_repository(path):
    for words in list_commands(yaml.safe_load(path.read_text(encoding="utf-8"))):
        if " ".join(words).startswith(SET_UP):
            continue
        assert words[0] in ("python", "python3"), words
        assert words[1] == "-m", words
        assert words[2] in MODULES, words


def test_workflow_release_commands_name_steps_and_platforms():
    matrices = [
        job["strategy"]["matrix"] for job in read("wheels")["jobs"].values() if "strategy" in job
    ]
    names = [platform["name"] for matrix in matrices for platform in matrix["platform"]]
    names += [
        row["platform"]
        for row in read("ci")["jobs"]["free-threaded"]["strategy"]["matrix"]["include"]
    ]
    assert set(names) <= {platform.name for platform in PLATFORMS}
    assert {platform.name for platform in PLATFORMS} <= set(names)
    found = set()
    for path in WORKFLOWS:
        for words in list_commands(yaml.safe_load(path.read_text(encoding="utf-8"))):
            if words[1:3] != ["-m", "release"]:
                continue
            assert words[3] == "--dry-run"
            steps = [word for word in words[4:] if word != "--strict"]
            while "--" in " ".join(steps):  # an option has one value
                index = next(i for i, word in enumerate(steps) if word.startswith("--"))
                assert steps[index] in ("--platform", "--interpreter", "--python")
                del steps[index : index + 2]
            assert set(steps) <= set(STEPS)
            found |= set(steps)
    # Debian's Pythons and QEMU replace runners that the workflows have.
    assert found == set(STEPS) - {"try-pythons", "try-aarch64", "check-targets"}


def test_test_workflow_runs_every_python_on_three_systems():
    jobs = read("ci")["jobs"]
    matrix = jobs["tests"]["strategy"]["matrix"]
    systems = {"ubuntu-latest", "windows-latest", "macos-latest"}
    assert set(matrix["system"]) == systems
    assert matrix["python"] == ["3.11", "3.12", "3.13", "3.14"]
    rows = jobs["free-threaded"]["strategy"]["matrix"]["include"]
    assert {row["system"] for row in rows} == systems


def test_thorough_workflow_runs_thorough_tests_every_week_and_by_hand():
    workflow = read("thorough")
    starts = workflow[True]  # YAML 1.1 reads the key `on` as a boolean
    (schedule,) = starts["schedule"]
    minute, hour, *days, weekday = schedule["cron"].split()
    assert days == ["*", "*"]
    assert all(field.isdecimal() for field in (minute, hour, weekday))
    assert "workflow_dispatch" in starts
    (job,) = workflow["jobs"].values()
    assert job["timeout-minutes"] <= 360, "GitHub ends every job after six hours"
    commands = list_commands(workflow)
    assert commands[-2:] == [
        ["python", "-m", "pip", "install", "-e", ".[test]"],
        ["python", "-m", "tests", "--thorough"],
    ]


def test_audit_job_fails_on_skipped_parts():
    (command,) = list_commands({"jobs": {"audit": read("ci")["jobs"]["audit"]}})[-1:]
    assert "audit" in command
    assert "--strict" in command


def test_release_workflow_publishes_without_stored_password():
    jobs = read("release")["jobs"]
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert jobs["publish"]["needs"] == "wheels"
    assert jobs["wheels"]["needs"] == "version"
    assert "secrets" not in (ROOT / ".github" / "workflows" / "release.yml").read_text()


def test_thorough_suite_runs_all_steps_of_a_release():
    text = (ROOT / "tests" / "__main__.py").read_text(encoding="utf-8")
    assert '("release", [PYTHON, "-m", "release", "--dry-run"])' in text


def test_actionlint_accepts_workflows():
    program = Path(sys.executable).with_name("actionlint")
    found = str(program) if program.exists() else shutil.which("actionlint")
    if found is None:
        pytest.skip("actionlint is not installed")
    process = subprocess.run([found], cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout


def write_versions(root, version, **other):
    """Write the files that state a version; `other` gives another one by the stem of the file."""
    (root / "python-fbx").mkdir()
    (root / "conda").mkdir()
    for name, text in {
        "Cargo.toml": 'rust-version = "1.89"\nversion = "{}"\n',
        "python-fbx/Cargo.toml": 'version = "{}"\n',
        "conda/recipe.yaml": 'context:\n  version: "{}"\n',
        "CHANGELOG.md": "# Changelog\n\n## Unreleased\n\n## {} - 2026-12-01\n",
    }.items():
        (root / name).write_text(text.format(other.get(name, version)), encoding="utf-8")


def test_tag_with_version_of_all_files_has_no_other_versions(tmp_path):
    write_versions(tmp_path, "1.2.3")
    assert find_other_versions("v1.2.3", tmp_path) == []


@pytest.mark.parametrize(
    "name", ["Cargo.toml", "python-fbx/Cargo.toml", "conda/recipe.yaml", "CHANGELOG.md"]
)
@pytest.mark.parametrize("version", ["1.2.4", "1.2.30", "11.2.3", "1x2.3"])
def test_tag_with_version_other_than_a_file_names_the_file(tmp_path, name, version):
    write_versions(tmp_path, "1.2.3", **{name: version})
    assert find_other_versions("v1.2.3", tmp_path) == [name]


@pytest.mark.parametrize("tag", ["1.2.3", "v1.2", "v1.2.3rc1", "vv1.2.3", "v1.2.3\n"])
def test_tag_that_is_no_version_raises_value_error(tag):
    with pytest.raises(ValueError, match=r"tag must be vMAJOR\.MINOR\.PATCH"):
        find_other_versions(tag)


def test_tag_of_present_version_differs_from_changelog_at_most():
    version = (ROOT / "Cargo.toml").read_text(encoding="utf-8")
    tag = "v" + re.search(r'^version = "(.*)"$', version, re.MULTILINE)[1]
    assert set(find_other_versions(tag)) <= {"CHANGELOG.md"}


def test_links_of_readme_become_absolute():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    absolute = make_absolute(text, "https://host/owner/name", "v1.2.3")
    links = re.findall(r"^\[[\w-]+\]: (\S+)$", absolute, re.MULTILINE)
    assert all(link.startswith("https://host/owner/name/") for link in links)
    assert "https://host/owner/name/raw/v1.2.3/docs/demo.gif" in links
    assert re.findall(r"\]\((?!https://)[^)]*\)", text) == []
