"""Build source distributions and wheels with maturin."""

import os
import platform
import shutil
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


CHECKED_TARGETS = ("x86_64-pc-windows-msvc", "x86_64-apple-darwin", "aarch64-apple-darwin")
CHECKED_CRATES = ("mograft-python", "mograft-linkage-module")
_CHECK_VARIABLES = {
    "CARGO_TARGET_DIR": str(WORK / "target-check"),
    "PYO3_CROSS_PYTHON_VERSION": "3.11",
}


def find_native_platform() -> Platform:
    """Return the platform of the machine that runs this script."""
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    word = {"win32": "windows", "darwin": "macos"}.get(sys.platform, f"{machine}-unknown-linux-gnu")
    return next(p for p in PLATFORMS if word in f"{p.name} {p.target}")


def find_missing_target(wanted: Platform) -> str | None:
    """Return the target of rustc whose standard library is neither installed nor installable.

    Rustup, if there is one, installs a missing target.
    """
    targets = [wanted.target]
    if wanted.name == "macos-universal2":
        targets = ["x86_64-apple-darwin", "aarch64-apple-darwin"]
    for target in targets:
        if not _has_target(target) and not _add_target(target):
            return target
    return None


def _add_target(target: str) -> bool:
    """Install a target of rustc by rustup; return whether it is installed."""
    if shutil.which("rustup") is not None:
        subprocess.run(["rustup", "target", "add", target], check=False, capture_output=True)
    return _has_target(target)


def _has_target(target: str) -> bool:
    """Return whether the standard library of a target of rustc is installed."""
    command = [os.environ.get("RUSTC", "rustc"), "--print", "target-libdir", "--target", target]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    return process.returncode == 0 and Path(process.stdout.strip()).is_dir()


def check_targets() -> list[str]:
    """Check with cargo that the crates of `CHECKED_CRATES` compile for Windows and macOS.

    Nothing is linked, so that no linker and no library of these systems is needed. Returns the
    targets that were skipped, each with the reason.
    """
    skipped = []
    for target in CHECKED_TARGETS:
        if not _has_target(target) and not _add_target(target):
            skipped.append(f"{target}: no such target of rustc")
            continue
        words = [word for crate in CHECKED_CRATES for word in ("--package", crate)]
        command = ["cargo", "check", "--quiet", "--locked", "--target", target, *words]
        subprocess.run(command, cwd=ROOT, check=True, env=os.environ | _CHECK_VARIABLES)
        print(f"{target}: {' and '.join(CHECKED_CRATES)} compile", flush=True)
    return skipped


def build_sdist(distribution: Distribution) -> None:
    """Write the source distribution to `DIST`."""
    run_tool("maturin", "sdist", "--out", DIST, cwd=distribution.folder)


def build_wheel(
    distribution: Distribution, wanted: Platform, interpreter: str | None = None
) -> None:
    """Write the wheel of a platform to `DIST`.

    Without `interpreter` the wheel serves Python 3.11 and later. Free-threaded Python has no stable
    ABI before version 3.15 and needs a wheel of its own: `interpreter` is its program.
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
