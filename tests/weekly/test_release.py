"""The release scripts: notices match the crates, and each check refuses a defect."""

import json
import re
import shutil
import subprocess
import tarfile
import zipfile

import pytest

from release import audits
from release.__main__ import main
from release.checks import check_sdist, check_wheel
from release.crates import read_crates
from release.distributions import DISTRIBUTIONS, MAX_WHEEL_BYTES, ROOT
from release.links import make_absolute
from release.notices import find_stale_notices, render_bill, render_licences
from release.tag import find_other_versions

# Cargo of rustup needs a home folder.
has_cargo = (
    shutil.which("cargo")
    and not subprocess.run(["cargo", "--version"], capture_output=True, check=False).returncode
)
needs_cargo = pytest.mark.skipif(not has_cargo, reason="cargo is not installed or does not run")
every_distribution = pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda d: d.name)
MOGRAFT = DISTRIBUTIONS[0]
INFO = f"mograft-{MOGRAFT.version}.dist-info"
NOTICES = {
    f"{INFO}/licenses/THIRD-PARTY-LICENSES.txt": MOGRAFT.licences.read_bytes(),
    f"{INFO}/sboms/mograft.cdx.json": MOGRAFT.bill.read_bytes(),
}
SDIST = {"LICENSE", "Cargo.lock", "mograft.cdx.json", "THIRD-PARTY-LICENSES.txt"}
VERSIONED = {
    "Cargo.toml": 'rust-version = "1.89"\nversion = "{}"\n',
    "python-fbx/Cargo.toml": 'version = "{}"\n',
    "conda/recipe.yaml": 'context:\n  version: "{}"\n',
    "CHANGELOG.md": "# Changelog\n\n## Unreleased\n\n## {} - 2026-12-01\n",
}


@needs_cargo
def test_notices_match_locked_crates():
    assert find_stale_notices() == [], "run: python -m release.notices --write"


@needs_cargo
@every_distribution
def test_bill_lists_every_linked_crate_and_no_macro(distribution):
    crates = read_crates(distribution)
    bill = json.loads(render_bill(distribution, crates))
    components = {part["bom-ref"] for part in bill["components"]}
    assert components == {"pkg:pypi/numpy", *(f"pkg:cargo/{c.name}@{c.version}" for c in crates)}
    links = {entry["ref"]: entry["dependsOn"] for entry in bill["dependencies"]}
    root = bill["metadata"]["component"]["bom-ref"]
    assert {root}.union(*links.values()) == components | {root} == set(links) | {"pkg:pypi/numpy"}
    names = {crate.name for crate in crates}
    assert {"pyo3", "numpy"} <= names
    assert not {"syn", "quote", "pyo3-macros", "pyo3-build-config", "proptest"} & names


@needs_cargo
@every_distribution
def test_licences_hold_a_section_with_text_for_each_crate(distribution):
    crates = [c for c in read_crates(distribution) if c.checksum is not None]
    sections = render_licences(distribution, crates).split("=" * 80 + "\n")[2:]
    assert [s.partition(",")[0] for s in sections] == [crate.key for crate in crates]
    for section in sections:
        assert "Copyright" in section or "Permission is hereby granted" in section
        assert 'AS IS"' in section


@pytest.mark.parametrize(("is_strict", "fails"), [(False, False), (True, False), (False, True)])
def test_main_lists_skipped_parts_and_fails_as_strict_demands(
    monkeypatch, capsys, is_strict, fails
):
    def audit(_options):
        if fails:
            raise ValueError("a defect")

    steps = {"docs": ("text", lambda _: ["a part: no network"]), "audit": ("text", audit)}
    monkeypatch.setattr("release.__main__.STEPS", steps)
    assert main(["--dry-run", *steps, *(["--strict"] if is_strict else [])]) == is_strict + fails
    lines = capsys.readouterr().out.splitlines()
    assert "skipped: docs: a part: no network" in lines
    assert ("failed: audit" in lines) == fails
    assert "all steps passed" not in lines


@pytest.fixture
def run_programs(tmp_path, monkeypatch):
    """A function that replaces pip-audit, cargo and cargo-deny by shell scripts."""
    if not shutil.which("sh"):
        pytest.skip("the programs are shell scripts")
    monkeypatch.setattr(audits, "WORK", tmp_path / "work")
    monkeypatch.setattr(audits, "install_tools", lambda: tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")

    def write(**programs):
        for name, text in programs.items():
            path = tmp_path / name.replace("_", "-")
            path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
            path.chmod(0o755)

    return write


def report(*packages):
    """Return a script in place of pip-audit that writes a report about packages."""
    return f"for file; do :; done; echo '{json.dumps({'dependencies': packages})}' > \"$file\""


def test_audit_packages_returns_packages_without_advisories(run_programs):
    run_programs(pip_audit=report({"name": "a", "skip_reason": "x"}, {"name": "b", "vulns": []}))
    assert audits.audit_packages() == ["pip-audit: no advisories for 2 of 4 packages"]
    run_programs(pip_audit=report({"name": "a", "vulns": [{"id": "PYSEC-1"}]}))
    with pytest.raises(ValueError, match=r"known vulnerabilities: .*PYSEC-1"):
        audits.audit_packages()


def test_audit_crates_returns_checks_without_database(run_programs):
    on_advisories = 'case "$*" in *advisories) echo "error: {}" >&2; exit 1;; esac'
    no_database = on_advisories.format("failed to fetch advisory database")
    run_programs(cargo_deny="exit 1", cargo=no_database)
    skipped = audits.audit_crates()
    assert ["no advisories for" in line for line in skipped] == [True, True]
    run_programs(cargo=on_advisories.format("a crate"))
    with pytest.raises(ValueError, match="error: a crate"):
        audits.audit_crates()
    run_programs(cargo="exit 4")
    with pytest.raises(subprocess.CalledProcessError):
        audits.audit_crates()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, None),
        ({f"{INFO}/licenses/THIRD-PARTY-LICENSES.txt": b"old"}, "must contain THIRD-PARTY"),
        ({f"{INFO}/sboms/mograft.cdx.json": b"{}"}, "must contain mograft.cdx.json"),
        ({"mograft/_core.abi3.so": b"\0/home/me/crate/src/lib.rs\0"}, "the path /home/me/crate"),
        ({"mograft/big": b"\0" * MAX_WHEEL_BYTES}, "the limit is 3,000,000"),
    ],
)
def test_check_wheel_defect_raises_value_error(tmp_path, change, message):
    with zipfile.ZipFile(tmp_path / "a.whl", "w") as archive:
        for name, content in (NOTICES | change).items():
            archive.writestr(name, content)
    assert_refused(message, check_wheel, MOGRAFT, tmp_path / "a.whl")


@pytest.mark.parametrize("missing", [None, *sorted(SDIST)])
def test_check_sdist_missing_file_raises_value_error(tmp_path, missing):
    with tarfile.open(tmp_path / "mograft-1.tar.gz", "w:gz") as archive:
        for name in SDIST - {missing}:
            archive.addfile(tarfile.TarInfo(f"mograft-1/{name}"))
    message = missing and f"does not contain {missing}"
    assert_refused(message, check_sdist, MOGRAFT, tmp_path / "mograft-1.tar.gz")


def assert_refused(message, check, *arguments):
    """Assert that a check raises ValueError with a message, or nothing for None."""
    if message is None:
        check(*arguments)
    else:
        with pytest.raises(ValueError, match=message):
            check(*arguments)


@pytest.mark.parametrize("other", ["1.2.3", "1.2.4", "1.2.30", "11.2.3", "1x2.3"])
@pytest.mark.parametrize("name", VERSIONED)
def test_tag_with_version_other_than_a_file_names_the_file(tmp_path, name, other):
    for path, text in VERSIONED.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text.format(other if path == name else "1.2.3"))
    assert find_other_versions("v1.2.3", tmp_path) == ([] if other == "1.2.3" else [name])


@pytest.mark.parametrize("tag", ["1.2.3", "v1.2", "v1.2.3rc1", "vv1.2.3", "v1.2.3\n"])
def test_tag_that_is_no_version_raises_value_error(tag):
    with pytest.raises(ValueError, match=r"tag must be vMAJOR\.MINOR\.PATCH"):
        find_other_versions(tag)


def test_tag_of_present_version_differs_from_changelog_at_most():
    assert set(find_other_versions(f"v{MOGRAFT.version}")) <= {"CHANGELOG.md"}


def test_links_of_readme_become_absolute():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    absolute = make_absolute(text, "https://host/owner/name", "v1.2.3")
    links = re.findall(r"^\[[\w-]+\]: (\S+)$", absolute, re.MULTILINE)
    assert all(link.startswith("https://host/owner/name/") for link in links)
    assert "https://host/owner/name/raw/v1.2.3/docs/demo.gif" in links
    assert re.findall(r"\]\((?!https://)[^)]*\)", text) == []
