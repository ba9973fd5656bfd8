"""Results kept as long as the object that they were derived from."""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

_Result = TypeVar("_Result")
_KEPT: WeakKeyDictionary[Any, dict[Hashable, Any]] = WeakKeyDictionary()


def remember(owner: object, key: Hashable, compute: Callable[[], _Result]) -> _Result:
    """Return the result of `compute`, which is called once for each pair of owner and key.

    `owner` is an immutable object, compared by identity. Its results are discarded together with
    it.

    >>> class Owner: ...
    >>> owner = Owner()
    >>> remember(owner, "sum", lambda: 1 + 1), remember(owner, "sum", lambda: 3)
    (2, 2)
    """
    kept = _KEPT.setdefault(owner, {})
    if key not in kept:
        kept[key] = compute()
    found: _Result = kept[key]
    return found
