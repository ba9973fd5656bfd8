"""Properties of locks between processes."""

import subprocess
import sys

import pytest

from mograft._util.lock import exclusive_lock

HOLD_SCRIPT = """
import sys
from pathlib import Path
from mograft._util.lock import exclusive_lock
with exclusive_lock(Path(sys.argv[1])):
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_exclusive_lock_held_by_other_process_raises_until_it_ends(tmp_path):
    path = tmp_path / ".lock"
    command = [sys.executable, "-c", HOLD_SCRIPT, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline().strip() == b"locked"
        with pytest.raises(BlockingIOError), exclusive_lock(path):
            pass
        process.kill()
    with exclusive_lock(path):
        pass
    assert path.read_bytes() == b""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other locks")
def test_exclusive_lock_without_platform_support_raises_os_error(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fcntl", None)
    with pytest.raises(OSError, match="no file locks"), exclusive_lock(tmp_path / ".lock"):
        pass
