"""Sequences whose items are computed when they are accessed."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import TypeVar, overload

T = TypeVar("T", covariant=True)


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
