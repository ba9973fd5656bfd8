"""Clips and samples that are read from the files of a library when they are needed."""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, Packed
from mograft._util.containers import LazySequence
from mograft.analysis.embedding import CHUNK, Samples
from mograft.library.clip_table import ClipTable
from mograft.library.files.array_files import RowFile, damage_raises_library_error
from mograft.library.files.packing import PackedMotion, unpack
from mograft.library.spec import LibrarySpec, rates_match
from mograft.motion.motion import Motion

_MAX_CACHED_CLIPS = 16
"""Clips that stay in memory: a graft reads the same few again and again."""


class StoredClips(LazySequence[Motion]):
    """The clips of a stored library, each of which is read from files when it is accessed.

    `frames` holds for each shard the memory-mapped numbers of its packed motions. Clips are
    converted to the hierarchy and the rate of `spec`, the specification of the library in `folder`.
    """

    def __init__(
        self, table: ClipTable, frames: Sequence[FloatArray], spec: LibrarySpec, folder: Path
    ) -> None:
        self.table, self.folder = table, folder
        self._frames, self._spec = frames, spec
        self._cache: OrderedDict[int, Motion] = OrderedDict()

    def __len__(self) -> int:
        return len(self.table.entries)

    def item(self, index: int) -> Motion:
        """Return a clip at the rate and with the hierarchy of the library."""
        motion = self._cache.get(index)
        if motion is None:
            motion = self.original(index)
            with damage_raises_library_error(self.folder, f"clip {index}"):
                motion = self._spec.fit(motion, self.table.entries[index].name)
                if not rates_match(motion.rate, self._spec.rate):
                    motion = motion.resample(self._spec.rate)
            self._cache[index] = motion
            if len(self._cache) > _MAX_CACHED_CLIPS:
                self._cache.popitem(last=False)
        return motion

    def original(self, index: int, *, as_read: bool = False) -> Motion:
        """Return a clip with the frames and the hierarchy of its file.

        It has its true frame rate and its name in the library or, if `as_read`, the rate and the
        name that the file gives.
        """
        info, location = self.table.entries[index], self.table.locations[index]
        file, start, rate = info.source_file, location.first_number, info.rate_override
        packed = PackedMotion(
            content=location.content,
            numbers=self._frames[location.shard][start : start + location.n_numbers],
            skeleton=self.table.skeletons[location.skeleton],
            frame_time=location.frame_time if as_read or rate is None else 1.0 / rate,
            repairs=location.repairs,
        )
        name = info.source_name if as_read else info.name
        path, clip = (None, None) if file is None else (file.path, file.clip)
        with damage_raises_library_error(self.folder, f"clip {index}"):
            return unpack(packed, info.source_frames, name, path, clip)


class ExtendedClips(LazySequence[Motion]):
    """A sequence of clips followed by one more clip; the others are read only when accessed."""

    def __init__(self, clips: Sequence[Motion], last: Motion) -> None:
        self.library_clips, self._last = clips, last

    def __len__(self) -> int:
        return len(self.library_clips) + 1

    def item(self, index: int) -> Motion:
        """Return a clip; the appended one is the last."""
        return self._last if index == len(self.library_clips) else self.library_clips[index]


class RowRange(NamedTuple):
    """Consecutive rows of one shard."""

    shard: int  # index of the shard
    first: int  # the first row
    n: int  # number of rows


def merge_ranges(ranges: Iterable[RowRange]) -> tuple[RowRange, ...]:
    """Return the same rows as fewer ranges: consecutive ranges of a shard become one range."""
    merged: list[list[int]] = []
    for shard, first, n in ranges:
        if merged and merged[-1][0] == shard and sum(merged[-1][1:]) == first:
            merged[-1][2] += n
        else:
            merged.append([shard, first, n])
    return tuple(RowRange(*item) for item in merged)


@dataclass(frozen=True)
class StoredSamples:
    """Samples of all segments, in the order of the library, read from files when they are needed.

    The files are not memory-mapped, because mapped pages that were read would count as memory of
    the process until it ends.
    """

    files: tuple[RowFile, ...]  # the ``samples`` files, one per shard
    ranges: tuple[RowRange, ...]  # rows of these files, in the order of the library
    n_samples: int  # per segment
    n_joints: int

    def __len__(self) -> int:
        return sum(item.n for item in self.ranges)

    @classmethod
    def from_paths(
        cls, paths: Iterable[Path], ranges: tuple[RowRange, ...], n_samples: int, n_joints: int
    ) -> "StoredSamples":
        """Open the files `paths`, and return their samples."""
        width = n_samples * (4 * n_joints + 3) + 1
        files = tuple(RowFile(path, "<f4", width) for path in paths)
        return cls(files, ranges, n_samples, n_joints)

    def select(self, indices: IntArray) -> Samples:
        """Return the samples of some segments, in the order of `indices`."""
        rows = np.empty((len(indices), self.n_samples * (4 * self.n_joints + 3) + 1), np.float32)
        starts = np.cumsum([0, *(item.n for item in self.ranges)])
        range_of = np.searchsorted(starts, indices, side="right") - 1
        for row, (index, number) in enumerate(zip(indices.tolist(), range_of, strict=True)):
            shard, first, _ = self.ranges[number]
            rows[row] = self.files[shard].read(first + index - int(starts[number]), 1)
        return Samples(rows, self.n_samples, self.n_joints)

    def chunks(self) -> Iterator[Samples]:
        """Yield the samples of `CHUNK` segments at a time, also if several files hold them."""
        parts: list[Packed] = []
        n_collected = 0
        for shard, first, n in self.ranges:
            n_read = 0
            while n_read < n:
                count = min(n - n_read, CHUNK - n_collected)
                parts.append(self.files[shard].read(first + n_read, count))
                n_collected, n_read = n_collected + count, n_read + count
                if n_collected == CHUNK:
                    yield self._join(parts)
                    parts, n_collected = [], 0
        if parts:
            yield self._join(parts)

    def _join(self, parts: Sequence[Packed]) -> Samples:
        rows = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return Samples(rows, self.n_samples, self.n_joints)


@dataclass(frozen=True)
class ExtendedSamples:
    """The samples of a library, followed by the samples of one more clip."""

    known: "Samples | StoredSamples | ExtendedSamples"
    appended: Samples

    def __len__(self) -> int:
        return len(self.known) + len(self.appended)

    def select(self, indices: IntArray) -> Samples:
        """Return the samples of some segments, in the order of `indices`."""
        is_known = indices < len(self.known)
        rows = np.empty((len(indices), self.appended.rows.shape[1]), np.float32)
        rows[is_known] = self.known.select(indices[is_known]).rows
        rows[~is_known] = self.appended.select(indices[~is_known] - len(self.known)).rows
        return replace(self.appended, rows=rows)

    def chunks(self) -> Iterator[Samples]:
        """Yield the samples of at most `CHUNK` segments at a time."""
        yield from self.known.chunks()
        yield from self.appended.chunks()
