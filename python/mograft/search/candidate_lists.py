"""Lists of candidates that are computed when they are read."""

from collections.abc import Callable, Sequence
from typing import overload

import numpy as np

from mograft._util.arrays import IntArray


class ComputedLists(Sequence[IntArray]):
    """The candidates at each position, computed when they are read, a block at a time.

    `compute` takes a range of positions and returns their lists. The last block is kept, and the
    lengths of all lists that were computed.
    """

    def __init__(
        self, compute: Callable[[slice], list[IntArray]], n_positions: int, block_length: int
    ) -> None:
        self._compute, self._positions = compute, range(n_positions)
        self._block_length = block_length
        self._blocks: dict[int, list[IntArray]] = {}
        self._lengths = np.full(n_positions, -1)

    def __len__(self) -> int:
        return len(self._positions)

    @overload
    def __getitem__(self, index: int) -> IntArray: ...
    @overload
    def __getitem__(self, index: slice) -> list[IntArray]: ...
    def __getitem__(self, index: int | slice) -> IntArray | list[IntArray]:
        chosen = self._positions[index]
        if isinstance(chosen, range):
            return [self._list(position) for position in chosen]
        return self._list(chosen)

    def lengths(self) -> IntArray:
        """Return the length of every list, shape (n_positions,)."""
        for position in range(0, len(self), self._block_length):
            if self._lengths[position] < 0:
                self._list(position)
        return self._lengths.copy()

    def _list(self, position: int) -> IntArray:
        number, row = divmod(position, self._block_length)
        lists = self._blocks.get(number)
        if lists is None:
            block = slice(number * self._block_length, (number + 1) * self._block_length)
            lists = self._compute(block)
            self._lengths[block] = [len(own) for own in lists]
            self._blocks.clear()
            self._blocks[number] = lists  # with several threads, for a moment one block of each
        return lists[row]
