"""Checks of finished wheels and source distributions."""

import json
import re
import subprocess
import tarfile
import zipfile
from pathlib import Path

from release.distributions import DIST, DISTRIBUTIONS, MAX_WHEEL_BYTES, ROOT, Distribution
from release.tools import install_tools, run_tool

_PRIVATE_PATH = re.compile(rb"/(?:root|home|work|Users)/[\w./-]+")


def check_artifacts() -> None:
    """Check all files of the present version in `DIST`; raise ValueError at the first defect."""
    for distribution in DISTRIBUTIONS:
        wheels = distribution.find_artifacts(DIST, "-*.whl")
        sdists = distribution.find_artifacts(DIST, ".tar.gz")
        if not wheels and not sdists:
            raise ValueError(f"{DIST} has no file of {distribution.name} {distribution.version}")
        run_tool("twine", "check", "--strict", *wheels, *sdists)
        for wheel in wheels:
            run_tool("check-wheel-contents", wheel)
            check_wheel(distribution, wheel)
            if "-abi3-" in wheel.name:
                run_tool("abi3audit", "--strict", "--summary", wheel)
            if "linux" in wheel.name:
                check_platform_tag(wheel)
        for sdist in sdists:
            check_sdist(distribution, sdist)


def check_wheel(distribution: Distribution, wheel: Path) -> None:
    """Check size, notices and the absence of paths of the machine that built the wheel."""
    size = wheel.stat().st_size
    if size >= MAX_WHEEL_BYTES:
        raise ValueError(f"{wheel.name} has {size:,} bytes; the limit is {MAX_WHEEL_BYTES:,}")
    with zipfile.ZipFile(wheel) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    info = f"{distribution.name.replace('-', '_')}-{distribution.version}.dist-info"
    for source, target in (
        (distribution.licences, f"{info}/licenses/{distribution.licences.name}"),
        (distribution.bill, f"{info}/sboms/{distribution.bill.name}"),
    ):
        if files.get(target) != source.read_bytes():
            raise ValueError(f"{wheel.name} must contain {source.relative_to(ROOT)} as {target}")
    for name, content in files.items():
        if found := _PRIVATE_PATH.search(content if name.endswith((".so", ".pyd")) else b""):
            raise ValueError(f"{wheel.name}: {name} contains the path {found[0].decode()}")
    print(f"{wheel.name}: {size:,} bytes, notices complete", flush=True)


def check_sdist(distribution: Distribution, sdist: Path) -> None:
    """Check that the source distribution contains the notices and `Cargo.lock`."""
    root = sdist.name.removesuffix(".tar.gz")
    with tarfile.open(sdist) as archive:
        names = set(archive.getnames())
    for name in (distribution.licences.name, distribution.bill.name, "LICENSE", "Cargo.lock"):
        if f"{root}/{name}" not in names:
            raise ValueError(f"{sdist.name} does not contain {name}")
    print(f"{sdist.name}: notices complete", flush=True)


def check_platform_tag(wheel: Path) -> None:
    """Check with auditwheel that the wheel runs on the oldest system that its name states."""
    command = [str(install_tools() / "auditwheel"), "show", "--json", str(wheel)]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    tag = json.loads(process.stdout)["overall_tag"]
    if tag not in wheel.name:
        raise ValueError(f"{wheel.name} needs {tag}, which its name does not state")
    print(f"{wheel.name}: auditwheel finds {tag}", flush=True)


def check_bills() -> None:
    """Validate the bills of materials against the schema of CycloneDX 1.6."""
    script = (
        "import sys; from pathlib import Path\n"
        "from cyclonedx.schema import SchemaVersion\n"
        "from cyclonedx.validation.json import JsonStrictValidator\n"
        "for path in sys.argv[1:]:\n"
        "    text = Path(path).read_text(encoding='utf-8')\n"
        "    error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)\n"
        "    assert error is None, (path, error)\n"
    )
    run_tool("python", "-c", script, *(distribution.bill for distribution in DISTRIBUTIONS))
