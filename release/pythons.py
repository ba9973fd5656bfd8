"""A trial of the wheels on newer Pythons: those of Debian unstable, in a folder as root folder."""

import shutil
import subprocess
from pathlib import Path

from release import suite
from release.build import find_native_platform
from release.debian import find_missing_part, install_for, unpack
from release.distributions import DIST, DISTRIBUTIONS, ROOT, WORK

VERSIONS = ("3.13", "3.14", "3.15")

_SUITE = "sid"
_PACKAGES = ("base-files", "bash", "ca-certificates", "coreutils", "dash", "libc-bin")
_ENTER = """
mount --rbind /dev "$1/dev" && mount --rbind /proc "$1/proc" &&
mount --bind "$2" "$1/source" && mount --bind "$3" "$1/site" &&
cd "$1" && shift 3 && exec chroot . /usr/bin/env -i "$@"
"""
_FILES = ("pyproject.toml", "CHANGELOG.md")
_FOLDERS = ("benches", "docs", "examples", "lab", "tests")


def try_pythons() -> list[str]:
    """Run ``mograft doctor``, ``mograft demo`` and tests from the wheels on `VERSIONS`.

    Debian's packages are unpacked below the folder of releases; nothing is installed. Without apt
    or the right to mount folders the trial is skipped, and the reason returned. Raises
    CalledProcessError if a command fails.
    """
    if reason := _find_obstacle():
        return [f"other Pythons: {reason}"]
    folder = WORK / "pythons"
    folder.mkdir(parents=True, exist_ok=True)
    packages = (*_PACKAGES, "libstdc++6", *(f"python{version}" for version in VERSIONS))
    root = unpack(folder / "root", "amd64", packages, _SUITE)
    for name in ("dev", "proc", "site", "source", "tmp"):
        (root / name).mkdir(exist_ok=True)
    for version in VERSIONS:
        site = folder / f"site-{version}"
        names = [f"{d.name}=={d.version}" for d in DISTRIBUTIONS]
        install_for(site, version, "x86_64", [*names, *suite.list_requirements()])
        _try_python(root, site, version)
    return []


def _find_obstacle() -> str | None:
    """Return why this machine cannot run Debian's Pythons, if so."""
    if find_native_platform().name != "manylinux-x86-64":
        return "they are those of Debian for x86-64"
    if missing := find_missing_part("unshare", "chroot"):
        return f"Debian's Pythons need {missing}"
    words = ["unshare", "--map-root-user", "--mount", "true"]
    if subprocess.run(words, check=False, capture_output=True).returncode:
        return "mounting folders in a namespace is forbidden"
    if not all(d.find_artifacts(DIST, "-*abi3-*x86_64.whl") for d in DISTRIBUTIONS):
        return "the step wheel has built no wheels"
    return None


def _try_python(root: Path, site: Path, version: str) -> None:
    """Run the commands and the tests on one Python; `root` is its root folder."""
    source = root.parent / "source"
    shutil.rmtree(source, ignore_errors=True)
    source.mkdir()
    for name in _FILES:
        shutil.copyfile(ROOT / name, source / name)
    ignored = shutil.ignore_patterns("__pycache__", "_build", "_made")
    for name in _FOLDERS:
        shutil.copytree(ROOT / name, source / name, ignore=ignored)
    variables = ("PATH=/usr/bin", "HOME=/tmp", "LANG=C.UTF-8", "PYTHONPATH=/site")
    python = ["--chdir=/source", *variables, f"/usr/bin/python{version}"]
    for words in (
        ["-m", "mograft", "doctor"],
        ["-m", "mograft", "demo", "-o", "demo"],
        suite.list_words(few_examples=True),
    ):
        print(f"$ python{version} {' '.join(words)}", flush=True)
        enter = ["unshare", "--map-root-user", "--mount", "sh", "-c", _ENTER, "sh"]
        subprocess.run([*enter, root, source, site, *python, *words], check=True)
