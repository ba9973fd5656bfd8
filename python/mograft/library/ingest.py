"""Ingest of single clips: read, segment, sample.

The result for a clip depends on the clip, the library specification and the configuration only.
Clips can therefore be ingested in any order, in any process, on any machine.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from typing import TypeAlias

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, Packed
from mograft._util.memory import reuse_freed_arrays
from mograft._util.workers import map_ahead
from mograft.analysis.embedding import Samples, normalise
from mograft.analysis.segmentation import segment_clip
from mograft.body.faults import find_faults
from mograft.body.mass import mass_model
from mograft.config import Config
from mograft.errors import MograftError
from mograft.io.formats import read_clip, split_address
from mograft.library.clip_table import ClipInfo
from mograft.library.discover import SourceFile
from mograft.library.files.stored_clips import PackedMotion, pack
from mograft.library.spec import LibrarySpec, describe_match
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton

DISQUALIFYING_FAULTS = ("first_frame", "teleport", "glitch", "flip")
"""Kinds of faults that exclude a segment in which they occur as a donor."""

INGEST_ERRORS = (MograftError, OSError, ValueError)
"""Errors by which a clip is refused."""

BATCH_CLIPS = 8
"""Clips per call of a worker, so that the cost of the call is small compared with the ingest."""

ClipOrder: TypeAlias = tuple[int, tuple[str, ...]]
"""Sort key of clips in a library: a rank and a path.

In a library in memory, the rank is the index of the clip, and the path is empty. In a folder, the
rank is 0 for clips of files and 1 for others; the path has the parts of the file's path relative
to the library and the name of the clip, or the index of a clip without a file.
"""

ClipProperties: TypeAlias = tuple[ClipOrder, Skeleton, ClipInfo]
"""The order of a clip, its skeleton and its metadata, which determine the specification."""


@dataclass(frozen=True, eq=False)
class PendingClip:
    """A clip to ingest."""

    order: ClipOrder
    source: Motion | str | Callable[[], Motion]  # the clip, its address, or a function to read it
    tags: tuple[str, ...] = ()
    rate_override: float | None = None  # frames per second, if the file gives a wrong rate
    source_file: SourceFile | None = None  # the file from which a motion was read earlier
    as_read: bool = False  # whether the motion is an unchanged result of a reader
    known: ClipInfo | None = None  # the metadata of a clip of the previous generation

    @property
    def label(self) -> str:
        """Name of the clip in messages: its address or, without one, the name of the motion."""
        if self.source_file is not None:
            return self.source_file.address
        return self.source if isinstance(self.source, str) else self.motion().name or "a clip"

    def motion(self) -> Motion:
        """Return the motion of a clip whose source is not an address."""
        assert not isinstance(self.source, str)
        return self.source if isinstance(self.source, Motion) else self.source()


@dataclass(frozen=True, eq=False)
class IngestedClip:
    """The result of the ingest of a clip: its segments, their samples and boundary states."""

    clip: Motion | PackedMotion  # a motion at the library's rate, or packed as it was read
    properties: ClipProperties  # before it was converted to the hierarchy of the library
    segments: Segments
    is_donor: BoolArray  # whether each segment may be a donor: it has no disqualifying fault
    samples: Packed  # rows of `Samples` in single precision
    boundary_states: Mapping[str, FloatArray]  # result of `boundary_states`, all joints
    match_note: str = ""  # joints without a counterpart, if the clip has another hierarchy

    @property
    def info(self) -> ClipInfo:
        """The metadata of the clip, whose name need not be unique."""
        return self.properties[2]


@dataclass(frozen=True, eq=False)
class RefusedClip:
    """A clip that cannot be part of the library."""

    label: str  # its address or name
    error: Exception
    properties: ClipProperties | None  # None if the clip could not be read


def boundary_states(motion: Motion, segments: Segments) -> dict[str, FloatArray]:
    """Return the poses and velocities of all joints in the first and last frame of each segment.

    ``first`` and ``last`` are local rotations, xyzw, shape (n_segments, n_joints, 4).
    ``first_velocity`` and ``last_velocity`` are angular velocities in the joints' local frames, in
    radians per second, shape (n_segments, n_joints, 3).
    """
    return {
        "first": motion.rotations[segments.start],
        "last": motion.rotations[segments.stop],
        "first_velocity": _angular_velocities(motion, segments.start),
        "last_velocity": _angular_velocities(motion, segments.stop),
    }


def _angular_velocities(motion: Motion, frames: IntArray) -> FloatArray:
    """Return the angular velocities in some frames of a motion, in radians per second.

    They are central differences; in the first and last frame, one-sided differences. The shape is
    (len(frames), n_joints, 3).
    """
    before, after = np.maximum(frames - 1, 0), np.minimum(frames + 1, motion.n_frames - 1)
    steps = rotations.multiply(rotations.inverse(motion.rotations[before]), motion.rotations[after])
    return rotations.log(steps) * (motion.rate / (after - before))[:, None, None]


def sample_segments(
    motion: Motion, segments: Segments, spec: LibrarySpec, config: Config
) -> Samples:
    """Return the segments of a motion, resampled to `Config.samples` poses, in single precision."""
    heights = [mass_model(motion.skeleton).height]
    return normalise(
        [motion], segments, config, root=spec.root, up=spec.up, heights=heights, is_packed=True
    )


def read_pending(
    clip: PendingClip, rest: Skeleton | None
) -> tuple[PendingClip, Motion, ClipProperties]:
    """Read a clip; return it with the motion as read, the motion at its true rate, and properties.

    `rest` is the field of `LibrarySpec`. Raise one of `INGEST_ERRORS` if the clip cannot be read or
    has a single frame.
    """
    label, source, rate = clip.label, clip.source, clip.rate_override
    if isinstance(source, str):
        try:
            source.encode()
        except UnicodeEncodeError as error:
            raise ValueError(f"the file name must be UTF-8, got {source!r}") from error
        motion = read_clip(source, skeleton=rest)
        source_file = SourceFile.from_path(split_address(source)[0], motion.clip)
        clip = replace(clip, source=motion, source_file=source_file, as_read=True)
    read = clip.motion()
    if read.n_frames < 2:
        raise ValueError(f"`{label}` must have at least 2 frames, got 1")
    motion = read if rate is None else replace(read, frame_time=1.0 / rate)
    info = clip.known or ClipInfo.from_motion(motion, clip.source_file, rate, clip.tags)
    return clip, motion, (clip.order, motion.skeleton, info)


def ingest(
    pending: PendingClip, spec: LibrarySpec, config: Config, *, is_packed: bool
) -> IngestedClip | RefusedClip:
    """Read, segment and sample one clip.

    If `is_packed`, the result has the clip as a `PackedMotion` of the frames in the file, otherwise
    as a motion at the library's rate. A clip is refused if it cannot be read, has a single frame,
    cannot be segmented, or does not fit the hierarchy of `spec`.
    """
    reuse_freed_arrays()
    label, properties = pending.label, None
    try:
        pending, motion, properties = read_pending(pending, spec.rest)
        order, own, info = properties
        resampled = spec.convert(motion, motion.name or label)
        match_note = describe_match(spec.skeleton, own)
        segments = segment_clip(resampled, config, motion.rate)
        faults = [fault for fault in find_faults(resampled) if fault.kind in DISQUALIFYING_FAULTS]
        samples = sample_segments(resampled, segments, spec, config)
    except INGEST_ERRORS as error:
        return RefusedClip(label, error, properties)
    is_donor = np.ones(len(segments), bool)
    for fault in faults:
        first, last = fault.frames
        is_donor[(segments.start <= last) & (segments.stop >= first)] = False
    messages = tuple(fault.message for fault in faults)
    info = info._replace(n_frames=resampled.n_frames, faults=messages)
    return IngestedClip(
        clip=pack(pending.motion(), as_read=pending.as_read) if is_packed else resampled,
        properties=(order, own, info),
        segments=segments,
        is_donor=is_donor,
        samples=samples.pack(),
        boundary_states=boundary_states(resampled, segments),
        match_note=match_note,
    )


def ingest_all(
    clips: Iterable[PendingClip],
    spec: LibrarySpec,
    config: Config,
    executor: Executor | None,
    *,
    is_packed: bool,
) -> Iterator[IngestedClip | RefusedClip]:
    """Ingest clips, and yield the results in the same order.

    A clip whose source is a function is read when it is ingested, or sent to the `executor`.
    Without an executor, the calling thread ingests the clips. `is_packed` is as for `ingest`.
    """
    loaded = (replace(own, source=own.motion()) if callable(own.source) else own for own in clips)
    size = 1 if executor is None else BATCH_CLIPS
    batches = iter(lambda: list(islice(loaded, size)), [])
    run = partial(_ingest_batch, spec=spec, config=config, is_packed=is_packed)
    return chain.from_iterable(map_ahead(executor, run, batches))


def _ingest_batch(
    clips: Sequence[PendingClip], spec: LibrarySpec, config: Config, *, is_packed: bool
) -> list[IngestedClip | RefusedClip]:
    return [ingest(clip, spec, config, is_packed=is_packed) for clip in clips]
