"""Actions that run when a block ends, also if a signal ends the process within it."""

import atexit
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def clean_up_by(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` once: when the block ends, or when the process exits within the block.

    The exit may be `mograft._util.signals.end_process`, which does not unwind the stack. A forked
    child does not call the action of its parent.
    """
    process_id = os.getpid()

    def run_at_exit() -> None:
        if os.getpid() == process_id:
            action()

    atexit.register(run_at_exit)
    try:
        yield
    finally:
        action()
        atexit.unregister(run_at_exit)
