"""The three distributions of the repository, and the folders of a release."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / ".release"
"""Folder of the tools, fresh environments and logs of a release; git ignores it."""

DIST = ROOT / "dist"
"""Folder of finished wheels and source distributions."""

MAX_WHEEL_BYTES = 3_000_000


@dataclass(frozen=True, kw_only=True)
class Distribution:
    """A Python distribution with one extension module written in Rust."""

    name: str
    folder: Path  # contains pyproject.toml
    manifest: Path  # Cargo.toml of the crate of the extension module
    package: str
    extension: str  # import name of the extension module

    @property
    def version(self) -> str:
        """The version, which the workspace of the crate states."""
        workspace = ROOT / "python-fbx" if self.name == "mograft-fbx" else ROOT
        table = tomllib.loads((workspace / "Cargo.toml").read_text(encoding="utf-8"))
        return str(table["workspace"]["package"]["version"])

    @property
    def licences(self) -> Path:
        """The file with the licences of all crates that the extension module contains."""
        return self.folder / "THIRD-PARTY-LICENSES.txt"

    @property
    def bill(self) -> Path:
        """The bill of materials in the format CycloneDX."""
        return self.folder / f"{self.name}.cdx.json"

    def find_artifacts(self, folder: Path, pattern: str) -> list[Path]:
        """Return the files of this distribution and version whose names end with a pattern."""
        return sorted(folder.glob(f"{self.name.replace('-', '_')}-{self.version}{pattern}"))


DISTRIBUTIONS = (
    Distribution(
        name="mograft",
        folder=ROOT,
        manifest=ROOT / "rust/py/Cargo.toml",
        package="mograft",
        extension="mograft._core",
    ),
    Distribution(
        name="mograft-linkage",
        folder=ROOT / "python/mograft/_standalone",
        manifest=ROOT / "rust/py-linkage-module/Cargo.toml",
        package="mograft_linkage",
        extension="mograft_linkage._core",
    ),
    Distribution(
        name="mograft-fbx",
        folder=ROOT / "python-fbx",
        manifest=ROOT / "python-fbx/Cargo.toml",
        package="mograft_fbx",
        extension="mograft_fbx.mograft_fbx",
    ),
)
