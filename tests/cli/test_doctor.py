"""`mograft doctor`: its checks and its exit code."""

import json
from importlib import metadata

import pytest

import mograft
from mograft.cli import main


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
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(found)
    assert lines[0] == f"ok      mograft: {mograft.__version__}"


@pytest.mark.parametrize(
    ("name", "state", "code"), [("numpy", "broken", 1), ("shtab", "absent", 0)]
)
def test_doctor_absent_package_state_and_exit_code(capsys, monkeypatch, name, state, code):
    real = metadata.version

    def version(package):
        if package == name:
            raise metadata.PackageNotFoundError(package)
        return real(package)

    monkeypatch.setattr(metadata, "version", version)
    found = checks(capsys, code)[name]
    assert found["state"] == state
    assert f"pip install {name}" in found["detail"]


def test_doctor_failing_graft_is_broken(capsys, monkeypatch):
    def fail(*_):
        raise RuntimeError("no kernels")

    monkeypatch.setattr("mograft.synthesis.graft.graft", fail)
    assert checks(capsys, 1)["a graft"]["detail"] == "RuntimeError: no kernels"
