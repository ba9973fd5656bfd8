"""`mograft completion` and `mograft doctor`."""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import mograft
from mograft.cli import main

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
SHELLS = {
    "bash": "source {script}; COMP_WORDS=({words}); COMP_CWORD={at}; "
    "COMP_LINE='{line}'; COMP_POINT=${{#COMP_LINE}}; _shtab_mograft; "
    'printf "%s\\n" "${{COMPREPLY[@]}}"',
    "fish": "source {script}; complete -C '{line}'",
}


@pytest.mark.parametrize("shell", sorted(SHELLS))
@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("mograft gr", {"graft", "groups"}),
        ("mograft graft --vari", {"--variety"}),
        ("mograft graft --set tor", {"torso=world", "torso=pelvis"}),
        ("mograft lib ve", {"verify"}),
        ("mograft graft --preset p", {"paper", "paper-rms"}),
    ],
)
def test_completion_shells_complete_commands_options_and_choices(
    run, working_folder, shell, line, wanted
):
    pytest.importorskip("shtab", reason="shtab is not installed")
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (working_folder / "script").write_text(run("completion", shell)[1])
    words = line.split(" ")
    code = SHELLS[shell].format(
        script=working_folder / "script", words=" ".join(words), at=len(words) - 1, line=line
    )
    completed = subprocess.run([shell, "-c", code], capture_output=True, text=True, check=False)
    # fish appends a description to each word.
    found = {line.split("\t")[0] for line in completed.stdout.split("\n") if line}
    assert wanted <= found, completed.stderr
    assert all(word.startswith(words[-1]) for word in found)


def test_completion_missing_shtab_names_extra(fail, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert "pip install 'mograft[completion]'" in fail(1, "completion", "bash")


def checks(capsys, code):
    assert main(["doctor", "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mograft.doctor/1"
    assert document["ok"] == (code == 0)
    return {check["what"]: check for check in document["checks"]}


def test_doctor_complete_installation_returns_0(capsys):
    found = checks(capsys, 0)
    assert found["mograft"]["detail"] == mograft.__version__
    assert found["numpy"] == {"what": "numpy", "state": "ok", "detail": metadata.version("numpy")}
    assert found["a graft"]["detail"] == "300 frames created"
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out.startswith(f"ok      mograft: {mograft.__version__}\n")


@pytest.mark.parametrize(
    ("name", "state", "code", "source"),
    [
        ("numpy", "broken", 1, "numpy"),
        ("shtab", "absent", 0, "shtab"),
        ("mograft-fbx", "absent", 0, "./python-fbx in a checkout"),
    ],
)
def test_doctor_absent_package_state_and_exit_code(capsys, monkeypatch, name, state, code, source):
    real = metadata.version

    def version(package):
        if package == name:
            raise metadata.PackageNotFoundError(package)
        return real(package)

    monkeypatch.setattr(metadata, "version", version)
    found = checks(capsys, code)[name]
    assert found["state"] == state
    assert found["detail"].endswith(f": pip install {source}")


def test_doctor_lists_the_packages_of_all_extras_of_commands(capsys):
    extras = tomllib.loads(PROJECT.read_text())["project"]["optional-dependencies"].items()
    needed = [own for name, each in extras if name not in ("dask", "docs", "test") for own in each]
    assert checks(capsys, 0).keys() >= {re.match(r"[\w-]+", own)[0] for own in needed}


def test_doctor_failing_graft_is_broken(capsys, monkeypatch):
    def fail(*_):
        raise RuntimeError("no kernels")

    monkeypatch.setattr("mograft.synthesis.graft.graft", fail)
    assert checks(capsys, 1)["a graft"]["detail"] == "RuntimeError: no kernels"
