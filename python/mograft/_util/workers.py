"""Worker processes that end with the process that started them."""

import multiprocessing
import os
import pickle
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker, spawn
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, ParamSpec, TypeVar

from mograft._util.signals import delay_signals
from mograft.errors import MograftError

Item = TypeVar("Item")
P = ParamSpec("P")
T = TypeVar("T")

_MAX_AHEAD = 16
"""Calls that are submitted and whose results are not yet consumed; bounds memory."""


@contextmanager
def worker_processes(n: int) -> Iterator[Executor | None]:
    """Yield an executor of `n` processes, or None if `n` is 1.

    A call raises MograftError if its process is killed, for example because memory is exhausted. If
    an exception leaves the block, the processes are killed, so they must not write files.
    """
    if n == 1:
        yield None
        return
    pool = _Pool(n)
    try:
        yield pool
    except BaseException:
        pool.kill()
        raise
    finally:
        pool.end()


def map_ahead(
    executor: Executor | None, function: Callable[[Item], T], items: Iterable[Item]
) -> Iterator[T]:
    """Yield the result of a function for each item, in order.

    Workers, if there are any, compute a few results ahead of the one that is needed.
    """
    if executor is None:
        yield from map(function, items)
        return
    pending = deque[Future[T]]()
    try:
        for item in items:
            pending.append(executor.submit(function, item))
            if len(pending) == _MAX_AHEAD:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()


_command_line = spawn.get_command_line
_SILENT = "import sys; sys.excepthook = lambda *own: own[0] is EOFError or sys.__excepthook__(*own)"
"""Code of a worker that prints no traceback if this process was killed while it started it."""


class _Worker:
    """A process with a pipe to which no other process writes.

    If the process is killed, even while it sends a result, its pipe ends and the call fails. With
    `concurrent.futures.ProcessPoolExecutor`, whose processes share one pipe, the call would wait
    forever for the rest of the result.
    """

    def __init__(self) -> None:
        # Spawned, not forked, as threads and open files do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self.connection, far_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(far_end,), daemon=True)
        spawn.get_command_line = lambda **own: [
            f"{_SILENT}; {word}" if word.startswith("from multiprocessing") else word
            for word in map(os.fsdecode, _command_line(**own))
        ]
        try:
            self.process.start()
        finally:
            spawn.get_command_line = _command_line
        far_end.close()  # now only the process has it open

    def call(self, function: Callable[[], T]) -> T:
        """Call a function in the process and return its result, or raise its exception."""
        message = pickle.dumps(function)
        try:
            self.connection.send_bytes(message)
            result, error, trace = self.connection.recv()
        except (EOFError, OSError) as broken:
            reason = "possibly because memory is exhausted; use fewer processes"
            raise MograftError(f"a worker process was killed, {reason}") from broken
        if error is not None:
            error.add_note(trace)
            raise error
        found: T = result
        return found


class _Pool(ThreadPoolExecutor):
    """Worker processes that ignore Ctrl-C, and one thread per process that awaits its results."""

    def __init__(self, n: int) -> None:
        super().__init__(n)
        self._n = n
        self._started: list[_Worker] = []
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        if sys.platform != "win32":
            # The first start of a process starts the tracker, which unblocks SIGINT; the process
            # would inherit that.
            resource_tracker.ensure_running()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function in one of the processes."""
        # A signal between the start of a process and its entry in the list would leave it running.
        with delay_signals():
            if len(self._started) < self._n:
                worker = _Worker()
                self._started.append(worker)
                self._idle.put(worker)
            return super().submit(self._call, partial(fn, *args, **kwargs))

    def _call(self, function: Callable[[], T]) -> T:
        worker = self._idle.get()
        try:
            return worker.call(function)
        finally:
            self._idle.put(worker)

    def end(self) -> None:
        """Wait for the calls that have begun, and end the processes."""
        self.shutdown(cancel_futures=True)
        for worker in self._started:
            worker.connection.close()
            worker.process.join()

    def kill(self) -> None:
        """End the processes at once; calls that have begun raise MograftError."""
        for worker in self._started:
            worker.process.kill()


def _serve(connection: Connection) -> None:
    """Call the functions that arrive through a pipe, and send their results, until it is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            connection.send_bytes(_answer(connection.recv_bytes()))


def _answer(message: bytes) -> bytes:
    """Call a pickled function; return its pickled result, exception and traceback."""
    answer: tuple[Any, BaseException | None, str]
    try:
        answer = pickle.loads(message)(), None, ""
        return pickle.dumps(answer)
    except BaseException as error:
        trace = traceback.format_exc()
        try:
            return pickle.dumps((None, error, trace))
        except Exception:
            return pickle.dumps((None, RuntimeError(repr(error)), trace))


def _end_with_parent() -> None:
    """End this worker process when the process that started it has ended, for whatever reason."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
