"""End a process by a signal at once: no traceback, no draft and no worker process remains.

`clean_up_by` names actions that run when a block ends, also if a signal ends the process within it.

Only the program ``mograft`` installs these handlers; the package leaves signals to its caller.
The module imports little, because a signal before `end_on_signals` prints a traceback of Python.
"""

import _thread
import atexit
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

_MESSAGES = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal was closed"}
_SIGNALS = {getattr(signal, name): _MESSAGES[name] for name in _MESSAGES if hasattr(signal, name)}
"""The signals that end the process, with the lines that they print on stderr."""

_HANDLER_SECONDS = 0.5
"""Time until the watching thread acts for a main thread that is inside a kernel."""

_CLEANUP_SECONDS = 1.0
"""Time until the watching thread ends the process although cleanup has not finished."""

_is_ending = _thread.allocate_lock()

_pending: dict[object, tuple[int, Callable[[], object]]] = {}
"""The actions of the blocks that have not ended, each with the process that began the block."""


def end_on_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP end the process; the exit code is 128 + the signal's number.

    Signals that the process ignores, as after ``nohup``, stay ignored. Python calls handlers in the
    main thread only, between two instructions; a second thread ends the process if the main
    thread does not react, for example within a long computation.
    """
    handled = [number for number in _SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    for number in handled:
        signal.signal(number, _handle)
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
    _thread.start_new_thread(_watch, (read_end, frozenset(handled)))


def ignore_signals() -> None:
    """Ignore the signals of `end_on_signals`, because the command has ended.

    Python restores their default actions while it ends: the exit code would be that of the signal.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) is _handle:
            signal.signal(number, signal.SIG_IGN)


def _handle(number: int, _: FrameType | None) -> None:
    end_process(number)


def _watch(read_end: int, handled: frozenset[int]) -> None:
    """Wait for a signal; end the process if the main thread does not do so within 0.5 s."""
    while True:
        number = next((byte for byte in os.read(read_end, 64) if byte in handled), None)
        if number is not None:
            time.sleep(_HANDLER_SECONDS)
            end_process(number)
            time.sleep(_CLEANUP_SECONDS)
            os._exit(128 + number)


def end_process(number: int) -> None:
    """Print the reason, kill the worker processes, clean up, and end the process.

    `number` is that of the signal; the exit code is 128 + `number`. Cleanup removes
    drafts; see `clean_up_by`. The function returns only if another call is already ending
    the process.
    """
    if not _is_ending.acquire(blocking=False):
        return
    with suppress(OSError):  # without Python's buffers; on a terminal, over a progress line
        start = "\r\033[K" if os.isatty(2) and os.name == "posix" else ""
        os.write(2, f"{start}{_SIGNALS[number]}\n".encode())
    stdout = sys.stdout
    # Code that was interrupted may hold locks or be inside `print`: errors would be printed.
    sys.stderr = sys.stdout = None
    with suppress(Exception):  # the module is loaded if there are workers
        for process in sys.modules["multiprocessing"].active_children():
            process.kill()
    with suppress(Exception):
        clean_up()
    with suppress(Exception):
        stdout.flush()
    os._exit(128 + number)


@contextmanager
def delay_signals() -> Iterator[None]:
    """Handle SIGINT, SIGTERM and SIGHUP only when the block ends; within it, block SIGINT.

    Processes that the block starts inherit the blocked SIGINT, so that Ctrl-C in a terminal reaches
    the main process only. Does nothing outside the main thread and on Windows.
    """
    numbers = [number for number in _SIGNALS if callable(signal.getsignal(number))]
    received: list[int] = []
    try:
        previous = {n: signal.signal(n, lambda each, _: received.append(each)) for n in numbers}
    except ValueError:  # only the main thread may set handlers
        yield
        return
    if sys.platform != "win32":  # which has no masks of signals
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in previous.items():
            signal.signal(number, handler)
    for number in received:
        signal.raise_signal(number)


@contextmanager
def clean_up_by(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` when the block ends, or when the process exits within the block.

    The exit may be `end_process`, which does not unwind the stack. A forked
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
