"""System memory: errors if work needs more than is available."""

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
        raise MemoryBudgetError(
            f"{work} needs about {n_bytes / 1e9:.1f} GB of memory, and {available / 1e9:.1f} GB "
            f"are available: {remedy}"
        )
