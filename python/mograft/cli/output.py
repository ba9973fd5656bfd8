"""Results on stdout; progress, remarks and errors on stderr."""

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any


def print_result(
    options: argparse.Namespace, schema: str, document: dict[str, Any], lines: Iterable[object]
) -> None:
    """Print the result of a command: `document` if ``--json`` is given, otherwise `lines`.

    The printed document has the additional entry ``"schema": "mograft.SCHEMA/1"``.
    """
    if options.json:
        print(json.dumps({"schema": f"mograft.{schema}/1", **document}, indent=1))
    else:
        for line in lines:
            print(line)


def print_remark(text: str) -> None:
    """Print a line on stderr."""
    print(text, file=sys.stderr)


@contextmanager
def show_progress() -> Iterator[Callable[[str, int, int], None] | None]:
    """Yield a callback that prints progress if stderr is a terminal, otherwise None."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(stage: str, done: int, total: int) -> None:
        print(f"\r\033[K{stage} {done}/{total}", end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print("\r\033[K", end="", file=sys.stderr, flush=True)


def describe_excluded_file(path: str, reason: str) -> str:
    """Return the line that reports an excluded file; `reason` may begin with the path."""
    return f"excluded: {reason}" if reason.startswith(path) else f"excluded: {path}: {reason}"
