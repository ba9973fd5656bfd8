"""Worker processes: results, errors, and processes that are killed at the worst moment."""

import gc
import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import time
from multiprocessing.connection import Connection

import numpy as np
import pytest

from mograft._util.workers import worker_processes
from mograft.errors import FormatError, MograftError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


LONG_SECONDS = 600
"""Time of a call that nothing may wait for, also if this process is not scheduled for minutes."""


def square(n):
    return n * n


def raise_format_error():
    raise FormatError("expected a motion", "walk.bvh", "byte 3")


def return_lambda():
    return lambda: 0


class UnpicklableError(Exception):
    def __reduce__(self):
        raise TypeError("cannot be pickled")


def raise_unpicklable():
    raise UnpicklableError("lost")


def end_at_once():
    os._exit(3)


def wait_long():
    time.sleep(LONG_SECONDS)


def kill_while_sending(declared, sent):
    """Send `sent` bytes of a message of `declared` bytes to the main process, and kill this one."""
    writers = [each for each in gc.get_objects() if isinstance(each, Connection) and each.writable]
    message = struct.pack("!i", declared) + bytes(declared)
    for each in writers:
        os.write(each.fileno(), message[:sent])
    os.kill(os.getpid(), signal.SIGKILL)


def test_workers_return_results_of_many_calls():
    with worker_processes(2) as pool:
        futures = [pool.submit(square, np.arange(n)) for n in range(50)]
        for n, future in enumerate(futures):
            assert future.result(LONG_SECONDS).tolist() == [k * k for k in range(n)]
    assert not multiprocessing.active_children()


def test_workers_raise_the_exceptions_of_calls_and_go_on():
    with worker_processes(2) as pool:
        with pytest.raises(FormatError) as caught:
            pool.submit(raise_format_error).result(LONG_SECONDS)
        assert str(caught.value) == "walk.bvh: byte 3: expected a motion"
        assert "in raise_format_error" in caught.value.__notes__[0]
        with pytest.raises(Exception, match="pickle"):
            pool.submit(return_lambda).result(LONG_SECONDS)
        with pytest.raises(RuntimeError, match="UnpicklableError"):
            pool.submit(raise_unpicklable).result(LONG_SECONDS)
        with pytest.raises(Exception, match=r"pickle|Can't get local object"):
            pool.submit(lambda: 0).result(LONG_SECONDS)
        assert pool.submit(square, 3).result(LONG_SECONDS) == 9


# A message has four bytes of length; a kill comes before, in and after these.
@pytest.mark.parametrize(
    ("error", "message", "call"),
    [
        *(
            (MograftError, "^a worker process was killed", (kill_while_sending, 100, sent))
            for sent in (0, 2, 4, 60)
        ),
        (MograftError, "^a worker process was killed", (end_at_once,)),
        (FormatError, "expected a motion", (raise_format_error,)),
    ],
)
def test_worker_that_fails_raises_its_error_and_ends_running_calls(error, message, call):
    start = time.monotonic()
    with pytest.raises(error, match=message), worker_processes(2) as pool:
        (pool.submit(wait_long), pool.submit(*call))[1].result(LONG_SECONDS / 2)
    assert time.monotonic() - start < LONG_SECONDS / 2
    assert not multiprocessing.active_children()


KILLED_WHILE_IT_STARTS_A_WORKER = """
import os, signal
from multiprocessing import util
from mograft._util.workers import worker_processes

spawn = util.spawnv_passfds

def spawn_and_end(path, words, handles):
    number = spawn(path, words, handles)
    if any("spawn_main" in os.fsdecode(word) for word in words):
        os.kill(os.getpid(), signal.SIGKILL)
    return number

util.spawnv_passfds = spawn_and_end
with worker_processes(2) as pool:
    pool.submit(os.getpid)
"""


def test_worker_of_a_process_that_was_killed_while_it_started_prints_nothing():
    words = [sys.executable, "-c", KILLED_WHILE_IT_STARTS_A_WORKER]
    # The pipe of stderr ends when the worker has ended.
    child = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (child.returncode, child.stderr) == (-signal.SIGKILL, "")
