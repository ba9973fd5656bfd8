"""Build and check a release: ``python -m release --dry-run [STEP ...]``.

Nothing is uploaded: the workflow `release.yml` does that when a tag is pushed. All steps run by
default, even if an earlier one failed; the exit code is 1 if any failed. Parts of a step that this
machine cannot run are skipped and listed at the end; with ``--strict`` they count as failures.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterable

from release.audits import audit_crates, audit_packages
from release.build import (
    PLATFORMS,
    build_sdist,
    build_wheel,
    check_targets,
    find_missing_target,
    find_native_platform,
)
from release.checks import check_artifacts, check_bills
from release.distributions import DIST, DISTRIBUTIONS, ROOT, WORK
from release.emulation import try_aarch64
from release.notices import find_stale_notices
from release.pythons import VERSIONS, try_pythons
from release.trials import try_sdists, try_tests, try_types, try_wheels


def _check_notices(_options: argparse.Namespace) -> None:
    if stale := find_stale_notices():
        raise ValueError(f"{', '.join(stale)}: write them by python -m release.notices --write")
    check_bills()


def _build_sdists(_options: argparse.Namespace) -> None:
    for distribution in DISTRIBUTIONS:
        build_sdist(distribution)


def _build_wheels(options: argparse.Namespace) -> list[str]:
    skipped = []
    for platform in [p for p in PLATFORMS if p.name in options.platform]:
        if missing := find_missing_target(platform):
            skipped.append(f"wheels for {platform.name}: no target {missing} of rustc")
            continue
        for distribution in DISTRIBUTIONS:
            build_wheel(distribution, platform, options.interpreter)
    return skipped


def _audit(_options: argparse.Namespace) -> list[str]:
    return [*audit_packages(), *audit_crates()]


def _build_documentation(_options: argparse.Namespace) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "docs", str(WORK / "docs")]
    subprocess.run(command, cwd=ROOT, check=True)


def _remove_old_artifacts() -> None:
    """Remove the files of the present version from `DIST`, so that no step checks an older one."""
    for distribution in DISTRIBUTIONS:
        for pattern in ("-*.whl", ".tar.gz"):
            for path in distribution.find_artifacts(DIST, pattern):
                path.unlink()


_Step = Callable[[argparse.Namespace], list[str] | None]
"""A step returns the parts that it skipped, each with the reason."""

STEPS: dict[str, tuple[str, _Step]] = {
    "notices": ("licences and bills of materials are current and valid", _check_notices),
    "sdist": ("build the source distributions", _build_sdists),
    "wheel": ("build the wheels", _build_wheels),
    "check-targets": ("compile for Windows and macOS", lambda _: check_targets()),
    "check": ("check all files in dist", lambda _: check_artifacts()),
    "try-wheel": ("run mograft from wheels, without Rust", lambda o: try_wheels(o.python)),
    "try-tests": ("run tests from wheels, after try-wheel", lambda _: try_tests()),
    "try-types": ("check types in a foreign project, after try-wheel", lambda _: try_types()),
    "try-pythons": (f"run mograft on Python {', '.join(VERSIONS)}", lambda _: try_pythons()),
    "try-aarch64": ("run mograft from aarch64 wheels under QEMU", lambda _: try_aarch64()),
    "try-sdist": ("run mograft from sources, without a network", lambda _: try_sdists()),
    "audit": ("look for known vulnerabilities", _audit),
    "docs": ("build the documentation", _build_documentation),
}


def main(arguments: list[str]) -> int:
    """Run the steps; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m release",
        description="Build and check the distributions. Nothing is uploaded.",
        epilog="\n".join(f"{name:12} {text}" for name, (text, _) in STEPS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    default = [find_native_platform().name]
    if default == ["manylinux-x86-64"]:
        default.append("manylinux-aarch64")
    parser.add_argument("step", nargs="*", help="steps (default: all)")
    parser.add_argument("--dry-run", action="store_true", required=True, help="upload nothing")
    parser.add_argument(
        "--platform",
        nargs="+",
        choices=[platform.name for platform in PLATFORMS],
        default=default,
        help=f"platforms of the wheels (default: {' and '.join(default)})",
    )
    parser.add_argument("--interpreter", help="program of a free-threaded Python, for its wheels")
    parser.add_argument("--python", default=sys.executable, help="Python of the step try-wheel")
    parser.add_argument("--strict", action="store_true", help="fail if a part of a step is skipped")
    options = parser.parse_args(arguments)
    if unknown := set(options.step) - set(STEPS):
        parser.error(f"unknown step {min(unknown)}; expected {', '.join(STEPS)}")
    if not options.step:
        _remove_old_artifacts()
    failed, skipped = _run_steps(options.step or STEPS, options)
    print()
    for part in skipped:
        print(f"skipped: {part}")
    if failed:
        print(f"failed: {', '.join(failed)}", flush=True)
    else:
        print("all steps passed, without the skipped parts" if skipped else "all steps passed")
    return 1 if failed or (options.strict and skipped) else 0


def _run_steps(names: Iterable[str], options: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Run steps; return the names of those that failed, and the skipped parts of all."""
    failed, skipped = [], []
    for name in names:
        print(f"\n== {name}: {STEPS[name][0]}", flush=True)
        start = time.perf_counter()
        try:
            parts = STEPS[name][1](options) or []
        except (OSError, ValueError, subprocess.CalledProcessError) as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            failed.append(name)
        else:
            skipped += [f"{name}: {part}" for part in parts]
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    return failed, skipped


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
