"""SIGINT, SIGTERM and SIGHUP end commands and their workers soon and leave nothing behind."""

import os
import random
import select
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from itertools import product
from pathlib import Path

import pytest

from mograft.cli import main
from tests.cli.test_process import assert_complete, running, wait_until

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="finds processes in /proc"
)
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


def list_session(session, words=b""):
    """Return the ids of the processes of a session that have not ended, with words of a command."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # the process has ended
            state, _, _, other = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(other) == session and state not in "ZX":
                found += [int(folder.name)] * (words in (folder / "cmdline").read_bytes())
    return found


def wait_until_session_ends(child):
    """Wait until a process and all others of its session have ended; return what it printed."""
    out, err = child.communicate(timeout=60)
    wait_until(lambda: not list_session(child.pid))
    return out, err


def has_workers(child):
    is_begun = any(Path().glob(".mograft-*/**/frames*"))
    return is_begun and len(list_session(child.pid, b"spawn_main")) == 2


def has_printed(child):
    return select.select([child.stdout], [], [], 0.0)[0]


def is_drawing(child):
    """Return whether a process has loaded Pillow for half a second or more."""
    if "_imaging" not in Path(f"/proc/{child.pid}/maps").read_text():
        return False
    time.sleep(0.5)
    return True


GIF = ["export", "SLOW", "-o", "x.gif", "--size", "64x64", "--rate", "50"]
MP4 = ["export", "SLOW", "-o", "x.mp4", "--size", "1920x1080", "--rate", "50"]
# Each command has work for minutes, a GIF for half of one.
COMMANDS = {
    "graft": (["graft", "CLIP", "-o", "out", "-n", "3000"], "out/*.bvh"),
    "index": (["index", "MANY", "-o", "lib"], ".mograft-*/**/frames*"),
    "index workers": (["index", "MANY", "-o", "lib", "-j", "2"], ".mograft-*/**/frames*"),
    "export": (GIF, is_drawing),
    "film": (MP4, "*.part"),
    "stream": (["stream", "CLIP", "--port", "0"], has_printed),
}
"""Words of commands, and the files that exist while they run, or a condition."""


BOTH = (signal.SIGINT, signal.SIGTERM)
CASES = [*product(COMMANDS, BOTH), ("index workers", signal.SIGHUP)]


@pytest.fixture
def places(clip, folder_of_many_clips, slow_clip):
    return {"CLIP": clip, "MANY": folder_of_many_clips, "SLOW": slow_clip}


def end_by_signal(name, number, places):
    """Run a command and end it by a signal; return the seconds until all its processes ended."""
    words, files = COMMANDS[name]
    with running(*(places.get(word, word) for word in words)) as child:
        wait_until(lambda: files(child) if callable(files) else any(Path().glob(files)), child)
        # Only Ctrl-C reaches the workers as well.
        (os.killpg if number == signal.SIGINT else os.kill)(child.pid, number)
        begin = time.monotonic()
        _, err = wait_until_session_ends(child)
        seconds = time.monotonic() - begin
    assert child.returncode == SIGNALS[number]
    assert err.splitlines()[-1] in ("interrupted", "terminated", "the terminal was closed")
    assert name == "graft" or len(err.splitlines()) == 1
    assert "Traceback" not in err
    assert {path.name for path in Path().iterdir()} == ({"out"} if name == "graft" else set())
    for path in assert_complete(Path()):
        assert path.with_suffix(".json").exists()
    shutil.rmtree("out", ignore_errors=True)
    return seconds


@pytest.mark.usefixtures("hangup_not_ignored", "working_folder")
@pytest.mark.parametrize(("name", "number"), CASES)
def test_signal_ends_command_and_workers_soon_and_leaves_no_draft(places, name, number):
    """Other processes may delay one end, or two: the promise of 2 s is for an idle machine."""
    if name == "export":
        pytest.importorskip("PIL", reason="Pillow is not installed")
    if name == "film":
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    assert any(end_by_signal(name, number, places) < 2 for _ in range(3))


@pytest.mark.usefixtures("working_folder")
@pytest.mark.parametrize("number", BOTH)
def test_signal_while_adding_keeps_library_and_removes_new_generation(
    clip, folder_of_many_clips, number
):
    assert main(["index", str(clip), "-o", "lib"]) == 0
    before = sorted(path for path in Path("lib").rglob("*") if path.name != ".lock")
    with running("index", folder_of_many_clips, "-o", "lib", "--add", "-j", "2") as child:
        wait_until(lambda: any(Path("lib/0002").glob("samples-0002.npy")), child)
        child.send_signal(number)
        child.communicate(timeout=60)
    assert child.returncode == SIGNALS[number]
    assert sorted(path for path in Path("lib").rglob("*") if path.name != ".lock") == before
    assert main(["lib", "verify", "lib"]) == 0


@pytest.mark.usefixtures("working_folder")
def test_killed_command_workers_end(folder_of_many_clips):
    with running("index", folder_of_many_clips, "-o", "lib", "-j", "2") as child:
        wait_until(lambda: has_workers(child), child)
        child.kill()
        wait_until_session_ends(child)


def test_killed_worker_raises_clear_error(working_folder, folder_of_many_clips):
    with running("index", folder_of_many_clips, "-o", "lib", "-j", "2") as child:
        wait_until(lambda: has_workers(child), child)
        os.kill(list_session(child.pid, b"spawn_main")[0], signal.SIGKILL)
        _, err = wait_until_session_ends(child)
    assert child.returncode == 1
    assert err.startswith("error: a worker process was killed")
    assert len(err.splitlines()) == 1
    assert list(working_folder.iterdir()) == []


AT_IMPORT = """
import sys
from os import getpid, kill

class Sender:
    left = {n}
    def find_spec(self, name, *_, kill=kill, me=getpid()):
        if name == "mograft._util.signals" or Sender.left < {n}:
            Sender.left -= 1
            if Sender.left == 0:
                kill(me, {number})

sys.meta_path.insert(0, Sender())
from mograft.__main__ import main
sys.argv = ["mograft", *{words}]
code = main()
print("imports", {n} - Sender.left)
sys.exit(code)
"""
AT_END = """
import sys
from os import getpid, kill
from mograft.__main__ import main

class Sender:
    def __del__(self, kill=kill, me=getpid()):
        kill(me, {number})

sender = Sender()
sys.argv = ["mograft", "--version"]
sys.exit(main())
"""


def run_python(program, **values):
    """Run a program that sends itself a signal."""
    words = [sys.executable, "-c", program.format(**values)]
    return subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("number", BOTH)
def test_signal_at_any_import_ends_without_traceback(clip, request, number):
    """The first import is that of the module that handles signals."""
    values = {"number": int(number), "words": ["info", str(clip)]}
    n_imports = int(run_python(AT_IMPORT, n=10**6, **values).stdout.split()[-1])
    numbers = {1, 2, n_imports} | set(random.Random(0).sample(range(3, n_imports), 3))
    if request.config.getoption("--thorough"):
        numbers = range(1, n_imports + 1)
    for n in numbers:
        child = run_python(AT_IMPORT, n=n, **values)
        line = {signal.SIGINT: "interrupted\n", signal.SIGTERM: "terminated\n"}[number]
        assert (child.returncode, child.stderr) == (SIGNALS[number], line), n


@pytest.mark.parametrize("number", BOTH)
def test_signal_while_python_ends_changes_nothing(number):
    child = run_python(AT_END, number=int(number))
    assert (child.returncode, child.stderr) == (0, "")
    assert child.stdout.startswith("mograft ")
