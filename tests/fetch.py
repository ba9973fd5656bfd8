"""Download the programs that read files of mograft into ``.clients``.

Without a network this prints which program is missing. The tests that need it skip with a
reason, so that no failure here is an error.
"""

import importlib.util
import os
import shutil
import subprocess
import sys

from tests.browser import executable
from tests.clients import FETCHED, NODE_MODULES

VALIDATOR = "gltf-validator@2.0.0-dev.3.10"
_TIMEOUT_SECONDS = 240


def fetch():
    """Download the missing programs."""
    FETCHED.mkdir(exist_ok=True)
    print(f"Khronos glTF validator: {_validator()}", flush=True)
    print(f"Chromium: {_chromium()}", flush=True)


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


def _run(words):
    try:
        completed = subprocess.run(
            words, capture_output=True, text=True, check=False, timeout=_TIMEOUT_SECONDS
        )
    except subprocess.TimeoutExpired:
        return f"skipped: not finished after {_TIMEOUT_SECONDS} s"
    except OSError as error:
        return f"skipped: {error}"
    if completed.returncode:
        lines = (completed.stderr or completed.stdout).strip().splitlines()
        reason = next((line for line in lines if "error" in line.lower()), "no message")
        return f"skipped: {reason}"
    return "fetched"
