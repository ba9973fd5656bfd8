"""Output without control characters: names of files and clips may contain terminal commands."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import IO, Any

_ESCAPES = {
    code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\n\t"
}


class EscapingStream:
    r"""A text stream that writes control characters as ``\x1b``, except line ends and tabs."""

    def __init__(self, stream: IO[str]) -> None:
        self.unescaped = stream

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any attribute of the stream
        return getattr(self.unescaped, name)

    def write(self, text: str) -> int:
        """Write a text and return its length."""
        self.unescaped.write(text.translate(_ESCAPES))
        return len(text)


@contextmanager
def escape_output() -> Iterator[None]:
    """Escape control characters in all output to stdout and stderr within the ``with`` block."""
    out, err = EscapingStream(sys.stdout), EscapingStream(sys.stderr)
    with redirect_stdout(out), redirect_stderr(err):
        yield


def write_control(text: str) -> None:
    """Write a text to stderr without escaping its control characters."""
    stream = getattr(sys.stderr, "unescaped", sys.stderr)
    stream.write(text)
    stream.flush()
