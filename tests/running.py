"""Commands and code in processes of their own."""

import json
import subprocess
import sys
from contextlib import contextmanager


def run_python(code, **options):
    """Run code, which must succeed; return what it prints."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True, **options).stdout


@contextmanager
def running(*words, **options):
    """Run a command that serves something, and kill it at the end.

    Yield the process and the JSON that it prints first.
    """
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
