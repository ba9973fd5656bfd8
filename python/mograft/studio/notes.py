"""Warnings as texts for the person."""

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

_capturing = threading.Lock()


@contextmanager
def captured_warnings() -> Iterator[list[str]]:
    """Yield a list that has the different warnings of the block after it.

    Python records warnings for all threads together: while another thread records, its list gets
    those of this block, too.
    """
    texts: list[str] = []
    if not _capturing.acquire(blocking=False):
        yield texts
        return
    try:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            yield texts
        texts += dict.fromkeys(str(own.message) for own in found)
    finally:
        _capturing.release()
