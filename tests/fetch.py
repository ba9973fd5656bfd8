"""Download the programs that read files of mograft into ``.clients``, and install mograft-fbx.

The glTF validator and axe-core have the versions and the SHA-512 of ``gltf_validator`` and
``axe/package-lock.json``, which npm checks. The crates of mograft-fbx have the versions and the
SHA-256 of its ``Cargo.lock``.
Chromium is downloaded only if none is installed, by playwright, whose version determines its
version; playwright checks no hash. ``MOGRAFT_NO_CHROMIUM=1`` prevents this download.

Without a network or a C compiler this prints what is missing. The tests that need it skip with a
reason, so that no failure here is an error.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.browser import executable
from tests.clients import AXE, FETCHED, NODE_MODULES

LOCKED = Path(__file__).with_name("gltf_validator")
"""Folder of ``package.json`` and of the lock file with the hash of the glTF validator."""
_TIMEOUT_SECONDS = 240
_COMPILE_TIMEOUT_SECONDS = 900
_FBX = Path(__file__).parents[1] / "python-fbx"


def fetch():
    """Download the missing programs, and install mograft-fbx."""
    FETCHED.mkdir(exist_ok=True)
    print(f"Khronos glTF validator: {_npm('gltf-validator', NODE_MODULES, LOCKED)}", flush=True)
    print(f"axe-core: {_axe()}", flush=True)
    print(f"Chromium: {_chromium()}", flush=True)
    print(f"mograft-fbx: {_fbx()}", flush=True)


def _npm(package, modules, source):
    """Install a package of the lock file in `source` into `modules`; return what was done.

    ``npm ci`` installs nothing if the hash of a download differs from the lock file.
    """
    installed = modules / package / "package.json"
    is_fetched = FETCHED.resolve() in modules.resolve().parents
    if installed.exists():
        version = json.loads(installed.read_text(encoding="utf-8"))["version"]
        lock = json.loads((source / "package-lock.json").read_text(encoding="utf-8"))
        is_locked = version == lock["packages"][f"node_modules/{package}"]["version"]
        if is_locked or not is_fetched:
            return f"{version} in {modules}"
    if not is_fetched:
        return f"skipped: it is not in {modules}, and nothing is written outside of {FETCHED}"
    npm, folder = shutil.which("npm"), modules.parent
    if npm is None or shutil.which("node") is None:
        return "skipped: npm is not installed"
    folder.mkdir(exist_ok=True)
    for name in ("package.json", "package-lock.json"):
        shutil.copyfile(source / name, folder / name)
    words = [npm, "ci", "--prefix", str(folder), "--no-audit", "--no-fund", "--ignore-scripts"]
    return _run([*words, "--fetch-retries=1", "--fetch-timeout=30000"])


def _axe():
    if os.environ.get("MOGRAFT_AXE"):
        return str(AXE) if AXE.exists() else f"skipped: {AXE} does not exist"
    return _npm("axe-core", AXE.parents[1], LOCKED.with_name("axe"))


def _chromium():
    if importlib.util.find_spec("playwright") is None:
        return "skipped: playwright is not installed"
    found = executable()
    if found is not None:
        return found
    if os.environ.get("MOGRAFT_NO_CHROMIUM"):
        return "skipped: MOGRAFT_NO_CHROMIUM is set"
    os.environ.setdefault("PLAYWRIGHT_BROWSERS_PATH", str(FETCHED / "browsers"))
    return _run([sys.executable, "-m", "playwright", "install", "chromium"])


def has_c_compiler():
    """Return whether mograft-fbx can be compiled."""
    return shutil.which(os.environ.get("CC", "cc")) is not None


def _fbx():
    found = importlib.util.find_spec("mograft_fbx")
    sources = [path for path in _FBX.rglob("*") if path.suffix in {".rs", ".toml", ".pyi"}]
    sources = [path for path in sources if "target" not in path.relative_to(_FBX).parts]
    if found is not None and os.path.getmtime(found.origin) > max(map(os.path.getmtime, sources)):
        return found.origin
    if not has_c_compiler():
        return "skipped: there is no C compiler"
    words = [sys.executable, "-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps"]
    return _run([*words, str(_FBX)], _COMPILE_TIMEOUT_SECONDS, MATURIN_PEP517_ARGS="--locked")


def _run(words, timeout=_TIMEOUT_SECONDS, **variables):
    try:
        completed = subprocess.run(
            words,
            capture_output=True,
            text=True,
            check=False,
            timeout=timeout,
            env=os.environ | variables,
        )
    except subprocess.TimeoutExpired:
        return f"skipped: not finished after {timeout} s"
    except OSError as error:
        return f"skipped: {error}"
    if completed.returncode:
        lines = (completed.stderr or completed.stdout).strip().splitlines()
        reason = next((line for line in lines if "error" in line.lower()), "no message")
        return f"skipped: {reason}"
    return "installed"
