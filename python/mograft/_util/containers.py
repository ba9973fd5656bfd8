"""Containers: an immutable mapping, and sequences and results that are computed when needed."""

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar, overload
from weakref import WeakKeyDictionary

K = TypeVar("K")
V = TypeVar("V")
T = TypeVar("T", covariant=True)
R = TypeVar("R")

_KEPT: WeakKeyDictionary[Any, dict[Hashable, Any]] = WeakKeyDictionary()


class FrozenMapping(Mapping[K, V]):
    """A copy of a mapping that cannot be changed, can be hashed and pickled, and prints as a dict.

    The values must be hashable for the mapping to be hashable.
    """

    def __init__(self, items: Mapping[K, V] | None = None) -> None:
        self._items = dict(items or {})

    def __getitem__(self, key: K) -> V:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __hash__(self) -> int:
        return hash(frozenset(self._items.items()))

    def __repr__(self) -> str:
        return repr(self._items)


class LazySequence(Sequence[T]):
    """A sequence that calls `item` for each item that is accessed; slices are tuples."""

    @abstractmethod
    def item(self, index: int) -> T:
        """Return the item with an index that is not negative."""

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[T, ...]: ...
    def __getitem__(self, index: int | slice) -> T | tuple[T, ...]:
        chosen = range(len(self))[index]
        return tuple(map(self.item, chosen)) if isinstance(chosen, range) else self.item(chosen)


class SizedCache(Generic[K, V]):
    """Values of at most `limit` bytes in total, of which the oldest are dropped.

    The newest `minimum` values stay, however large. Copies and pickles are empty; several threads
    may use it.
    """

    def __init__(self, limit: int, minimum: int = 1) -> None:
        self.limit, self.minimum = limit, minimum
        self._items: dict[K, tuple[V, int]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return SizedCache, (self.limit, self.minimum)

    def get(self, key: K) -> V | None:
        """Return the value of a key, or None."""
        return self._items.get(key, (None, 0))[0]

    def put(self, key: K, value: V, size: int) -> V:
        """Store a value of `size` bytes as the newest one, and return it."""
        self._items.pop(key, None)
        known = list(self._items.items())
        total = size + sum(own for _, (_, own) in known)
        for other, (_, own) in known[: max(len(known) + 1 - self.minimum, 0)]:
            if total <= self.limit:
                break
            total -= own
            self._items.pop(other, None)
        self._items[key] = value, size
        return value


def remember(owner: object, key: Hashable, compute: Callable[[], R]) -> R:
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
    found: R = kept[key]
    return found
