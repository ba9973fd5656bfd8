"""Worker processes that leave Ctrl-C to the process that started them."""

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Pool(ProcessPoolExecutor):
    """Worker processes that ignore Ctrl-C; the process that started them ends them."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function in one of the processes."""
        if os.name != "posix" or threading.current_thread() is not threading.main_thread():
            return super().submit(fn, *args, **kwargs)
        # `submit` may start processes, which inherit the blocked signal. This process delays
        # Ctrl-C until `submit` returns: a pool interrupted within it never shuts down.
        received: list[int] = []
        handler = signal.signal(signal.SIGINT, lambda number, _: received.append(number))
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            future = super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            signal.signal(signal.SIGINT, handler)
        if received:
            raise KeyboardInterrupt
        return future
