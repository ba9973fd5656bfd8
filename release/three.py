"""The part of three.js in pages and in the studio: ``python -m release.three --write``.

The versions are pinned in ``release/npm/package-lock.json``, with hashes. The module exports the
names that the scripts use, so that the same versions and scripts give the same bytes. It needs npm
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
from pathlib import Path

from release.distributions import ROOT

FOLDER = ROOT / "release" / "npm"
DIGEST = FOLDER / "three.sha256"
_PACKAGE = ROOT / "python" / "mograft"
TARGET = _PACKAGE / "viewing" / "three.js"
_SCRIPTS = (_PACKAGE / "viewing" / "script", _PACKAGE / "studio" / "page")
_CONTROLS = "three/examples/jsm/controls"
_ADDONS = {name: f"{_CONTROLS}/{name}.js" for name in ("OrbitControls", "TransformControls")}
"""Modules of the add-ons of three.js."""


def used_names() -> list[str]:
    """Return the names of three.js that the scripts use."""
    texts = [path.read_text("utf-8") for folder in _SCRIPTS for path in folder.glob("*.js")]
    return sorted({name for text in texts for name in re.findall(r"\bTHREE\.(\w+)", text)})


def build() -> bytes:
    """Return the module: the used names and what they need, minified, in one global object."""
    banner = f"/*!\nthree.js {read_version()}, https://threejs.org\n\n{read_licence()}\n*/"
    names = used_names()
    entry = f'export {{ {", ".join(n for n in names if n not in _ADDONS)} }} from "three";\n'
    for name in sorted(_ADDONS.keys() & names):
        entry += f'export {{ {name} }} from "{_ADDONS[name]}";\n'
    return bundle(entry, "--global-name=THREE", f"--banner:js={banner}")


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
    """Write the module and its hash, or compare the module with a new build."""
    parser = argparse.ArgumentParser(prog="python -m release.three", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the module and its hash")
    is_write = parser.parse_args(arguments).write
    content = build()
    if is_write:
        TARGET.write_bytes(content)
        DIGEST.write_text(f"{hashlib.sha256(content).hexdigest()}\n", encoding="utf-8")
    is_same = TARGET.read_bytes() == content
    print(f"{TARGET.name}: {len(content)} bytes{'' if is_same else ', differs'}")
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
