"""The release scripts: notices match the crates, and each check refuses a defect."""

import json
import shutil
import tarfile
import zipfile

import pytest

from release import checks, trials
from release.checks import check_sdist, check_wheel
from release.crates import read_crates
from release.distributions import DISTRIBUTIONS, MAX_WHEEL_BYTES
from release.notices import find_stale_notices, render_bill, render_licences

needs_cargo = pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo is not installed")
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
    program = tools / "auditwheel"
    program.write_text('#!/bin/sh\necho \'{"overall_tag": "manylinux_2_28_x86_64"}\'\n')
    program.chmod(0o755)
    monkeypatch.setattr(checks, "install_tools", lambda: tools)
    checks.check_platform_tag(tmp_path / "a-1-cp311-abi3-manylinux_2_28_x86_64.whl")
    with pytest.raises(ValueError, match="needs manylinux_2_28_x86_64"):
        checks.check_platform_tag(tmp_path / "a-1-cp311-abi3-manylinux_2_17_x86_64.whl")


def test_run_fresh_cargo_on_path_raises_value_error(tmp_path, monkeypatch):
    (tmp_path / "cargo").write_text("#!/bin/sh\n")
    (tmp_path / "cargo").chmod(0o755)
    monkeypatch.setattr(trials, "_SYSTEM_FOLDERS", (str(tmp_path),))
    with pytest.raises(ValueError, match="the environment without Rust contains"):
        trials.run_fresh(tmp_path, "python", "-V")
