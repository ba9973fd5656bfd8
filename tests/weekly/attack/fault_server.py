"""Run commands of mograft in forked processes whose writes fail or end; see `faults`.

Reads one JSON request per line from stdin and answers with one JSON line each.
"""

import contextlib
import ctypes
import json
import mmap
import os
import signal
import sys
import time

from mograft.cli import main

MODES = {"none": 0, "fail once": 1, "fail from": 2, "kill": 3, "full": 4}
_LOG_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_TRUNC


def run_command(words):
    """Return the exit code of ``mograft`` with these arguments."""
    try:
        return main(words)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 1


def run_child(request, shim, address):
    """Run the command of a request with its fault; never return."""
    output = os.open(request["output"], _LOG_FLAGS)
    for handle in (1, 2):
        os.dup2(output, handle)
    log = os.open(request["log"], _LOG_FLAGS) if request["log"] else -1
    shim.faults_arm(
        os.fsencode(request["root"]),
        MODES[request["mode"]],
        request["at"],
        request["errno"],
        log,
        ctypes.c_void_p(address),
    )
    code = 70
    try:
        code = run_command(request["words"])
    except BaseException:  # reported like a traceback of the command
        import traceback

        traceback.print_exc()
    with contextlib.suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def serve(shim):
    """Answer requests until stdin ends."""
    shim.faults_arm.argtypes = [
        ctypes.c_char_p,
        ctypes.c_int,
        ctypes.c_long,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_void_p,
    ]
    memory = mmap.mmap(-1, mmap.PAGESIZE)
    counters = (ctypes.c_long * 3).from_buffer(memory)
    for line in sys.stdin:
        request = json.loads(line)
        start = time.perf_counter()
        child = os.fork()
        if not child:
            run_child(request, shim, ctypes.addressof(counters))
        if request["seconds"] is not None:
            time.sleep(request["seconds"])
            os.kill(child, signal.SIGKILL)  # the child is not yet reaped
        _, status = os.waitpid(child, 0)
        reply = {
            "code": os.waitstatus_to_exitcode(status),
            "calls": counters[0],
            "bytes": counters[1],
            "faults": counters[2],
            "seconds": time.perf_counter() - start,
        }
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    # Modules are imported once, and not again in each forked process.
    for words in json.loads(sys.argv[1]):
        with (
            open(os.devnull, "w") as null,
            contextlib.redirect_stdout(null),
            contextlib.redirect_stderr(null),
        ):
            run_command(words)
    serve(ctypes.CDLL(os.environ["LD_PRELOAD"]))
