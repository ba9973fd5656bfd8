"""The parts of three.js in pages and in the studio: ``python -m release.three --write``.

The versions are pinned in ``release/npm/package-lock.json``, with hashes. Each module exports the
names that its scripts use, so that the same versions and scripts give the same bytes. It needs npm
and its registry.
"""

import argparse
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from release.distributions import ROOT

FOLDER = ROOT / "release" / "npm"
DIGESTS = FOLDER / "three.sha256"
_PACKAGE = ROOT / "python" / "mograft"
_CONTROLS = "three/examples/jsm/controls"
_ADDONS = {name: f"{_CONTROLS}/{name}.js" for name in ("OrbitControls", "TransformControls")}
"""Modules of the add-ons of three.js."""


@dataclass(frozen=True)
class Bundle:
    """A module with the names of three.js that some scripts use."""

    target: Path
    folders: tuple[Path, ...]  # of the scripts

    @property
    def name(self) -> str:
        """The path of the module in the repository."""
        return self.target.relative_to(ROOT).as_posix()

    def used_names(self) -> list[str]:
        """Return the names of three.js that the scripts use."""
        paths = [path for folder in self.folders for path in folder.glob("*.js")]
        texts = [path.read_text(encoding="utf-8") for path in paths if path != self.target]
        return sorted({name for text in texts for name in re.findall(r"\bTHREE\.(\w+)", text)})

    def build(self) -> bytes:
        """Return the module: the used names and what they need, minified, in one global object."""
        banner = f"/*!\nthree.js {read_version()}, https://threejs.org\n\n{read_licence()}\n*/"
        names = self.used_names()
        entry = f'export {{ {", ".join(n for n in names if n not in _ADDONS)} }} from "three";\n'
        for name in sorted(_ADDONS.keys() & names):
            entry += f'export {{ {name} }} from "{_ADDONS[name]}";\n'
        return bundle(entry, "--global-name=THREE", f"--banner:js={banner}")


VIEWER = Bundle(_PACKAGE / "viewing" / "three.js", (_PACKAGE / "viewing" / "script",))
STUDIO = Bundle(
    _PACKAGE / "studio" / "page" / "three.js", (*VIEWER.folders, _PACKAGE / "studio" / "page")
)
BUNDLES = (VIEWER, STUDIO)


def read_version() -> str:
    """Return the pinned version of three.js."""
    package = json.loads((FOLDER / "package.json").read_text(encoding="utf-8"))
    return str(package["dependencies"]["three"])


def read_licence() -> str:
    """Return the licence of three.js."""
    return (FOLDER / "LICENSE").read_text(encoding="utf-8").strip()


def bundle(entry: str, *options: str) -> bytes:
    """Return a script in JavaScript and the pinned packages that it imports as one script."""
    npm = shutil.which("npm")
    if npm is None:
        raise FileNotFoundError("npm is not installed")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in ("package.json", "package-lock.json"):
            shutil.copy(FOLDER / file, folder)
        subprocess.run([npm, "ci", "--ignore-scripts", "--no-audit"], cwd=folder, check=True)
        words = ["--bundle", "--minify", "--format=iife", "--target=es2022", "--charset=ascii"]
        done = subprocess.run(
            [folder / "node_modules/.bin/esbuild", *words, "--legal-comments=none", *options],
            cwd=folder,
            input=entry.encode(),
            check=True,
            stdout=subprocess.PIPE,
        )
    return done.stdout


def main(arguments: list[str]) -> int:
    """Write the modules and their hashes, or compare the modules with new builds."""
    parser = argparse.ArgumentParser(prog="python -m release.three", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the modules and their hashes")
    is_write = parser.parse_args(arguments).write
    lines, n_different = "", 0
    for own in BUNDLES:
        content = own.build()
        if is_write:
            own.target.write_bytes(content)
        is_same = own.target.read_bytes() == content
        n_different += not is_same
        print(f"{own.name}: {len(content)} bytes{'' if is_same else ', differs'}")
        lines += f"{hashlib.sha256(content).hexdigest()}  {own.name}\n"
    if is_write:
        DIGESTS.write_text(lines, encoding="utf-8")
    return 1 if n_different else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
