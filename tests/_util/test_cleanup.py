"""Cleanup at the end of a block, and of a process that a signal ends within it."""

import os
import subprocess
import sys
import time
from contextlib import nullcontext
from math import inf

import pytest

from mograft._util.signals import clean_up_by


@pytest.mark.parametrize("error", [None, ValueError, KeyboardInterrupt])
def test_clean_up_block_ends_calls_action_once(error):
    calls = []
    with pytest.raises(error) if error else nullcontext(), clean_up_by(lambda: calls.append(1)):
        assert calls == []
        if error:
            raise error
    assert calls == [1]


posix_only = pytest.mark.skipif(os.name != "posix", reason="the platform has no such signals")


PRELUDE = """
import hashlib, os, signal, sys, threading, time
from mograft._util.signals import clean_up, clean_up_by
from mograft._util.signals import delay_signals, end_on_signals
"""


def run_python(code):
    """Run a program after `PRELUDE`; return its exit code, stdout and stderr."""
    command = [sys.executable, "-c", PRELUDE + code]
    child = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return child.returncode, child.stdout, child.stderr


def assert_ends_soon(code, expected):
    """Assert the result of a program, and that it ends within 5 s.

    Other processes may delay one run, or two: the limit is for an idle machine.
    """
    seconds = []
    while len(seconds) < 3 and min(seconds, default=inf) >= 5:
        start = time.monotonic()
        assert run_python(code) == expected
        seconds.append(time.monotonic() - start)
    assert min(seconds) < 5


def test_clean_up_process_exits_calls_action_once():
    code = """
blocks = [clean_up_by(lambda each=each: print(each)) for each in range(3)]
for block in blocks:
    block.__enter__()
blocks[1].__exit__(None, None, None)
"""
    returncode, out, err = run_python(code + "sys.stdout.flush(); sys.exit(5)")
    # Python also closes the generators of the blocks after the exit handlers; cleanup may repeat.
    assert (returncode, out.split()[:3], err) == (5, ["1", "2", "0"], "")


@posix_only
def test_clean_up_forked_child_leaves_parents_files():
    code = """
block = clean_up_by(lambda: print("action", flush=True))
block.__enter__()
child = os.fork()
if child == 0:
    clean_up()
    os._exit(0)
os.waitpid(child, 0)
print("parent", flush=True)
block.__exit__(None, None, None)
"""
    assert run_python(code)[1].split() == ["parent", "action"]


@posix_only
@pytest.mark.usefixtures("hangup_not_ignored")
@pytest.mark.parametrize(
    ("name", "code", "text"),
    [
        ("SIGINT", 130, "interrupted"),
        ("SIGTERM", 143, "terminated"),
        ("SIGHUP", 129, "the terminal was closed"),
    ],
)
def test_signal_ends_process_with_cleanup_and_without_unwinding(name, code, text):
    program = f"""
end_on_signals()
try:
    with clean_up_by(lambda: os.write(1, b"clean")):
        signal.raise_signal(signal.{name})
finally:
    os.write(1, b"unwound")
"""
    assert run_python(program) == (code, "clean", f"{text}\n")


@posix_only
def test_signal_within_kernel_ends_process_soon():
    # The main thread is in C code for minutes: its handler is not called.
    program = """
end_on_signals()
with clean_up_by(lambda: os.write(1, b"clean")):
    threading.Timer(0.2, lambda: os.kill(os.getpid(), 15)).start()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2_000_000_000)
"""
    assert_ends_soon(program, (143, "clean", "terminated\n"))


@posix_only
def test_signal_with_blocked_cleanup_ends_process_soon():
    program = """
end_on_signals()
with clean_up_by(lambda: time.sleep(600)):
    signal.raise_signal(signal.SIGTERM)
"""
    assert_ends_soon(program, (143, "", "terminated\n"))


IGNORED = """
signal.signal(signal.SIGHUP, signal.SIG_IGN)
end_on_signals()
signal.raise_signal(signal.SIGHUP)
print("alive")
"""
DELAYED = """
end_on_signals()
with delay_signals():
    signal.raise_signal(signal.SIGTERM)
    os.write(1, b"block")
os.write(1, b"never")
"""


@posix_only
@pytest.mark.parametrize(
    ("program", "expected"),
    [(IGNORED, (0, "alive\n", "")), (DELAYED, (143, "block", "terminated\n"))],
    ids=["ignored at start", "delayed"],
)
def test_signal_that_is_ignored_or_delayed_does_not_end_the_block(program, expected):
    assert run_python(program) == expected
