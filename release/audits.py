"""Search for known vulnerabilities of dependencies, and check the licences of crates."""

import json
import shutil
import subprocess
from importlib import metadata
from typing import Any

from release.distributions import ROOT, WORK
from release.tools import install_tools


def audit_packages() -> None:
    """Look up NumPy and the pinned programs of a release with pip-audit.

    Raises ValueError if one has a known vulnerability. Without access to the advisories of PyPI
    this prints which packages were not examined.
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
    n_examined = len(found) - len(skipped)
    print(
        f"pip-audit: examined {n_examined} of {len(found)} packages: no vulnerability", flush=True
    )
    if skipped:
        print(f"pip-audit: no advisories could be read for {skipped}", flush=True)


def audit_crates() -> None:
    """Check licences, sources and versions of the crates, and advisories if they can be fetched."""
    if shutil.which("cargo-deny") is None:
        print("cargo deny: skipped: cargo install cargo-deny --locked", flush=True)
        return
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
            print(f"cargo deny: advisories of {manifest} not examined, no network", flush=True)
