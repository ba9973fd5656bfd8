"""The programs that a release needs, in an environment of their own with checked hashes."""

import hashlib
import os
import subprocess
import sys
import venv
from pathlib import Path

from release.distributions import WORK

_REQUIREMENTS = Path(__file__).with_name("requirements.txt")
_FOLDER = WORK / "tools"
_BIN = "Scripts" if sys.platform == "win32" else "bin"


def bin_of(environment: Path) -> Path:
    """Return the folder of the programs of a virtual environment."""
    return environment / _BIN


def install_tools() -> Path:
    """Install the pinned programs unless they are installed; return their folder."""
    digest = hashlib.sha256(_REQUIREMENTS.read_bytes()).hexdigest()
    stamp = _FOLDER / "installed"
    if not (stamp.exists() and stamp.read_text(encoding="utf-8") == digest):
        venv.create(_FOLDER, clear=True, with_pip=True)
        python = bin_of(_FOLDER) / "python"
        words = ["-m", "pip", "install", "--quiet", "--require-hashes", "--only-binary", ":all:"]
        subprocess.run([python, *words, "-r", _REQUIREMENTS], check=True)
        stamp.write_text(digest, encoding="utf-8")
    return bin_of(_FOLDER)


def run_tool(name: str, *words: str | Path, cwd: Path | None = None) -> None:
    """Run an installed program; raise CalledProcessError if it fails."""
    folder = install_tools()
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    command = [str(folder / name), *map(str, words)]
    print(f"$ {name} {' '.join(map(str, words))}", flush=True)
    subprocess.run(command, cwd=cwd, env=os.environ | {"PATH": path}, check=True)
