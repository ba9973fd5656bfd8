"""Commands with failing writes: a preloaded library fails, ends or logs the calls of a process.

Commands run in forks of a process that was started by `start`.
"""

import contextlib
import ctypes
import mmap
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.exit_codes import exit_code

_SOURCE = Path(__file__).with_name("io_faults.c")
_MODES = ("none", "fail once", "fail from", "kill", "full")


class Run(NamedTuple):
    """The end of a command: exit code (negative for a signal), output, numbers of calls and faults.

    `log` has the words of each line of the preloaded library.
    """

    code: int
    output: str
    seconds: float
    calls: int
    faults: int
    log: list[list[str]]


def start(words):
    """Run a module of Python with the preloaded library; return its end.

    The test is skipped where the library cannot be compiled.
    """
    compiler = next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    if not sys.platform.startswith("linux") or compiler is None:
        pytest.skip("needs Linux and a C compiler")
    with tempfile.TemporaryDirectory() as folder:
        shim = Path(folder) / "io_faults.so"
        command = [compiler, "-shared", "-fPIC", "-O1", "-o", shim, _SOURCE, "-ldl", "-lpthread"]
        subprocess.run(command, check=True)
        environment = {**os.environ, "LD_PRELOAD": str(shim)}
        environment |= {"OPENBLAS_NUM_THREADS": "1"}  # a process with threads is not forked
        command = [sys.executable, "-m", *words]
        return subprocess.run(command, env=environment, text=True, capture_output=True, check=False)


def run(words, root, mode="none", at=0, *, errno=5, seconds=None):
    """Run ``mograft`` with `words` in a fork; calls on paths in the folder `root` can fail.

    `mode` is one of `_MODES`: "fail once" fails call number `at` with `errno`, "fail from" also all
    later ones, "kill" ends the process at the call, and "full" fails writes after `at` bytes. After
    `seconds` the process is killed.
    """
    memory = mmap.mmap(-1, mmap.PAGESIZE)
    counters = (ctypes.c_long * 3).from_buffer(memory)
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as log:
        start_time = time.perf_counter()
        child = os.fork()
        if not child:
            code = 70
            try:
                for handle in (1, 2):
                    os.dup2(output.fileno(), handle)
                fault = (_MODES.index(mode), ctypes.c_long(at), errno)
                arm = ctypes.CDLL(os.environ["LD_PRELOAD"]).faults_arm
                arm(os.fsencode(root), *fault, log.fileno(), ctypes.byref(counters))
                code = exit_code(words)
            except BaseException:  # reported like a traceback of the command
                traceback.print_exc()
            with contextlib.suppress(OSError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)
        if seconds is not None:
            time.sleep(seconds)
            os.kill(child, signal.SIGKILL)  # the child is not yet reaped
        _, status = os.waitpid(child, 0)
        used = time.perf_counter() - start_time
        output.seek(0)
        log.seek(0)
        lines = [line.split("\t") for line in log.read().splitlines()]
        code = os.waitstatus_to_exitcode(status)
        return Run(code, output.read(), used, counters[0], counters[2], lines)
