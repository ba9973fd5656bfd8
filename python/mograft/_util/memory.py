"""System memory: errors if work needs more than is available; reuse of freed memory."""

import numpy as np

from mograft import _core  # noqa: TID251 - the kernels know the memory of the system
from mograft.errors import MemoryBudgetError

_MAX_UNCHECKED_BYTES = 1 << 28
"""For work that needs at most 256 MiB, memory is not checked."""


def check_memory(work: str, n_bytes: int, remedy: str) -> None:
    """Raise MemoryBudgetError if work needs more memory than is available.

    `work` is the subject of the message, such as "a graft of walk with 900000 frames". `n_bytes` is
    the memory that it needs in addition to what is in use, and `remedy` what the user can do.
    """
    if n_bytes <= _MAX_UNCHECKED_BYTES:
        return
    available = _core.available_memory()
    if n_bytes > available:
        needed, free = (f"{own / 1e9:.1f} GB" for own in (n_bytes, available))
        message = f"{work} needs about {needed} of memory, and {free} are available: {remedy}"
        raise MemoryBudgetError(message)


def reuse_freed_arrays() -> None:
    """Let the C library keep freed arrays of up to 32 MiB for reuse.

    glibc returns large arrays to the system when they are freed, unless it has freed a larger one
    before. New pages cost as much time as the computations on them: ``benches/pipeline.py`` is a
    tenth slower without this call. The array that is freed here takes no physical memory.
    """
    np.empty((1 << 25) - (1 << 16), np.uint8)
