"""The release scripts: notices match the crates, and each check refuses a defect."""

import io
import json
import os
import shutil
import subprocess
import tarfile
import zipfile
from contextlib import redirect_stdout

import pytest
from hypothesis import given
from hypothesis import strategies as st

from release import audits, checks, trials
from release.__main__ import STEPS, main
from release.checks import check_sdist, check_wheel
from release.crates import read_crates
from release.distributions import DISTRIBUTIONS, MAX_WHEEL_BYTES
from release.notices import find_stale_notices, render_bill, render_licences


def runs_cargo():
    """Return whether cargo is installed and runs; that of rustup needs a home folder."""
    cargo = shutil.which("cargo")
    if cargo is None:
        return False
    return not subprocess.run([cargo, "--version"], capture_output=True, check=False).returncode


needs_cargo = pytest.mark.skipif(not runs_cargo(), reason="cargo is not installed or does not run")
MOGRAFT = DISTRIBUTIONS[0]
INFO = f"mograft-{MOGRAFT.version}.dist-info"
NOTICES = {
    f"{INFO}/licenses/THIRD-PARTY-LICENSES.txt": MOGRAFT.licences.read_bytes(),
    f"{INFO}/sboms/mograft.cdx.json": MOGRAFT.bill.read_bytes(),
}


@needs_cargo
def test_notices_match_locked_crates():
    assert find_stale_notices() == [], "run: python -m release.notices --write"


@needs_cargo
@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda d: d.name)
def test_bill_lists_every_linked_crate_and_no_macro(distribution):
    crates = read_crates(distribution)
    bill = json.loads(render_bill(distribution, crates))
    components = {part["bom-ref"] for part in bill["components"]}
    assert {f"pkg:cargo/{c.name}@{c.version}" for c in crates} < components
    assert {"pkg:pypi/numpy"} == {ref for ref in components if "pypi" in ref}
    known = components | {bill["metadata"]["component"]["bom-ref"]}
    for entry in bill["dependencies"]:
        assert {entry["ref"], *entry["dependsOn"]} <= known
    reached, waiting = set(), [bill["metadata"]["component"]["bom-ref"]]
    links = {entry["ref"]: entry["dependsOn"] for entry in bill["dependencies"]}
    while waiting:
        ref = waiting.pop()
        if ref not in reached:
            reached.add(ref)
            waiting += links.get(ref, [])
    assert reached == known
    names = {crate.name for crate in crates}
    assert {"pyo3", "numpy"} <= names
    assert not {"syn", "quote", "pyo3-macros", "pyo3-build-config", "proptest"} & names


@needs_cargo
@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda d: d.name)
def test_licences_hold_a_section_with_text_for_each_crate(distribution):
    crates = [c for c in read_crates(distribution) if c.checksum is not None]
    sections = render_licences(distribution, crates).split("=" * 80 + "\n")[2:]
    assert [s.partition(",")[0] for s in sections] == [crate.key for crate in crates]
    for section in sections:
        assert "Copyright" in section or "Permission is hereby granted" in section
        assert 'AS IS"' in section


def fail():
    raise ValueError("a defect")


OUTCOMES = {"passes": lambda: None, "skips": lambda: ["a part: no network"], "fails": fail}


@given(st.lists(st.sampled_from(sorted(OUTCOMES)), min_size=1, max_size=len(STEPS)), st.booleans())
def test_main_lists_skipped_parts_and_fails_as_strict_demands(outcomes, is_strict):
    steps = {
        name: ("text", lambda _, run=OUTCOMES[outcome]: run())
        for name, outcome in zip(STEPS, outcomes, strict=False)
    }
    words = ["--dry-run", *steps, *(["--strict"] if is_strict else [])]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as printed:
        patch.setattr("release.__main__.STEPS", steps)
        code = main(words)
    assert code == ("fails" in outcomes or (is_strict and "skips" in outcomes))
    lines = printed.getvalue().splitlines()
    for name, outcome in zip(steps, outcomes, strict=True):
        assert (f"skipped: {name}: a part: no network" in lines) == (outcome == "skips")
    assert ("all steps passed" in lines) == (set(outcomes) == {"passes"})


def write_program(path, text):
    if os.name != "posix":
        pytest.skip("the program is a shell script")
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)


@pytest.fixture
def write_pip_audit(tmp_path, monkeypatch):
    """A function that replaces pip-audit by a program which reports given packages."""
    monkeypatch.setattr(audits, "WORK", tmp_path / "work")
    monkeypatch.setattr(audits, "install_tools", lambda: tmp_path)

    def write(*packages):
        report = json.dumps({"dependencies": packages})
        write_program(tmp_path / "pip-audit", f"for file; do :; done; echo '{report}' > \"$file\"")

    return write


def test_audit_packages_without_advisories_reports_every_package_as_skipped(write_pip_audit):
    write_pip_audit({"name": "numpy", "skip_reason": "not found"})
    assert audits.audit_packages() == ["pip-audit: no advisories for 2 of 2 packages"]
    write_pip_audit({"name": "a", "skip_reason": "not found"}, {"name": "b", "vulns": []})
    assert audits.audit_packages() == ["pip-audit: no advisories for 2 of 4 packages"]


def test_audit_packages_with_vulnerability_raises_value_error(write_pip_audit):
    write_pip_audit({"name": "a", "vulns": []})
    assert audits.audit_packages() == []
    write_pip_audit({"name": "a", "vulns": [{"id": "PYSEC-1"}]})
    with pytest.raises(ValueError, match=r"known vulnerabilities: .*PYSEC-1"):
        audits.audit_packages()


@pytest.fixture
def write_cargo(tmp_path, monkeypatch):
    """A function that replaces cargo by a program with given ends of its checks."""
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}/usr/bin:/bin")
    write_program(tmp_path / "cargo-deny", "exit 1")

    def write(advisories, others="exit 0"):
        case = f'case "$*" in *advisories) {advisories};; *) {others};; esac'
        write_program(tmp_path / "cargo", case)

    return write


def test_audit_crates_without_database_reports_advisories_as_skipped(write_cargo):
    write_cargo("echo 'error: failed to fetch advisory database' >&2; exit 1")
    skipped = audits.audit_crates()
    assert len(skipped) == 2
    assert all("no advisories for" in line for line in skipped)
    write_cargo("exit 0")
    assert audits.audit_crates() == []


def test_audit_crates_with_defect_raises_error(write_cargo):
    write_cargo("echo 'error[vulnerability]: a crate' >&2; exit 1")
    with pytest.raises(ValueError, match=r"error\[vulnerability\]: a crate"):
        audits.audit_crates()
    write_cargo("exit 0", others="exit 4")
    with pytest.raises(subprocess.CalledProcessError):
        audits.audit_crates()


def test_audit_crates_without_cargo_deny_reports_it_as_skipped(monkeypatch):
    monkeypatch.setenv("PATH", os.devnull)
    assert audits.audit_crates() == ["cargo deny: not installed: cargo install cargo-deny --locked"]


def write_wheel(path, files):
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def test_check_wheel_complete_wheel_passes(tmp_path):
    check_wheel(MOGRAFT, write_wheel(tmp_path / "a.whl", NOTICES))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({f"{INFO}/licenses/THIRD-PARTY-LICENSES.txt": b"old"}, "must contain THIRD-PARTY"),
        ({f"{INFO}/sboms/mograft.cdx.json": b"{}"}, "must contain mograft.cdx.json"),
        ({"mograft/_core.abi3.so": b"\0/home/me/crate/src/lib.rs\0"}, "the path /home/me/crate"),
        ({"mograft/big": b"\0" * MAX_WHEEL_BYTES}, "the limit is 3,000,000"),
    ],
)
def test_check_wheel_defect_raises_value_error(tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        check_wheel(MOGRAFT, write_wheel(tmp_path / "a.whl", NOTICES | change))


@pytest.mark.parametrize("missing", [None, "LICENSE", "Cargo.lock", "mograft.cdx.json"])
def test_check_sdist_missing_file_raises_value_error(tmp_path, missing):
    names = {"LICENSE", "Cargo.lock", "mograft.cdx.json", "THIRD-PARTY-LICENSES.txt"} - {missing}
    with tarfile.open(tmp_path / "mograft-1.tar.gz", "w:gz") as archive:
        for name in names:
            archive.addfile(tarfile.TarInfo(f"mograft-1/{name}"))
    if missing is None:
        check_sdist(MOGRAFT, tmp_path / "mograft-1.tar.gz")
    else:
        with pytest.raises(ValueError, match=f"does not contain {missing}"):
            check_sdist(MOGRAFT, tmp_path / "mograft-1.tar.gz")


def test_check_platform_tag_older_name_raises_value_error(tmp_path, monkeypatch):
    tools = tmp_path / "tools"
    tools.mkdir()
    write_program(tools / "auditwheel", 'echo \'{"overall_tag": "manylinux_2_28_x86_64"}\'')
    monkeypatch.setattr(checks, "install_tools", lambda: tools)
    checks.check_platform_tag(tmp_path / "a-1-cp311-abi3-manylinux_2_28_x86_64.whl")
    with pytest.raises(ValueError, match="needs manylinux_2_28_x86_64"):
        checks.check_platform_tag(tmp_path / "a-1-cp311-abi3-manylinux_2_17_x86_64.whl")


def test_run_fresh_cargo_on_path_raises_value_error(tmp_path, monkeypatch):
    write_program(tmp_path / "cargo", "exit 0")
    monkeypatch.setattr(trials, "_SYSTEM_FOLDERS", (str(tmp_path),))
    with pytest.raises(ValueError, match="the environment without Rust contains"):
        trials.run_fresh(tmp_path, "python", "-V")
