"""Ingest of single clips: read, segment, sample.

The result for a clip depends on the clip, the library specification and the configuration only.
Clips can therefore be ingested in any order, in any process, on any machine.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, Packed
from mograft._util.memory import reuse_freed_arrays
from mograft.analysis.embedding import Samples, normalise
from mograft.analysis.segmentation import segment_clip
from mograft.body.faults import find_faults
from mograft.body.mass import mass_model
from mograft.config import Config
from mograft.errors import MograftError
from mograft.io.addresses import read_clip, split_address
from mograft.library.clip_table import ClipInfo
from mograft.library.discover import SourceFile
from mograft.library.files.packing import PackedMotion, pack
from mograft.library.spec import ClipProperties, LibrarySpec, describe_match, rates_match
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

_MAX_PENDING_BATCHES = 16
"""Batches that are submitted and not yet consumed; bounds memory."""


@dataclass(frozen=True, eq=False)
class IngestTask:
    """A clip to ingest."""

    source: Motion | str  # the clip, or its address
    rate_override: float | None = None  # frames per second, if the file gives a wrong rate
    source_file: SourceFile | None = None  # the file from which a motion was read earlier
    as_read: bool = False  # whether the motion is an unchanged result of a reader

    @property
    def label(self) -> str:
        """Name of the clip in messages: its address or, without one, the name of the motion."""
        if self.source_file is not None:
            return self.source_file.address
        return self.source if isinstance(self.source, str) else self.source.name or "a clip"


@dataclass(frozen=True, eq=False)
class IngestedClip:
    """The result of the ingest of a clip: its segments, their samples and boundary states."""

    clip: Motion | PackedMotion  # a motion at the library's rate, or packed as it was read
    name: str  # of the motion; may be empty
    source_file: SourceFile | None
    rate_override: float | None  # as in `IngestTask`
    properties: ClipProperties
    n_frames: int  # at the library's rate
    segments: Segments
    is_donor: BoolArray  # whether each segment may be a donor: it has no disqualifying fault
    faults: tuple[str, ...]  # messages of the disqualifying faults
    samples: Packed  # rows of `Samples` in single precision
    boundary_states: Mapping[str, FloatArray]  # result of `boundary_states`, all joints
    match_note: str = ""  # joints without a counterpart, if the clip has another hierarchy

    def info(self, tags: tuple[str, ...]) -> ClipInfo:
        """Return the metadata of the clip, whose name need not be unique."""
        return ClipInfo(
            name=self.name,
            source_name=self.name,
            source_file=self.source_file,
            source_rate=self.properties.rate,
            rate_override=self.rate_override,
            source_frames=self.properties.n_frames,
            n_frames=self.n_frames,
            root=self.properties.root,
            up=self.properties.up,
            faults=self.faults,
            tags=tags,
        )


@dataclass(frozen=True, eq=False)
class RefusedClip:
    """A clip that cannot be part of the library."""

    label: str  # its address or name
    error: Exception
    properties: ClipProperties | None  # None if the clip could not be read


class ClipOrder(NamedTuple):
    """Sort key of clips in a library.

    In a library in memory, `rank` is the index of the clip, and `path` is empty. In a folder,
    `rank` is 0 for clips of files and 1 for others; `path` has the parts of the file's path
    relative to the library and the name of the clip, or the index of a clip without a file.
    """

    rank: int
    path: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PendingClip:
    """A clip to ingest."""

    order: ClipOrder
    task: Callable[[], IngestTask]  # called when the clip is ingested; it may read the motion
    tags: tuple[str, ...] = ()
    known: ClipInfo | None = None  # the metadata of a clip of the previous generation

    def info(self, clip: IngestedClip) -> ClipInfo:
        """Return the metadata of the clip, given the result of its ingest."""
        if self.known is None:
            return clip.info(self.tags)
        return self.known._replace(n_frames=clip.n_frames, faults=clip.faults)


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


def read_properties(task: IngestTask, rest: Skeleton | None) -> tuple[IngestTask, ClipProperties]:
    """Read a clip; return a task that holds the motion, and the properties of the clip.

    `rest` is the field of `LibrarySpec`. Raise one of `INGEST_ERRORS` if the clip cannot be read or
    has a single frame.
    """
    task, motion = _read(task, rest)
    return task, ClipProperties.from_motion(motion)


def _read(task: IngestTask, rest: Skeleton | None) -> tuple[IngestTask, Motion]:
    """Read a clip; return a task that holds the motion as read, and the motion at its true rate.

    Raise one of `INGEST_ERRORS` if the clip cannot be read or has a single frame.
    """
    label, source = task.label, task.source
    if isinstance(source, str):
        try:
            source.encode()
        except UnicodeEncodeError as error:
            raise ValueError(f"the file name must be UTF-8, got {source!r}") from error
        source = read_clip(source, skeleton=rest)
        source_file = SourceFile.from_path(split_address(label)[0], source.clip)
        task = replace(task, source=source, source_file=source_file, as_read=True)
    if source.n_frames < 2:
        raise ValueError(f"`{label}` must have at least 2 frames, got 1")
    rate = task.rate_override
    return task, source if rate is None else replace(source, frame_time=1.0 / rate)


def ingest(
    task: IngestTask, spec: LibrarySpec, config: Config, *, is_packed: bool
) -> IngestedClip | RefusedClip:
    """Read, segment and sample one clip.

    If `is_packed`, the result has the clip as a `PackedMotion` of the frames in the file, otherwise
    as a motion at the library's rate. A clip is refused if it cannot be read, has a single frame,
    cannot be segmented, or does not fit the hierarchy of `spec`.
    """
    reuse_freed_arrays()
    label, properties = task.label, None
    try:
        task, motion = _read(task, spec.rest)
        properties = ClipProperties.from_motion(motion)
        own = motion.skeleton
        motion = spec.fit(motion, motion.name or label)
        match_note = "" if motion.skeleton is own else describe_match(spec.skeleton, own)
        resampled = motion if rates_match(motion.rate, spec.rate) else motion.resample(spec.rate)
        segments = segment_clip(resampled, config, motion.rate)
        is_donor, faults = _check_faults(resampled, segments)
        samples = sample_segments(resampled, segments, spec, config)
    except INGEST_ERRORS as error:
        return RefusedClip(label, error, properties)
    clip: Motion | PackedMotion = resampled
    if is_packed and isinstance(task.source, Motion):
        clip = pack(task.source, as_read=task.as_read)
    return IngestedClip(
        clip=clip,
        name=motion.name,
        source_file=task.source_file,
        rate_override=task.rate_override,
        properties=properties,
        n_frames=resampled.n_frames,
        segments=segments,
        is_donor=is_donor,
        faults=faults,
        samples=samples.pack(),
        boundary_states=boundary_states(resampled, segments),
        match_note=match_note,
    )


def ingest_all(
    tasks: Iterable[IngestTask],
    spec: LibrarySpec,
    config: Config,
    executor: Executor | None,
    *,
    is_packed: bool,
) -> Iterator[IngestedClip | RefusedClip]:
    """Ingest clips, and yield the results in the order of the tasks.

    Tasks are taken from the iterable when they are needed. Without an executor, the calling thread
    ingests the clips. `is_packed` is as for `ingest`.
    """
    if executor is None:
        for task in tasks:
            yield ingest(task, spec, config, is_packed=is_packed)
        return
    remaining = iter(tasks)
    batches = iter(lambda: list(islice(remaining, BATCH_CLIPS)), [])
    pending: deque[Future[list[IngestedClip | RefusedClip]]] = deque()
    try:
        for batch in batches:
            pending.append(executor.submit(_ingest_batch, batch, spec, config, is_packed=is_packed))
            if len(pending) >= _MAX_PENDING_BATCHES:
                yield from pending.popleft().result()
        while pending:
            yield from pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()


def _ingest_batch(
    tasks: Sequence[IngestTask], spec: LibrarySpec, config: Config, *, is_packed: bool
) -> list[IngestedClip | RefusedClip]:
    return [ingest(task, spec, config, is_packed=is_packed) for task in tasks]


def _check_faults(motion: Motion, segments: Segments) -> tuple[BoolArray, tuple[str, ...]]:
    """Return whether each segment has no disqualifying fault, and the messages of these faults."""
    is_donor = np.ones(len(segments), bool)
    faults = [fault for fault in find_faults(motion) if fault.kind in DISQUALIFYING_FAULTS]
    for fault in faults:
        first, last = fault.frames
        is_donor[(segments.start <= last) & (segments.stop >= first)] = False
    return is_donor, tuple(fault.message for fault in faults)
