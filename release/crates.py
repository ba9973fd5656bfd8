"""The crates that an extension module contains, from ``cargo metadata``."""

import json
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from release.distributions import Distribution

_LICENCE_NAMES = ("LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE", "COPYRIGHT")


@dataclass(frozen=True, kw_only=True)
class Crate:
    """One crate with the crates that it links."""

    name: str
    version: str
    licence: str
    folder: Path
    checksum: str | None  # SHA-256 of the package on crates.io; None for crates of this repository
    repository: str
    dependencies: tuple[str, ...]  # "name version" of each crate

    @property
    def key(self) -> str:
        """Name and version, which identify a crate of crates.io."""
        return f"{self.name} {self.version}"

    def read_licences(self) -> list[str]:
        """Return the texts of the licence files: of MIT alone if the crate offers it."""
        found = [
            p for p in sorted(self.folder.iterdir()) if p.name.upper().startswith(_LICENCE_NAMES)
        ]
        if "MIT" in self.licence.replace("/", " OR ").split(" OR "):
            others = ("APACHE", "ZLIB", "UNLICENSE", "BOOST")
            found = [p for p in found if not any(word in p.name.upper() for word in others)]
        return [p.read_text(encoding="utf-8").strip() for p in found if p.is_file()]


def read_crates(distribution: Distribution) -> list[Crate]:
    """Return the crates that the extension module links on any platform, sorted by name.

    Crates that only run during compilation are absent: build scripts, procedural macros and
    what these depend on.
    """
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    process = subprocess.run(
        [*command, "--manifest-path", str(distribution.manifest)],
        stdout=subprocess.PIPE,
        check=True,
    )
    data = json.loads(process.stdout)
    packages = {package["id"]: package for package in data["packages"]}
    linked = _find_linked(data, packages, distribution.manifest)
    checksums = _read_checksums(Path(data["workspace_root"]))
    crates = [_make_crate(packages, key, names, checksums) for key, names in linked.items()]
    return sorted(crates, key=lambda crate: (crate.name, crate.version))


def _find_linked(
    data: dict[str, Any], packages: dict[str, Any], manifest: Path
) -> dict[str, list[str]]:
    """Return the linked dependencies of every crate that the crate of a manifest links."""
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    waiting = [key for key, value in packages.items() if Path(value["manifest_path"]) == manifest]
    linked: dict[str, list[str]] = {}
    while waiting:
        key = waiting.pop()
        if key in linked:
            continue
        linked[key] = [
            link["pkg"]
            for link in nodes[key]["deps"]
            if any(kind["kind"] is None for kind in link["dep_kinds"])
            and not _is_macro(packages[link["pkg"]])
        ]
        waiting += linked[key]
    return linked


def _is_macro(package: dict[str, Any]) -> bool:
    return any("proc-macro" in target["kind"] for target in package["targets"])


def _read_checksums(workspace: Path) -> dict[tuple[str, str], str]:
    lock = tomllib.loads((workspace / "Cargo.lock").read_text(encoding="utf-8"))
    return {(p["name"], p["version"]): p["checksum"] for p in lock["package"] if "checksum" in p}


def _make_crate(
    packages: dict[str, Any], key: str, links: list[str], checksums: dict[tuple[str, str], str]
) -> Crate:
    package = packages[key]
    others = [packages[link] for link in links]
    return Crate(
        name=package["name"],
        version=package["version"],
        licence=package["license"].replace("/", " OR "),
        folder=Path(package["manifest_path"]).parent,
        checksum=checksums.get((package["name"], package["version"])),
        repository=package["repository"] or "",
        dependencies=tuple(sorted(f"{other['name']} {other['version']}" for other in others)),
    )
