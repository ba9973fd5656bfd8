"""Commands with failing writes: a preloaded library fails, ends or logs the calls of a process."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

_SOURCE = Path(__file__).with_name("io_faults.c")
_ROOT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Run:
    """The end of a command: exit code (negative for a signal), output, counted calls and bytes."""

    code: int
    output: str
    calls: int
    bytes: int
    faults: int
    seconds: float
    log: tuple[tuple[str, ...], ...]


def build_shim(folder):
    """Compile the preloaded library in a folder; skip the test where that is impossible."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not sys.platform.startswith("linux") or compiler is None:
        pytest.skip("needs Linux and a C compiler")
    shim = folder / "io_faults.so"
    command = [compiler, "-shared", "-fPIC", "-O1", "-o", shim, _SOURCE, "-ldl", "-lpthread"]
    subprocess.run(command, check=True)
    return shim


class FaultServer:
    """A process that runs commands of mograft in forked processes; a context manager.

    `warm` are commands that are run first, so that their modules are imported. `folder` is for
    temporary files outside of the folders of commands.
    """

    def __init__(self, folder, warm):
        self._folder = folder
        environment = {**os.environ, "LD_PRELOAD": str(build_shim(folder)), "PYTHONPATH": ""}
        environment["PYTHONPATH"] = os.pathsep.join([str(_ROOT), *sys.path])
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.weekly.attack.fault_server", json.dumps(warm)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=folder,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def run(self, words, root, mode="none", at=0, *, errno=5, seconds=None, has_log=False):
        """Run ``mograft`` with `words`; calls on paths in the folder `root` can fail.

        `mode` is one of `fault_server.MODES`: "fail once" fails call number `at` with `errno`,
        "fail from" also all later ones, "kill" ends the process at the call, and "full" fails
        writes after `at` bytes. After `seconds` the process is killed.
        """
        log, output = self._folder / "log", self._folder / "output"
        request = {
            "words": [str(word) for word in words],
            "root": str(root),
            "mode": mode,
            "at": at,
            "errno": errno,
            "seconds": seconds,
            "log": str(log) if has_log else "",
            "output": str(output),
        }
        print(json.dumps(request), file=self._process.stdin, flush=True)
        reply = json.loads(self._process.stdout.readline())
        lines = log.read_text().splitlines() if has_log else []
        return Run(
            **reply, output=output.read_text(), log=tuple(tuple(line.split("\t")) for line in lines)
        )
