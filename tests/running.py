"""A command of mograft that serves something, in a process of its own."""

import json
import subprocess
import sys
from contextlib import contextmanager


@contextmanager
def running(*words, **options):
    """Run a command; yield the process and the JSON that it prints first; kill it at the end."""
    words = [sys.executable, "-m", "mograft", *map(str, words), "--json"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words, text=True, **pipes, **options) as process:
        try:
            lines = []
            while not lines or lines[-1] != "}\n":
                lines.append(process.stdout.readline())
                assert lines[-1], process.stderr.read()
            yield process, json.loads("".join(lines))
        finally:
            process.kill()
