"""Build source distributions and wheels with maturin."""

import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from release.distributions import DIST, ROOT, WORK, Distribution
from release.tools import run_tool

TARGET = WORK / "target"
"""Folder of compiled crates."""


@dataclass(frozen=True)
class Platform:
    """A platform of wheels: the target of rustc and, on Linux, the tag of the wheel."""

    name: str
    target: str
    tag: str | None = None  # compiled and linked by zig for this version of the C library


PLATFORMS = (
    Platform("manylinux-x86-64", "x86_64-unknown-linux-gnu", "manylinux_2_17"),
    Platform("manylinux-aarch64", "aarch64-unknown-linux-gnu", "manylinux_2_17"),
    Platform("musllinux-x86-64", "x86_64-unknown-linux-musl", "musllinux_1_2"),
    Platform("musllinux-aarch64", "aarch64-unknown-linux-musl", "musllinux_1_2"),
    Platform("windows-x86-64", "x86_64-pc-windows-msvc"),
    Platform("macos-universal2", "universal2-apple-darwin"),
)


def find_native_platform() -> Platform:
    """Return the platform of the machine that runs this script."""
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    word = {"win32": "windows", "darwin": "macos"}.get(sys.platform, f"{machine}-unknown-linux-gnu")
    return next(p for p in PLATFORMS if word in f"{p.name} {p.target}")


def find_missing_target(wanted: Platform) -> str | None:
    """Return the target of rustc whose standard library is not installed, if any."""
    targets = [wanted.target]
    if wanted.name == "macos-universal2":
        targets = ["x86_64-apple-darwin", "aarch64-apple-darwin"]
    command = [os.environ.get("RUSTC", "rustc"), "--print", "target-libdir", "--target"]
    for target in targets:
        process = subprocess.run([*command, target], capture_output=True, text=True, check=False)
        if process.returncode or not Path(process.stdout.strip()).is_dir():
            return target
    return None


def build_sdist(distribution: Distribution) -> None:
    """Write the source distribution to `DIST`."""
    run_tool("maturin", "sdist", "--out", DIST, cwd=distribution.folder)


def build_wheel(
    distribution: Distribution, wanted: Platform, interpreter: str | None = None
) -> None:
    """Write the wheel of a platform to `DIST`.

    Without `interpreter` the wheel serves Python 3.11 and later. Free-threaded Python has no stable
    ABI before version 3.15, so that it needs a wheel of its own: `interpreter` is its program.
    The wheel does not contain paths of this machine.
    """
    _hide_paths()
    words = ["build", "--release", "--locked", "--out", str(DIST), "--target", wanted.target]
    if wanted.tag is not None:
        words += ["--zig", "--compatibility", wanted.tag]
    if interpreter is not None:
        words += ["--interpreter", interpreter]
    run_tool("maturin", *words, cwd=distribution.folder)


def _hide_paths() -> None:
    """Replace folders of this machine in messages of panics, for all later compilations."""
    cargo = os.environ.get("CARGO_HOME") or str(Path.home() / ".cargo")
    flags = [f"--remap-path-prefix={cargo}=cargo", f"--remap-path-prefix={ROOT}=mograft"]
    os.environ["CARGO_ENCODED_RUSTFLAGS"] = "\x1f".join(flags)
    os.environ["CARGO_TARGET_DIR"] = str(TARGET)
