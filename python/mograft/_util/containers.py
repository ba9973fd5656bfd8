"""Containers: an immutable mapping, and sequences whose items are computed when accessed."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar, overload

K = TypeVar("K")
V = TypeVar("V")
T = TypeVar("T", covariant=True)


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
