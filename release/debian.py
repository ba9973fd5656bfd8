"""Pythons of Debian, unpacked below the folder of releases; nothing is installed."""

import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

from release.distributions import DIST
from release.tools import install_tools

_KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
_C_LIBRARIES = ("2_28", "2_27", "2_17")


def find_missing_part(*programs: str) -> str | None:
    """Return what is not installed: a program of `programs` or of Debian, or the keys of Debian."""
    wanted = ("apt-get", "dpkg-deb", *programs)
    if missing := next((name for name in wanted if shutil.which(name) is None), None):
        return missing
    return None if _KEYRING.exists() else str(_KEYRING)


def unpack(target: Path, architecture: str, packages: Iterable[str], suite: str) -> Path:
    """Unpack packages of a suite of Debian and their dependencies; return the folder `target`."""
    if target.is_dir():
        return target
    state = target.with_name(f"apt-{target.name}")
    for folder in ("lists/partial", "archives/partial"):
        (state / folder).mkdir(parents=True, exist_ok=True)
    (state / "status").touch()
    line = f"deb [signed-by={_KEYRING}] http://deb.debian.org/debian {suite} main\n"
    (state / "sources.list").write_text(line, encoding="utf-8")
    options = {
        "APT::Architecture": architecture,
        "APT::Architectures::": architecture,
        "APT::Sandbox::User": "root",
        "Acquire::Languages": "none",
        "Debug::NoLocking": "1",
        "Dir::Etc::sourcelist": str(state / "sources.list"),
        "Dir::Etc::sourceparts": "-",
        "Dir::State": str(state),
        "Dir::State::status": str(state / "status"),
        "Dir::Cache": str(state),
    }
    words = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    apt = ["apt-get", "-qq", *words]
    subprocess.run([*apt, "update"], check=True)
    more = ["--download-only", "--no-install-recommends", "-y", "install", *packages]
    subprocess.run([*apt, *more], check=True, stdout=subprocess.DEVNULL)
    partial = target.with_name(f"{target.name}-partial")
    shutil.rmtree(partial, ignore_errors=True)
    for archive in sorted((state / "archives").glob("*.deb")):
        subprocess.run(["dpkg-deb", "-x", str(archive), str(partial)], check=True)
    return partial.rename(target)


def install_for(site: Path, version: str, machine: str, requirements: Iterable[str]) -> None:
    """Install wheels of `DIST` and of PyPI into a folder, for another Python than the running one.

    `version` is that of Python, such as 3.14; `machine` is the end of platform tags.
    """
    shutil.rmtree(site, ignore_errors=True)
    words = ["install", "--quiet", "--target", str(site), "--find-links", str(DIST)]
    words += ["--only-binary", ":all:", "--implementation", "cp", "--python-version", version]
    words += ["--abi", f"cp{version.replace('.', '')}", "--abi", "abi3", "--abi", "none"]
    tags = [*(f"manylinux_{release}_{machine}" for release in _C_LIBRARIES)]
    words += [word for tag in (*tags, f"manylinux2014_{machine}") for word in ("--platform", tag)]
    pip = str(install_tools() / "pip")
    subprocess.run([pip, *words, *requirements], check=True)
