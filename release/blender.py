"""Build the Blender extension from a wheel: ``python -m release.blender WHEEL``.

The zip is for the platform of the wheel, which it contains unmodified. The same wheel gives the
same bytes.
"""

import argparse
import ast
import re
import sys
import tomllib
import zipfile
from pathlib import Path

from release.distributions import ROOT

FOLDER = ROOT / "blender"
SOURCES = FOLDER / "extension"
WHEEL = re.compile(r"mograft-(?P<version>[^-]+)-cp3\d+-abi3-(?P<tags>[\w.]+)\.whl")
PLATFORMS = {
    r"manylinux\w*_x86_64": ["linux-x64"],
    r"manylinux\w*_aarch64": ["linux-arm64"],
    r"win_amd64": ["windows-x64"],
    r"win_arm64": ["windows-arm64"],
    r"macosx\w*_universal2": ["macos-arm64", "macos-x64"],
    r"macosx\w*_arm64": ["macos-arm64"],
    r"macosx\w*_x86_64": ["macos-x64"],
}
"""By the platform tag of a wheel, the platforms of Blender."""

ALLOWED_IMPORTS = {
    *("bl_ui", "bpy", "mathutils", "mograft", "numpy"),
    *(
        "contextlib",
        "dataclasses",
        "hashlib",
        "json",
        "pathlib",
        "re",
        "threading",
        "traceback",
        "warnings",
    ),
}
"""Packages that the extension may import: none of them opens connections or starts processes."""


def main(words: list[str] | None = None) -> int:
    """Build the zip and print its path."""
    parser = argparse.ArgumentParser(description="Build the Blender extension from a wheel.")
    parser.add_argument("wheel", type=Path, help="abi3 wheel of mograft")
    parser.add_argument("-o", "--output", type=Path, default=Path("dist"), help="folder of the zip")
    options = parser.parse_args(words)
    try:
        print(build(options.wheel, options.output))
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def build(wheel: Path, output: Path) -> Path:
    """Write the zip of the extension with a wheel into a folder, and return its path."""
    found = WHEEL.fullmatch(wheel.name)
    tags = found["tags"].split(".") if found else []
    names = [own for tag in tags for key, own in PLATFORMS.items() if re.fullmatch(key, tag)]
    platforms = sorted({platform for own in names for platform in own})
    if found is None or not platforms:
        raise ValueError(f"expected an abi3 wheel of mograft for a platform, got {wheel.name}")
    files = {
        "LICENSE": (FOLDER / "LICENSE").read_bytes(),
        "blender_manifest.toml": _manifest(found["version"], platforms, wheel.name),
        f"wheels/{wheel.name}": wheel.read_bytes(),
    }
    for path in sorted(SOURCES.glob("*.py")):
        files[path.name] = path.read_bytes()
        check_imports(path)
    output.mkdir(parents=True, exist_ok=True)
    target = output / f"mograft-blender-{found['version']}-{'-'.join(platforms)}.zip"
    draft = target.with_suffix(".zip.part")
    with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    draft.replace(target)
    return target


def _manifest(version: str, platforms: list[str], wheel: str) -> bytes:
    """Return the manifest with the version, platforms and wheel of a zip."""
    text = (SOURCES / "blender_manifest.toml").read_text(encoding="utf-8")
    values = {
        "version": f'"{version}"',
        "platforms": str(platforms).replace("'", '"'),
        "wheels": f'["./wheels/{wheel}"]',
    }
    for key, value in values.items():
        text, n = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        if n != 1:
            raise ValueError(f"blender_manifest.toml must have one line for {key}, got {n}")
    tomllib.loads(text)
    return text.encode()


def check_imports(path: Path) -> None:
    """Raise ValueError if a module imports a package that is not in `ALLOWED_IMPORTS`."""
    for node in ast.walk(ast.parse(path.read_bytes(), str(path))):
        names = [own.name for own in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module or ""]
        for name in names:
            if name.partition(".")[0] not in ALLOWED_IMPORTS:
                raise ValueError(f"{path.name}:{node.lineno}: {name} is not an allowed import")


if __name__ == "__main__":
    sys.exit(main())
