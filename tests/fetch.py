"""Download the programs that read files of mograft into ``.clients``, and install mograft-fbx.

Without a network or a C compiler this prints what is missing. The tests that need it skip with a
reason, so that no failure here is an error.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.browser import executable
from tests.clients import FETCHED, NODE_MODULES

VALIDATOR = "gltf-validator@2.0.0-dev.3.10"
_TIMEOUT_SECONDS = 240
_COMPILE_TIMEOUT_SECONDS = 900
_FBX = Path(__file__).parents[1] / "python-fbx"


def fetch():
    """Download the missing programs, and install mograft-fbx."""
    FETCHED.mkdir(exist_ok=True)
    print(f"Khronos glTF validator: {_validator()}", flush=True)
    print(f"Chromium: {_chromium()}", flush=True)
    print(f"mograft-fbx: {_fbx()}", flush=True)


def _validator():
    if (NODE_MODULES / "gltf-validator").is_dir():
        return f"in {NODE_MODULES}"
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        return "skipped: npm is not installed"
    words = [npm, "install", "--prefix", str(FETCHED), "--no-audit", "--no-fund"]
    words += ["--ignore-scripts", "--fetch-retries=1", "--fetch-timeout=30000", VALIDATOR]
    return _run(words)


def _chromium():
    if importlib.util.find_spec("playwright") is None:
        return "skipped: playwright is not installed"
    found = executable()
    if found is not None:
        return found
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
    return _run([*words, str(_FBX)], _COMPILE_TIMEOUT_SECONDS)


def _run(words, timeout=_TIMEOUT_SECONDS):
    try:
        completed = subprocess.run(
            words, capture_output=True, text=True, check=False, timeout=timeout
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
