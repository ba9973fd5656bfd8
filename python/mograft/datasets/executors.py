"""Calls in the workers of an executor, which open the library once."""

import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from functools import lru_cache, partial
from typing import Any, TypeVar

from mograft._util.workers import map_ahead
from mograft.library.data import LibraryData

T = TypeVar("T")


def check_executor(executor: Executor | None, library: LibraryData) -> None:
    """Raise ValueError if there are workers and they cannot open a library."""
    if executor is not None and not library.has_recipe:
        raise ValueError("`executor` needs a library in a folder: save it first, and open it")


def call_each(
    executor: Executor | None, function: Callable[..., T], context: object, items: Iterable[Any]
) -> Iterator[T]:
    """Yield ``function(context, item)`` for each item, in order, from the workers if any."""
    run = partial(function, context)
    if executor is not None:
        run = partial(_call, pickle.dumps(context), function)
    return map_ahead(executor, run, items)


def _call(payload: bytes, function: Callable[..., T], item: object) -> T:
    return function(_unpickle(payload), item)


_unpickle = lru_cache(maxsize=1)(pickle.loads)
