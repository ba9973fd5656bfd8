"""A trial of aarch64 wheels on another machine: Debian's Python for arm64, under QEMU."""

import shutil
import subprocess
from pathlib import Path

from release.debian import find_missing_part, install_for, unpack
from release.distributions import DIST, DISTRIBUTIONS, WORK
from release.tools import bin_of

_ROOT = WORK / "aarch64"
_SUITE = "bookworm"
_MAX_GAP = 1e-9
"""Largest difference of the numbers in a graft, in degrees and in the unit of length."""

_KERNELS = """
import hashlib
import mograft_linkage
import numpy as np
digest = hashlib.sha256()
for n_points, n_axes in ((3000, 3), (500, 40), (4000, 1)):
    points = np.random.default_rng(n_axes).random((n_points, n_axes))
    digest.update(mograft_linkage.linkage(points).tobytes())
    digest.update(mograft_linkage.linkage(points.round(1)).tobytes())
print(digest.hexdigest())
"""


def try_aarch64() -> list[str]:
    """Run ``mograft doctor`` and ``mograft demo`` from the aarch64 wheels under QEMU.

    The packages of Debian are unpacked below the folder of releases; nothing is installed. Without
    apt the trial is skipped, and the reason returned. Raises ValueError if trees have other bits
    than those of the step `try-wheel`, or numbers of a graft differ by more than 1e-9.
    """
    if missing := find_missing_part():
        return [f"aarch64: Debian's Python for arm64 needs {missing}"]
    if not all(d.find_artifacts(DIST, "-*aarch64.whl") for d in DISTRIBUTIONS):
        return ["aarch64: the step wheel has built no such wheels"]
    python = unpack(_ROOT / "arm64", "arm64", ("python3", "libstdc++6"), _SUITE) / "usr/bin/python3"
    python = python.with_name(python.readlink().name)
    qemu = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if qemu is None:
        programs = unpack(_ROOT / "amd64", "amd64", ("qemu-user-static",), _SUITE)
        qemu = str(programs / "usr/bin/qemu-aarch64-static")
    site = _ROOT / "site"
    names = [f"{d.name}=={d.version}" for d in DISTRIBUTIONS]
    install_for(site, python.name.removeprefix("python"), "aarch64", names)
    folder = _ROOT / "run"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    command = [qemu, "-L", str(_ROOT / "arm64"), str(python), "-m"]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(folder), "PYTHONPATH": str(site)}
    for module in ("mograft_linkage", "mograft_fbx"):
        subprocess.run([*command[:-1], "-c", f"import {module}"], env=environment, check=True)
    subprocess.run([*command, "mograft", "doctor"], cwd=folder, env=environment, check=True)
    words = ["mograft", "demo", "-o", "demo"]
    subprocess.run([*command, *words], cwd=folder, env=environment, check=True)
    _compare_demos(folder / "demo/dance_graft0.bvh", WORK / "wheel/demo/dance_graft0.bvh")
    native = bin_of(WORK / "wheel" / "venv") / "python"
    if native.exists():
        _compare_kernels([*command[:-1]], [str(native)], environment)
    return []


def _compare_kernels(emulated: list[str], native: list[str], environment: dict[str, str]) -> None:
    """Check that kernels without sines have the same bits on both machines."""
    command, outputs = ["-c", _KERNELS], []
    for python, variables in ((emulated, environment), (native, None)):
        process = subprocess.run(
            [*python, *command], env=variables, check=True, capture_output=True
        )
        outputs.append(process.stdout.decode().strip())
    print(f"SHA-256 of trees: {' and '.join(outputs)}", flush=True)
    if outputs[0] != outputs[1]:
        raise ValueError("kernels have other bits on aarch64 than on this machine")


def _compare_demos(emulated: Path, native: Path) -> None:
    """Compare the numbers of a graft with those of this machine, if the step `try-wheel` has run.

    The libraries of the two machines may round the last bits of sines differently.
    """
    if not native.exists():
        return
    pairs = list(zip(emulated.read_text().split(), native.read_text().split(), strict=True))
    gaps = [abs(float(a) - float(b)) for a, b in pairs if a != b]
    print(f"{emulated.name}: {len(gaps)} of {len(pairs)} words differ from {native}", flush=True)
    if max(gaps, default=0.0) > _MAX_GAP:
        raise ValueError(f"numbers of {emulated} differ by {max(gaps)} from those of {native}")
