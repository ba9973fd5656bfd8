"""SIGINT, SIGTERM and SIGHUP end commands and their workers soon and leave nothing behind."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mograft.cli import main
from tests.cli.test_process import assert_complete, start, wait_until

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="finds processes in /proc"
)
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


def list_session(session):
    """Return the ids of the processes of a session that have not ended."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, other = stat.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue  # the process has ended
        if int(other) == session and state not in "ZX":
            found.append(int(stat.parent.name))
    return found


def assert_session_ends(session, seconds=2.0):
    """Assert that all processes of a session end in time; kill the others."""
    end = time.monotonic() + seconds
    while list_session(session) and time.monotonic() < end:
        time.sleep(0.01)
    left = list_session(session)
    for process_id in left:
        os.kill(process_id, signal.SIGKILL)
    assert not left


@pytest.fixture
def many_clips(working_folder, clip):
    (working_folder / "clips").mkdir()
    for number in range(40):
        shutil.copy(clip, working_folder / "clips" / f"c{number}.bvh")
    return working_folder


COMMANDS = {
    "graft": (["graft", "CLIP", "-o", "out", "-n", "400"], lambda: any(Path().glob("out/*.bvh"))),
    "index": (["index", "clips", "-o", "lib"], lambda: any(Path().glob(".lib*/*/frames*"))),
    "index workers": (
        ["index", "clips", "-o", "lib", "-j", "2"],
        lambda: any(Path().glob(".lib*/*/frames*")),
    ),
    "export": (["export", "CLIP", "-o", "x.gif", "--size", "1920x1080"], lambda: has_draft()),
    "stream": (["stream", "CLIP", "--socket", "socket"], lambda: Path("socket").exists()),
}


def has_draft():
    return any(path.suffix == ".part" for path in Path().iterdir())


def make_cases():
    """Yield each command with each signal; a plain run has SIGTERM, and all with workers."""
    for name in COMMANDS:
        for number in SIGNALS:
            is_quick = number == signal.SIGTERM or name == "index workers"
            marks = () if is_quick else pytest.mark.thorough
            yield pytest.param(name, number, marks=marks)


@pytest.mark.parametrize(("name", "number"), list(make_cases()))
def test_signal_ends_command_and_workers_and_leaves_no_draft(many_clips, clip, name, number):
    if name == "export":
        pytest.importorskip("PIL", reason="Pillow is not installed")
    words, is_running = COMMANDS[name]
    child = start(*(clip if word == "CLIP" else word for word in words))
    wait_until(is_running, child)
    assert child.poll() is None
    # Only Ctrl-C reaches the workers as well.
    (os.killpg if number == signal.SIGINT else os.kill)(child.pid, number)
    begin = time.monotonic()
    _, err = child.communicate(timeout=60)
    assert time.monotonic() - begin < 2
    assert_session_ends(child.pid)
    assert child.returncode == SIGNALS[number]
    assert err.splitlines()[-1] in ("interrupted", "terminated", "the terminal was closed")
    assert name == "graft" or len(err.splitlines()) == 1
    assert "Traceback" not in err
    left = {path.name for path in many_clips.iterdir()} - {"clips"}
    assert left == ({"out"} if name == "graft" else set())
    for path in assert_complete(many_clips):
        assert path.parent.name == "clips" or path.with_suffix(".json").exists()


@pytest.mark.usefixtures("many_clips")
def test_sigterm_while_adding_keeps_library_and_removes_new_generation(clip):
    assert main(["index", str(clip), "-o", "lib"]) == 0
    before = sorted(path for path in Path("lib").rglob("*") if path.name != ".lock")
    child = start("index", "clips", "-o", "lib", "--add", "-j", "2")
    wait_until(lambda: any(Path("lib/0002").glob("samples-0002.npy")), child)
    child.terminate()
    child.communicate(timeout=60)
    assert child.returncode == 143
    assert sorted(path for path in Path("lib").rglob("*") if path.name != ".lock") == before
    assert main(["lib", "verify", "lib"]) == 0


@pytest.mark.usefixtures("many_clips")
def test_killed_command_workers_end():
    child = start("index", "clips", "-o", "lib", "-j", "2")
    wait_until(COMMANDS["index"][1], child)
    assert len(list_session(child.pid)) >= 3
    child.kill()
    child.communicate(timeout=60)
    assert_session_ends(child.pid)


@pytest.mark.thorough  # in rare cases the pool of Python does not notice the killed worker
def test_killed_worker_raises_clear_error(many_clips):
    child = start("index", "clips", "-o", "lib", "-j", "2")
    wait_until(COMMANDS["index"][1], child)
    commands = {
        each: Path(f"/proc/{each}/cmdline").read_bytes() for each in list_session(child.pid)
    }
    worker = next(each for each, words in commands.items() if b"spawn_main" in words)
    os.kill(worker, signal.SIGKILL)
    _, err = child.communicate(timeout=60)
    assert_session_ends(child.pid)
    assert child.returncode == 1
    assert err.startswith("error: a worker process was killed")
    assert len(err.splitlines()) == 1
    assert [path.name for path in many_clips.iterdir()] == ["clips"]


AT_IMPORT = """
import signal, sys
from mograft._util import signals

class Counter:
    left = {n}
    def find_spec(self, *_):
        Counter.left -= 1
        if Counter.left == 0:
            signal.raise_signal(signal.SIGINT)

from mograft.__main__ import main
sys.meta_path.insert(0, Counter())
sys.argv = ["mograft", *{words}]
code = main()
print("imports", {n} - Counter.left)
sys.exit(code)
"""


def run_interrupted(n, *words):
    """Run a command that interrupts itself at its `n`-th import."""
    return subprocess.run(
        [sys.executable, "-c", AT_IMPORT.format(n=n, words=list(map(str, words)))],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_interrupt_at_any_import_ends_without_traceback(clip, request):
    n_imports = int(run_interrupted(10**6, "info", clip).stdout.split()[-1])
    numbers = {1, 2, n_imports} | set(random.Random(0).sample(range(3, n_imports), 3))
    if request.config.getoption("--thorough"):
        numbers = range(1, n_imports + 1)
    for n in numbers:
        child = run_interrupted(n, "info", clip)
        assert (child.returncode, child.stderr) == (130, "interrupted\n"), n


@pytest.mark.thorough
def test_interrupt_at_random_moments_prints_no_traceback_of_the_package(clip):
    """Before the first lines of the program, Python itself prints a traceback."""
    moments = random.Random(1)
    for _ in range(200):
        child = start("info", clip)
        time.sleep(moments.uniform(0, 0.6))
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=60)
        assert child.returncode in (0, 130, -signal.SIGINT) or "mograft" not in err
        assert "mograft/cli" not in err
        assert "mograft/_util" not in err
