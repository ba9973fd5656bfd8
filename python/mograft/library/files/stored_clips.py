"""Clips and samples that are read from the files of a library when they are needed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, Packed
from mograft._util.containers import LazySequence, SizedCache
from mograft.analysis.embedding import CHUNK, Samples
from mograft.io.bvh.reader import channels_to_transforms
from mograft.library.clip_table import ClipTable, PackedContent
from mograft.library.files.array_files import damage_raises_library_error, release_pages
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_MAX_CACHED_CLIPS = 16
"""Clips that stay in memory by default: a graft reads the same few again and again."""


@dataclass(frozen=True, eq=False)
class PackedMotion:
    """A motion as one array of numbers.

    If `content` is "channels", the numbers are the channel values of a file, from which rotations
    and positions follow. With "poses" they are rotations and positions; with "both" they are
    rotations, positions and channel values.
    """

    content: PackedContent
    numbers: FloatArray  # shape (n,); the arrays one after the other
    skeleton: Skeleton
    frame_time: float  # seconds
    repairs: tuple[str, ...]  # deviations that the reader tolerated


def pack(motion: Motion, *, as_read: bool = False) -> PackedMotion:
    """Return a motion as one array: only its channel values if these determine its poses.

    Channel values take about half the space of poses. `as_read` states that the motion is an
    unchanged result of a reader, so that its channel values determine the poses. Otherwise `pack`
    computes the poses from the channel values and compares them bit for bit. `computed_values` of
    the motion are not stored.
    """
    values = motion.channel_values
    content: PackedContent = "poses" if values is None else "both"
    if values is not None and (as_read or _determines_poses(values, motion)):
        content = "channels"
    parts = [motion.rotations, motion.positions] if content != "channels" else []
    parts += [] if values is None else [values]
    numbers = np.concatenate([part.ravel() for part in parts])
    return PackedMotion(content, numbers, motion.skeleton, motion.frame_time, motion.repairs)


def _determines_poses(values: FloatArray, motion: Motion) -> bool:
    """Return whether the poses computed from channel values equal a motion's poses bit for bit."""
    if np.isnan(values).any():
        return False
    quats, positions = channels_to_transforms(motion.skeleton, values.copy())
    # Compared as bytes, because 0.0 and -0.0 are equal numbers but are written differently.
    return (
        quats.tobytes() == motion.rotations.tobytes()
        and positions.tobytes() == motion.positions.tobytes()
    )


def _unpack(
    numbers: FloatArray, content: PackedContent, n_frames: int, skeleton: Skeleton
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return the rotations, positions and channel values of `PackedMotion.numbers`."""
    if content == "channels":
        values = numbers.reshape(n_frames, skeleton.n_channels)
        return *channels_to_transforms(skeleton, values), values
    n_joints = skeleton.n_joints
    quats, positions, rest = np.split(numbers, n_frames * n_joints * np.array([4, 7]))
    return (
        quats.reshape(-1, n_joints, 4),
        positions.reshape(-1, n_joints, 3),
        rest.reshape(n_frames, skeleton.n_channels) if content == "both" else None,
    )


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
        self.cache: SizedCache[int, Motion] = SizedCache(_MAX_CACHED_CLIPS)

    def __len__(self) -> int:
        return len(self.table.entries)

    def item(self, index: int) -> Motion:
        """Return a clip at the rate and with the hierarchy of the library."""
        motion = self.cache.get(index)
        if motion is None:
            motion = self.original(index)
            with damage_raises_library_error(self.folder, f"clip {index}"):
                motion = self._spec.convert(motion, self.table.entries[index].name)
            self.cache.put(index, motion, 1)
        return motion

    def original(self, index: int, *, as_read: bool = False) -> Motion:
        """Return a clip with the frames and the hierarchy of its file.

        It has its true frame rate and its name in the library or, if `as_read`, the rate and the
        name that the file gives.
        """
        info, location = self.table.entries[index], self.table.locations[index]
        file, start, rate = info.source_file, location.first_number, info.rate_override
        with damage_raises_library_error(self.folder, f"clip {index}"):
            stored = self._frames[location.shard][start : start + location.n_numbers]
            skeleton = self.table.skeletons[location.skeleton]
            numbers = np.array(stored, np.float64)
            release_pages(self._frames[location.shard])
            poses = _unpack(numbers, location.content, info.source_frames, skeleton)
            return Motion(
                skeleton,
                location.frame_time if as_read or rate is None else 1.0 / rate,
                *poses,
                name=info.source_name if as_read else info.name,
                path=None if file is None else Path(file.path),
                clip=None if file is None else file.clip,
                repairs=location.repairs,
            )


class ExtendedClips(LazySequence[Motion]):
    """A sequence of clips followed by one more clip; the others are read only when accessed."""

    def __init__(self, clips: Sequence[Motion], last: Motion) -> None:
        self.library_clips, self._last = clips, last

    def __len__(self) -> int:
        return len(self.library_clips) + 1

    def item(self, index: int) -> Motion:
        """Return a clip; the appended one is the last."""
        return self._last if index == len(self.library_clips) else self.library_clips[index]


@dataclass(frozen=True, eq=False)
class JoinedSamples:
    """Samples of all segments of a library, from several arrays: files, and an appended clip."""

    arrays: tuple[Packed, ...]  # rows of `Samples`, memory-mapped or in memory
    # For each clip its array, first row and number of rows, in the order of the library.
    ranges: IntArray
    n_samples: int  # per segment
    n_joints: int

    def __len__(self) -> int:
        return int(self.ranges[:, 2].sum())

    @classmethod
    def append(cls, known: "Samples | JoinedSamples", new: Samples) -> "JoinedSamples":
        """Return samples followed by those of one more clip; nothing is copied."""
        if isinstance(known, Samples):
            known = cls(
                (known.pack(),), np.array([[0, 0, len(known)]]), new.n_samples, new.n_joints
            )
        ranges = np.concatenate([known.ranges, [[len(known.arrays), 0, len(new)]]])
        return replace(known, arrays=(*known.arrays, new.pack()), ranges=ranges)

    def select(self, indices: IntArray) -> Samples:
        """Return the samples of some segments, in the order of `indices`."""
        stops = self.ranges[:, 2].cumsum()
        clips = np.searchsorted(stops, indices, side="right")
        sources, firsts, counts = self.ranges[clips].T
        rows = firsts + indices - (stops[clips] - counts)
        starts, parts = np.flatnonzero(np.diff(sources, prepend=-1)), list[Packed]()
        for number, own in zip(sources[starts], np.split(rows, starts[1:]), strict=False):
            parts.append(self.arrays[number][own])
            release_pages(self.arrays[number])
        joined = parts[0] if len(parts) == 1 else np.concatenate([self.arrays[0][:0], *parts])
        return Samples(joined, self.n_samples, self.n_joints)

    def chunks(self) -> Iterator[Samples]:
        """Yield the samples of `CHUNK` segments at a time, also if several arrays hold them."""
        for start in range(0, len(self), CHUNK):
            yield self.select(np.arange(start, min(start + CHUNK, len(self))))
