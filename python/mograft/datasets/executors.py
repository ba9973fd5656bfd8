"""Calls in the workers of an executor, which open the library once."""

import pickle
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from functools import lru_cache
from typing import Any, TypeVar

T = TypeVar("T")


def call_all(
    executor: Executor | None, function: Callable[..., T], context: object, items: Iterable[Any]
) -> list[T]:
    """Return ``function(context, item)`` for each item, in order, from the workers if any."""
    if executor is None:
        return [function(context, item) for item in items]
    payload = pickle.dumps(context)
    calls = [executor.submit(call_with, payload, function, item) for item in items]
    return [call.result() for call in calls]


def call_with(payload: bytes, function: Callable[..., T], *arguments: Any) -> T:  # noqa: ANN401
    """Call a function with the pickled context, and other arguments, in a worker."""
    return function(_unpickle(payload), *arguments)


@lru_cache(maxsize=1)
def _unpickle(payload: bytes) -> Any:  # noqa: ANN401 - what the caller pickled
    return pickle.loads(payload)
