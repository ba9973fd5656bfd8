"""Cleanup at the end of a block, and of a process that a signal ends within it."""

import os
import subprocess
import sys
import time
from contextlib import nullcontext

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


PRELUDE = """
import hashlib, os, signal, sys, threading, time
from mograft._util.signals import clean_up, clean_up_by
from mograft._util.signals import delay_signals, end_on_signals
end_on_signals()
"""
# Python also closes the generators of the blocks after the exit handlers; cleanup may repeat.
EXITS = """
blocks = [clean_up_by(lambda each=each: os.write(1, each)) for each in (b"0", b"1", b"2")]
for block in blocks:
    block.__enter__()
blocks[1].__exit__(None, None, None)
sys.exit(5)
"""
FORKS = """
with clean_up_by(lambda: os.write(1, b"action")):
    if not os.fork():
        clean_up()
        os._exit(0)
    os.wait()
    os.write(1, b"parent ")
"""
ENDED = """
try:
    with clean_up_by(lambda: os.write(1, b"clean")):
        signal.raise_signal(signal.SIGHUP)
finally:
    os.write(1, b"unwound")
"""
# The main thread is in C code for minutes: its handler is not called.
IN_KERNEL = """
with clean_up_by(lambda: os.write(1, b"clean")):
    threading.Timer(0.2, lambda: os.kill(os.getpid(), 15)).start()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2_000_000_000)
"""
BLOCKED = """
with clean_up_by(lambda: time.sleep(600)):
    signal.raise_signal(signal.SIGTERM)
"""
IGNORED = """
signal.signal(signal.SIGHUP, signal.SIG_IGN)
end_on_signals()
signal.raise_signal(signal.SIGHUP)
os.write(1, b"alive")
"""
DELAYED = """
with delay_signals():
    signal.raise_signal(signal.SIGTERM)
    os.write(1, b"block")
os.write(1, b"never")
"""
PROGRAMS = {
    "exit": (EXITS, 5, "120", ""),
    "fork": (FORKS, 0, "parent action", ""),
    "signal": (ENDED, 129, "clean", "the terminal was closed\n"),
    "in a kernel": (IN_KERNEL, 143, "clean", "terminated\n"),
    "blocked": (BLOCKED, 143, "", "terminated\n"),
    "ignored": (IGNORED, 0, "alive", ""),
    "delayed": (DELAYED, 143, "block", "terminated\n"),
}
"""Programs after `PRELUDE`, with their exit code, the start of their output, and stderr."""


@pytest.mark.skipif(os.name != "posix", reason="the platform has no such signals")
@pytest.mark.usefixtures("hangup_not_ignored")
@pytest.mark.parametrize("name", PROGRAMS)
def test_process_ends_soon_and_calls_the_actions_of_its_blocks(name):
    """Other processes may delay one run, or two: the limit of 5 s is for an idle machine."""
    code, *expected = PROGRAMS[name]

    def seconds():
        begin = time.monotonic()
        command = [sys.executable, "-c", PRELUDE + code]
        child = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        out = child.stdout[:3] if name == "exit" else child.stdout
        assert [child.returncode, out, child.stderr] == expected
        return time.monotonic() - begin

    assert any(seconds() < 5 for _ in range(3))
