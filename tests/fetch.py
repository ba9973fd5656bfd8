"""Fetch the programs that read our files, as far as there is a network; say what is missing.

They are kept in ``.clients``. The tests that need one skip with the reason where it is absent,
so that nothing here is an error.
"""

import importlib.util
import os
import shutil
import subprocess
import sys

from tests.browser import executable
from tests.clients import FETCHED, NODE_MODULES

VALIDATOR = "gltf-validator@2.0.0-dev.3.10"
_SECONDS = 240


def fetch():
    """Fetch what is not there yet."""
    FETCHED.mkdir(exist_ok=True)
    print(f"Khronos glTF validator: {_validator()}", flush=True)
    print(f"Chromium: {_chromium()}", flush=True)


def _validator():
    if (NODE_MODULES / "gltf-validator").is_dir():
        return f"in {NODE_MODULES}"
    npm = shutil.which("npm")
    if npm is None or shutil.which("node") is None:
        return "left out, there is no npm"
    words = [npm, "install", "--prefix", str(FETCHED), "--no-audit", "--no-fund"]
    words += ["--ignore-scripts", "--fetch-retries=1", "--fetch-timeout=30000", VALIDATOR]
    return _run(words)


def _chromium():
    if importlib.util.find_spec("playwright") is None:
        return "left out, playwright is not installed"
    found = executable()
    if found is not None:
        return found
    os.environ.setdefault("PLAYWRIGHT_BROWSERS_PATH", str(FETCHED / "browsers"))
    return _run([sys.executable, "-m", "playwright", "install", "chromium"])


def _run(words):
    try:
        told = subprocess.run(words, capture_output=True, text=True, check=False, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        return f"left out, {_SECONDS} s were not enough"
    except OSError as error:
        return f"left out, {error}"
    if told.returncode:
        said = (told.stderr or told.stdout).strip().splitlines()
        why = next((line for line in said if "error" in line.lower()), "no word of why")
        return f"left out: {why}"
    return "fetched"
