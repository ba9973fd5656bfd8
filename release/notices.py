"""Licences of included software and bills of materials: ``python -m release.notices --write``.

Both files lie beside each ``pyproject.toml``, and wheels and source distributions contain them.
They depend on ``Cargo.lock`` and on three.js only, and a test compares them with the crates.
"""

import argparse
import hashlib
import json
import sys
import tomllib
import uuid
from typing import Any

from release.crates import Crate, read_crates
from release.distributions import DISTRIBUTIONS, ROOT, Distribution
from release.three import TARGET, read_licence, read_version

_LICENCES_ELSEWHERE = {"ufbx": ROOT / "python-fbx" / "LICENSE-ufbx"}
"""Licence files of crates whose packages have none."""

_STANDARD_LIBRARY = """\
The Rust standard library, https://github.com/rust-lang/rust
Licence: MIT OR Apache-2.0

Copyright (c) The Rust Project Contributors

"""
_RULE = "=" * 80


def render_licences(distribution: Distribution, crates: list[Crate]) -> str:
    """Return the licences of the Rust standard library and of all crates from crates.io."""
    permission = (ROOT / "LICENSE").read_text(encoding="utf-8").partition("\n\n")[2]
    permission = permission.partition("\n\n")[2].strip()
    sections = [
        f"The extension module of {distribution.name} contains the following software.\n"
        "This file is written by: python -m release.notices --write\n",
        _STANDARD_LIBRARY + permission + "\n",
    ]
    for crate in crates:
        if crate.checksum is None:
            continue
        texts = crate.read_licences()
        if not texts and crate.name in _LICENCES_ELSEWHERE:
            texts = [_LICENCES_ELSEWHERE[crate.name].read_text(encoding="utf-8").strip()]
        if not texts:
            raise ValueError(f"{crate.key} has no licence file; add one to _LICENCES_ELSEWHERE")
        head = f"{crate.key}, {crate.repository}\nLicence: {crate.licence}\n"
        sections.append("\n".join([head, *(f"{text}\n" for text in texts)]))
    if distribution.name == "mograft":
        head = f"three.js {read_version()}, https://threejs.org, in pages and in three.js\n"
        sections.append(f"{head}Licence: MIT\n\n{read_licence()}\n")
    return f"{_RULE}\n".join(sections)


def render_bill(distribution: Distribution, crates: list[Crate]) -> str:
    """Return the bill of materials, in the format CycloneDX 1.6.

    It has no time stamp, and its serial number is computed from its content, so that the same
    crates give the same bytes.
    """
    project = tomllib.loads((distribution.folder / "pyproject.toml").read_text(encoding="utf-8"))
    root = f"pkg:pypi/{distribution.name}@{distribution.version}"
    packages = [_name_requirement(text) for text in project["project"]["dependencies"]]
    keys = {crate.key: f"pkg:cargo/{crate.name}@{crate.version}" for crate in crates}
    linked = {key for crate in crates for key in crate.dependencies}
    tops = sorted(keys[crate.key] for crate in crates if crate.key not in linked)
    bill: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "library",
                "bom-ref": root,
                "name": distribution.name,
                "version": distribution.version,
                "licenses": [{"expression": "MIT"}],
                "purl": root,
            }
        },
        "components": [
            *({"type": "library", "bom-ref": p, "name": n, "purl": p} for n, p in packages),
            *(_describe_crate(crate, keys[crate.key]) for crate in crates),
            *([_describe_three()] if distribution.name == "mograft" else []),
        ],
        "dependencies": [
            {"ref": root, "dependsOn": [*(purl for _, purl in packages), *tops]},
            *(
                {"ref": keys[crate.key], "dependsOn": [keys[key] for key in crate.dependencies]}
                for crate in crates
            ),
        ],
    }
    content = json.dumps(bill, sort_keys=True)
    bill["serialNumber"] = uuid.uuid5(uuid.NAMESPACE_URL, content).urn
    return json.dumps(bill, indent=2, sort_keys=True) + "\n"


def _name_requirement(text: str) -> tuple[str, str]:
    """Return name and package URL of a requirement such as ``numpy>=1.26``."""
    name = text.partition(">=")[0].strip()
    return name, f"pkg:pypi/{name}"


def _describe_crate(crate: Crate, purl: str) -> dict[str, Any]:
    component: dict[str, Any] = {
        "type": "library",
        "bom-ref": purl,
        "name": crate.name,
        "version": crate.version,
        "licenses": [{"expression": crate.licence}],
        "purl": purl,
    }
    if crate.checksum is not None:
        component["hashes"] = [{"alg": "SHA-256", "content": crate.checksum}]
    return component


def _describe_three() -> dict[str, Any]:
    purl = f"pkg:npm/three@{read_version()}"
    digest = hashlib.sha256(TARGET.read_bytes()).hexdigest()
    hashes = [{"alg": "SHA-256", "content": digest}]
    named = {"type": "library", "bom-ref": purl, "name": "three", "version": read_version()}
    return {**named, "licenses": [{"expression": "MIT"}], "purl": purl, "hashes": hashes}


def render_notices(distribution: Distribution) -> dict[str, str]:
    """Return the content of both files by path relative to the repository."""
    crates = read_crates(distribution)
    return {
        str(distribution.licences.relative_to(ROOT)): render_licences(distribution, crates),
        str(distribution.bill.relative_to(ROOT)): render_bill(distribution, crates),
    }


def find_stale_notices() -> list[str]:
    """Return the paths of files that differ from the crates of ``Cargo.lock``."""
    contents = {p: c for d in DISTRIBUTIONS for p, c in render_notices(d).items()}
    return [
        path
        for path, content in contents.items()
        if not (ROOT / path).exists() or (ROOT / path).read_text(encoding="utf-8") != content
    ]


def main(arguments: list[str]) -> int:
    """Write the files, or list those that are not current."""
    parser = argparse.ArgumentParser(prog="python -m release.notices", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the files")
    is_write = parser.parse_args(arguments).write
    stale = find_stale_notices()
    for distribution in DISTRIBUTIONS if is_write else ():
        for path, content in render_notices(distribution).items():
            (ROOT / path).write_text(content, encoding="utf-8")
    for path in stale:
        print(f"{path}: {'written' if is_write else 'stale; write it with --write'}")
    return 1 if stale and not is_write else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
