"""A trial of aarch64 wheels on another machine: Debian's Python for arm64, under QEMU."""

import os
import shutil
import subprocess
from pathlib import Path

from release.distributions import DIST, DISTRIBUTIONS, WORK
from release.tools import bin_of, install_tools

_ROOT = WORK / "aarch64"
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
_TAGS = ("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")


def try_aarch64() -> None:
    """Run ``mograft doctor`` and ``mograft demo`` from the aarch64 wheels under QEMU.

    The packages of Debian are unpacked below the folder of releases; nothing is installed. Without
    apt this prints a reason and returns. Raises ValueError if trees have other bits than those of
    the step `try-wheel`, or numbers of a graft differ by more than 1e-9.
    """
    if shutil.which("apt-get") is None or shutil.which("dpkg-deb") is None:
        print("aarch64: skipped: the Python for arm64 comes from Debian's packages", flush=True)
        return
    if not all(d.find_artifacts(DIST, "-*aarch64.whl") for d in DISTRIBUTIONS):
        print("aarch64: skipped: the step wheel has built no such wheels", flush=True)
        return
    python = _unpack("arm64", "python3", "libstdc++6") / "usr/bin/python3"
    python = python.with_name(python.readlink().name)
    qemu = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if qemu is None:
        qemu = str(_unpack("amd64", "qemu-user-static") / "usr/bin/qemu-aarch64-static")
    site = _install_wheels(python.name.removeprefix("python"))
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


def _unpack(architecture: str, *packages: str) -> Path:
    """Unpack packages of Debian and all that they depend on; return the folder."""
    target, state = _ROOT / architecture, _ROOT / f"apt-{architecture}"
    if target.is_dir():
        return target
    for folder in ("lists/partial", "archives/partial"):
        (state / folder).mkdir(parents=True, exist_ok=True)
    (state / "status").touch()
    options = {
        "APT::Architecture": architecture,
        "APT::Architectures::": architecture,
        "APT::Sandbox::User": "root",
        "Acquire::Languages": "none",
        "Debug::NoLocking": "1",
        "Dir::State": str(state),
        "Dir::State::status": str(state / "status"),
        "Dir::Cache": str(state),
    }
    words = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    apt = ["apt-get", "-qq", *words]
    subprocess.run([*apt, "update"], check=True)
    more = ["--download-only", "--no-install-recommends", "-y", "install", *packages]
    subprocess.run([*apt, *more], check=True, stdout=subprocess.DEVNULL)
    partial = target.with_name(f"{architecture}-partial")
    shutil.rmtree(partial, ignore_errors=True)
    for archive in sorted((state / "archives").glob("*.deb")):
        subprocess.run(["dpkg-deb", "-x", str(archive), str(partial)], check=True)
    return partial.rename(target)


def _install_wheels(version: str) -> Path:
    """Install the aarch64 wheels and NumPy for a version of Python; return the folder."""
    site = _ROOT / "site"
    shutil.rmtree(site, ignore_errors=True)
    digits = version.replace(".", "")
    words = ["install", "--quiet", "--target", str(site), "--find-links", str(DIST)]
    words += ["--only-binary", ":all:", "--implementation", "cp", "--python-version", version]
    words += ["--abi", f"cp{digits}", "--abi", "abi3", "--abi", "none"]
    words += [word for tag in _TAGS for word in ("--platform", tag)]
    names = [f"{d.name}=={d.version}" for d in DISTRIBUTIONS]
    pip = str(bin_of(WORK / "tools") / "pip")
    install_tools()
    subprocess.run([pip, *words, *names], check=True, env=dict(os.environ))
    return site
