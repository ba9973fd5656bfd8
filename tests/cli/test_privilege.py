"""Commands in folders that the user may not write.

Root ignores the modes of files by a capability, which ``setpriv`` removes.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from mograft.cli import main

_IS_ROOT = os.name == "posix" and os.geteuid() == 0
_PREFIX = ("setpriv", "--bounding-set", "-dac_override,-dac_read_search") if _IS_ROOT else ()
pytestmark = pytest.mark.skipif(
    os.name != "posix" or (_IS_ROOT and shutil.which("setpriv") is None),
    reason="no modes of folders, or root without setpriv",
)


def run_unprivileged(*words, cwd):
    """Run Python so that the modes of files and folders hold, also for root."""
    return subprocess.run(
        [*_PREFIX, sys.executable, *map(str, words)],
        cwd=cwd,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.fixture
def locked_folder(clip):
    """A folder with a clip and a library that its user may only read."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(clip, folder / "a.bvh")
        assert main(["index", str(clip), "-o", str(folder / "library")]) == 0
        paths = [folder, *folder.rglob("*")]
        for path in paths:
            path.chmod(0o555 if path.is_dir() else 0o444)
        yield folder
        for path in paths:
            path.chmod(0o755)


def list_state(folder):
    """Return the paths, sizes and times of all files below a folder."""
    stats = {path: path.stat() for path in folder.rglob("*")}
    return {str(path): (stat.st_size, stat.st_mtime_ns) for path, stat in stats.items()}


WRITES = [
    ["graft", "a.bvh", "-o", "new.bvh"],
    ["index", "a.bvh", "-o", "new"],
    ["index", "a.bvh", "-o", "library", "--force"],
    ["index", "a.bvh", "-o", "library", "--add"],
    ["export", "a.bvh", "-o", "a.npz"],
    ["view", "a.bvh", "-o", "page.html"],
    ["lib", "export", "library", "--format", "csv", "-o", "tables"],
]
READS = [["info", "a.bvh"], ["lib", "info", "library"], ["lib", "verify", "library"]]
READS += [["candidates", "library", "--segment", "3"]]


@pytest.mark.parametrize("words", [*WRITES, *READS], ids="-".join)
def test_read_only_folder_is_read_or_named_in_one_line_and_never_changed(locked_folder, words):
    before = list_state(locked_folder)
    child = run_unprivileged("-m", "mograft", *words, cwd=locked_folder)
    assert child.returncode == (words in WRITES), child.stderr
    if words in WRITES:
        assert child.stderr.splitlines()[-1].startswith("error: ")
        assert "Permission denied" in child.stderr.splitlines()[-1]
    assert "Traceback" not in child.stderr
    assert list_state(locked_folder) == before


def test_unreadable_clip_is_named(locked_folder):
    (locked_folder / "a.bvh").chmod(0o000)
    child = run_unprivileged("-m", "mograft", "info", "a.bvh", cwd=locked_folder)
    assert (child.returncode, child.stderr) == (1, "error: a.bvh: Permission denied\n")
