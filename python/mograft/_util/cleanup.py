"""Actions that run when a block ends, also if a signal ends the process within it."""

import atexit
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_pending: dict[object, tuple[int, Callable[[], object]]] = {}
"""The actions of the blocks that have not ended, each with the process that began the block."""


@contextmanager
def clean_up_by(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` when the block ends, or when the process exits within the block.

    The exit may be `mograft._util.signals.end_process`, which does not unwind the stack. A forked
    child does not call the action of its parent.
    """
    block = object()
    _pending[block] = os.getpid(), action
    try:
        yield
    finally:
        action()
        del _pending[block]


@atexit.register
def clean_up() -> None:
    """Call the actions of all blocks of this process that have not ended, the last one first."""
    for process_id, action in reversed(list(_pending.values())):
        if process_id == os.getpid():
            with suppress(Exception):
                action()
