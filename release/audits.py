"""Search for known vulnerabilities of dependencies, and check the licences of crates."""

import json
import shutil
import subprocess
from importlib import metadata
from typing import Any

from release.distributions import ROOT, WORK
from release.tools import install_tools


def audit_packages() -> list[str]:
    """Look up NumPy and the pinned programs of a release with pip-audit.

    Raises ValueError if one has a known vulnerability. Returns a line for the packages that were
    not examined: all of them without access to the advisories of PyPI.
    """
    WORK.mkdir(exist_ok=True)
    report = WORK / "pip-audit.json"
    numpy = WORK / "numpy.txt"
    numpy.write_text(f"numpy=={metadata.version('numpy')}\n", encoding="utf-8")
    found: list[dict[str, Any]] = []
    for requirements in (numpy, ROOT / "release" / "requirements.txt"):
        report.unlink(missing_ok=True)
        words = ["--requirement", str(requirements), "--disable-pip", "--no-deps"]
        command = [str(install_tools() / "pip-audit"), *words, "--format", "json"]
        command += ["--output", str(report)]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        if not report.exists():
            raise ValueError(f"pip-audit failed: {process.stderr[-2000:]}")
        found += json.loads(report.read_text(encoding="utf-8"))["dependencies"]
    skipped = [package["name"] for package in found if "skip_reason" in package]
    if vulnerable := [package for package in found if package.get("vulns")]:
        raise ValueError(f"known vulnerabilities: {json.dumps(vulnerable)[:2000]}")
    if examined := len(found) - len(skipped):
        print(f"pip-audit: {examined} packages have no known vulnerability", flush=True)
    if not skipped:
        return []
    return [f"pip-audit: no advisories for {len(skipped)} of {len(found)} packages"]


def audit_crates() -> list[str]:
    """Check licences, sources and versions of the crates, and advisories if they can be fetched.

    Returns a line for each check that was skipped. Raises CalledProcessError or ValueError if a
    check fails.
    """
    if shutil.which("cargo-deny") is None:
        return ["cargo deny: not installed: cargo install cargo-deny --locked"]
    skipped = []
    for manifest in ("Cargo.toml", "python-fbx/Cargo.toml"):
        command = ["cargo", "deny", "--workspace", "--manifest-path", manifest]
        command += ["--config", str(ROOT / "deny.toml"), "check", "--hide-inclusion-graph"]
        subprocess.run([*command, "bans", "licenses", "sources"], cwd=ROOT, check=True)
        process = subprocess.run(
            [*command, "advisories"], cwd=ROOT, check=False, capture_output=True, text=True
        )
        if process.returncode and "failed to fetch advisory database" not in process.stderr:
            raise ValueError(process.stderr[-4000:])
        if process.returncode:
            skipped.append(
                f"cargo deny: no advisories for {manifest}: their database is not reachable"
            )
    return skipped
