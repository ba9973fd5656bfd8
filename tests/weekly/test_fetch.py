"""Downloads of the tests: one version, and a hash that npm checks."""

import base64
import json
import re
import shutil
import subprocess

import pytest

from tests import fetch


def test_lock_pins_one_version_and_hash_for_each_package():
    wanted = json.loads((fetch.LOCKED / "package.json").read_text(encoding="utf-8"))
    lock = json.loads((fetch.LOCKED / "package-lock.json").read_text(encoding="utf-8"))
    packages = {name: entry for name, entry in lock["packages"].items() if name}
    for name, version in wanted["dependencies"].items():
        assert re.fullmatch(r"[0-9][\w.-]*", version), "ranges would install another version later"
        assert packages[f"node_modules/{name}"]["version"] == version == fetch.locked_version()
    for entry in packages.values():
        kind, _, digest = entry["integrity"].partition("-")
        assert (kind, len(base64.b64decode(digest))) == ("sha512", 64)


def test_validator_without_npm_is_skipped_with_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(fetch, "NODE_MODULES", tmp_path / "node_modules")
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    assert fetch._validator() == "skipped: npm is not installed"


def test_validator_other_version_is_installed_again(tmp_path, monkeypatch):
    package = tmp_path / "node_modules" / "gltf-validator"
    package.mkdir(parents=True)
    monkeypatch.setattr(fetch, "FETCHED", tmp_path)
    monkeypatch.setattr(fetch, "NODE_MODULES", tmp_path / "node_modules")
    monkeypatch.setattr(fetch.shutil, "which", lambda name: name)
    monkeypatch.setattr(fetch, "install_locked", lambda *_: "installed")
    for version, outcome in (("1.0", "installed"), (fetch.locked_version(), "in ")):
        (package / "package.json").write_text(json.dumps({"version": version}))
        assert outcome in fetch._validator()


@pytest.mark.thorough
def test_npm_refuses_download_with_another_hash(tmp_path):
    npm = shutil.which("npm")
    if npm is None or subprocess.run([npm, "ping"], capture_output=True, check=False).returncode:
        pytest.skip("npm or its registry cannot be reached")
    source, good, bad = (tmp_path / name for name in ("source", "good", "bad"))
    shutil.copytree(fetch.LOCKED, source)
    good.mkdir()
    bad.mkdir()
    assert fetch.install_locked(npm, good, source) == "installed"
    lock = source / "package-lock.json"
    text = lock.read_text(encoding="utf-8")
    lock.write_text(text.replace("sha512-od", "sha512-oe"), encoding="utf-8")
    shutil.rmtree(tmp_path / "cache", ignore_errors=True)
    assert fetch.install_locked(npm, bad, source).startswith("skipped")
    assert not (bad / "node_modules" / "gltf-validator" / "package.json").exists()
