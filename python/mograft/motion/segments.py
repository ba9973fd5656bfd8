"""`Segments`: where clips are cut."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import BoolArray, IntArray, ReadOnlyArrays, as_indices, set_fields
from mograft._util.validate import check_type, is_integer


@dataclass(frozen=True, eq=False)
class Segments(ReadOnlyArrays):
    """Segments of clips, given by their first and last frames.

    Parameters
    ----------
    start, stop : array_like of int, shape (n_segments,)
        First and last frame of each segment, both inclusive; neighbours share a frame.
    clip : array_like of int, shape (n_segments,), optional
        Index of the clip of each segment. Default: 0, a single clip.

    Raises
    ------
    ValueError
        If the arrays have different lengths, or a segment does not stop after its start.

    Examples
    --------
    >>> segments = Segments([0, 8, 15], [8, 15, 21])
    >>> segments.lengths
    array([8, 7, 6])
    >>> segments[1:]
    Segments(2 of 1 clip)
    """

    start: IntArray
    stop: IntArray
    clip: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        start = as_indices("start", self.start, ("n_segments",)).copy()
        stop = as_indices("stop", self.stop, (len(start),)).copy()
        given = self.clip if np.size(self.clip) else np.zeros(len(start), np.int64)
        clip = as_indices("clip", given, (len(start),)).copy()
        is_empty = start >= stop
        if is_empty.any():
            k = int(np.argmax(is_empty))
            raise ValueError(f"segment {k} must stop after its start, got {start[k]} to {stop[k]}")
        set_fields(self, {"start": start, "stop": stop, "clip": clip})

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, indices: IntArray | BoolArray | slice) -> "Segments":
        """Return the selected segments, in the order of `indices`."""
        if is_integer(indices):
            raise TypeError(f"`indices` must be a slice or an array, got {indices}")
        columns = {name: own[indices].copy() for name, own in vars(self).items()}
        if columns["start"].ndim != 1:
            return Segments(**columns)
        chosen = object.__new__(Segments)  # what is selected from checked segments is not checked
        set_fields(chosen, columns)
        return chosen

    def __repr__(self) -> str:
        n_clips = len(np.unique(self.clip))
        return f"Segments({len(self)} of {n_clips} clip{'s' if n_clips != 1 else ''})"

    @property
    def lengths(self) -> IntArray:
        """Number of frame intervals of each segment, ``stop - start``, shape (n_segments,)."""
        return self.stop - self.start

    def of_clip(self, clip: int) -> IntArray:
        """Return the indices of the segments of a clip, in order of time."""
        return np.flatnonzero(self.clip == clip)

    @classmethod
    def concatenate(cls, parts: Iterable["Segments"]) -> "Segments":
        """Concatenate one or more `Segments` in the given order; clip indices are not changed.

        Raises ValueError if `parts` is empty, TypeError if an item is not a `Segments`.
        """
        several = list(parts)
        if not several:
            raise ValueError("`parts` must have at least one Segments, got none")
        for part in several:
            check_type("parts", part, Segments)
        columns = zip(*((part.start, part.stop, part.clip) for part in several), strict=True)
        return cls(*map(np.concatenate, columns))
