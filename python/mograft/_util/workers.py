"""Worker processes that end with the process that started them."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from mograft._util.signals import delay_signals
from mograft.errors import MograftError

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def worker_processes(n: int) -> Iterator[Executor | None]:
    """Yield an executor of `n` processes, or None if `n` is 1.

    Raise MograftError if a worker process is killed, for example because memory is exhausted.
    """
    if n == 1:
        yield None
        return
    # Spawned, not forked, as threads and open files do not survive a fork.
    context = multiprocessing.get_context("spawn")
    pool = _Pool(n, mp_context=context, initializer=_end_with_parent)
    try:
        yield pool
    except BrokenProcessPool as error:
        raise MograftError(
            "a worker process was killed, possibly because memory is exhausted; use fewer processes"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


class _Pool(ProcessPoolExecutor):
    """A pool of worker processes that ignore Ctrl-C; only the main process reacts to it."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function in one of the processes."""
        # `submit` may start processes. A pool that is interrupted within it never shuts down.
        with delay_signals():
            return super().submit(fn, *args, **kwargs)


def _end_with_parent() -> None:
    """End this worker process when the process that started it has ended, for whatever reason."""

    def wait() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
