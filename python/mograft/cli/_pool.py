"""Processes that share the work of a command."""

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from typing import ParamSpec, TypeVar

__all__ = ["Pool"]

P = ParamSpec("P")
T = TypeVar("T")


class Pool(ProcessPoolExecutor):
    """Processes that Ctrl-C does not reach: who started them ends them, and one tells of it."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have a function called in one of the processes."""
        if os.name != "posix" or threading.current_thread() is not threading.main_thread():
            return super().submit(fn, *args, **kwargs)
        # It starts processes. What is blocked here is blocked there from the first moment; and
        # here it has to wait: a pool that is interrupted in between never comes to its end.
        waiting: list[int] = []
        handler = signal.signal(signal.SIGINT, lambda number, _: waiting.append(number))
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            future = super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            signal.signal(signal.SIGINT, handler)
        if waiting:
            raise KeyboardInterrupt
        return future
