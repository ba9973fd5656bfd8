"""One clip read, cut and sampled: the part of indexing that is done clip by clip, anywhere.

Nothing here knows of other clips but what `Terms` says, so that clips can be digested in any
order, by any process on any machine, and come out the same.
"""

import hashlib
import math
import os
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, Packed
from mograft.analysis.embedding import normalise
from mograft.analysis.segmentation import Segments, segment
from mograft.body.faults import find_faults
from mograft.body.mass import mass_model, up_axis
from mograft.config import Config
from mograft.errors import MograftError
from mograft.io.bvh import poses, read_bvh
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = [
    "ClipProperties",
    "IngestTask",
    "IngestedClip",
    "LibrarySpec",
    "PackedMotion",
    "RefusedClip",
    "SourceFile",
    "boundary_states",
    "choose_spec",
    "describe_source_file",
    "ingest",
    "ingest_all",
    "join_segments",
    "pack",
    "rates_match",
    "read_properties",
    "unpack",
]

Keep: TypeAlias = Literal["motion", "numbers"]
PackedContent: TypeAlias = Literal["channels", "poses", "both"]

DISQUALIFYING_FAULTS = ("first_frame", "teleport", "glitch", "flip")
"""Kinds of faults that make the frames they are in unfit to be used elsewhere."""

_BATCH = 8
"""Clips handed to a worker at a time: enough that handing over costs nothing."""

_AHEAD = 16
"""Batches that may be on their way or done and not yet taken: what bounds memory."""


@dataclass(frozen=True)
class SourceFile:
    """The file that a clip was read from, as it was then.

    Attributes
    ----------
    path : str
        The file.
    size : int
        Bytes.
    mtime_ns : int
        When it was last written, in nanoseconds.
    sha256 : str
        Of its bytes.
    """

    path: str
    size: int
    mtime_ns: int
    sha256: str


@dataclass(frozen=True, eq=False)
class IngestTask:
    """A clip to digest.

    Attributes
    ----------
    source : Motion or str
        The clip, or its file.
    rate : float, optional
        Frames per second, where what the file says is wrong.
    origin : Origin, optional
        The file that a motion was read from, where it was read before.
    as_read : bool
        Whether the motion is just what `read_bvh` returned.
    """

    source: Motion | str
    rate_override: float | None = None
    source_file: SourceFile | None = None
    as_read: bool = False


@dataclass(frozen=True, eq=False)
class LibrarySpec:
    """What all clips of a library have in common.

    Attributes
    ----------
    skeleton : Skeleton
        Of the joint names and hierarchy that every clip must have.
    rate : float
        Frames per second.
    root : int
        The joint that carries the body through the world.
    up : int
        The axis that points up: 0, 1 or 2.
    config : Config
        The configuration.
    """

    skeleton: Skeleton
    rate: float
    root: int
    up: int
    config: Config

    def agrees(self, other: "LibrarySpec") -> bool:
        """Tell whether clips come out the same by other terms of the same configuration."""
        ours, theirs = self.skeleton, other.skeleton
        return (self.rate, self.root, self.up, ours.names, ours.parents.tolist()) == (
            other.rate,
            other.root,
            other.up,
            theirs.names,
            theirs.parents.tolist(),
        )


@dataclass(frozen=True, eq=False)
class ClipProperties:
    """What a clip says of itself, from which the terms of a library are settled.

    Attributes
    ----------
    skeleton : Skeleton
        Its skeleton.
    rate : float
        Frames per second, corrected.
    n_frames : int
        Number of frames at that rate.
    root : int
        The joint that carries the body; -1 where nothing moves.
    up : int
        The axis that points up.
    """

    skeleton: Skeleton
    rate: float
    n_frames: int
    root: int
    up: int

    def same_hierarchy(self, skeleton: Skeleton) -> bool:
        """Tell whether the clip has the joint names and hierarchy of a skeleton."""
        own = self.skeleton
        return own.names == skeleton.names and np.array_equal(own.parents, skeleton.parents)

    @classmethod
    def of(cls, motion: Motion) -> "ClipProperties":
        """Ask a motion."""
        moves = bool(np.ptp(motion.positions, axis=0).any())
        root = motion.locomotion_root() if moves else -1
        return cls(motion.skeleton, motion.rate, motion.n_frames, root, up_axis(motion))


@dataclass(frozen=True, eq=False)
class PackedMotion:
    """A motion as numbers that give it back bit for bit.

    Attributes
    ----------
    kind : {"channels", "poses", "both"}
        Whether the numbers are the file's channels, of which all else follows, or rotations
        and positions, or these and the channels that are known.
    numbers : ndarray, shape (n,)
        The numbers, one array after the other.
    skeleton : Skeleton
        The clip's skeleton.
    frame_time : float
        Seconds from one frame to the next.
    n_frames : int
        Number of frames.
    name : str
        What the clip calls itself.
    path : str or None
        The file that it was read from.
    repairs : tuple of str
        What the reader tolerated.
    """

    content: PackedContent
    numbers: FloatArray
    skeleton: Skeleton
    frame_time: float
    n_frames: int
    name: str
    path: str | None
    repairs: tuple[str, ...]


def pack(motion: Motion, *, as_read: bool = False) -> PackedMotion:
    """Turn a motion into numbers that `unpack` makes the same motion of.

    Parameters
    ----------
    motion : Motion
        The motion.
    as_read : bool
        It comes from `read_bvh` as it is, so that its channels are known to be enough.

    Returns
    -------
    Stored
        The channels alone where the rest follows from them; a file's numbers take half the
        space of what they mean.
    """
    values = motion.channel_values
    kind: PackedContent = "poses" if values is None else "both"
    if values is not None and (as_read or _follows(motion, values)):
        kind = "channels"
    parts = [motion.rotations, motion.positions] if kind != "channels" else []
    parts += [values] if kind != "poses" and values is not None else []
    return PackedMotion(
        kind,
        np.concatenate([part.ravel() for part in parts]),
        motion.skeleton,
        motion.frame_time,
        motion.n_frames,
        motion.name,
        None if motion.path is None else str(motion.path),
        motion.repairs,
    )


def _follows(motion: Motion, values: FloatArray) -> bool:
    if np.isnan(values).any():
        return False
    turned, placed = poses(motion.skeleton, values.copy())
    # Compared as bits: -0.0 is written as "-0.0".
    return (
        turned.tobytes() == motion.rotations.tobytes()
        and placed.tobytes() == motion.positions.tobytes()
    )


def unpack(stored: PackedMotion) -> Motion:
    """Return the motion that `pack` made numbers of."""
    skeleton, n_frames = stored.skeleton, stored.n_frames
    values: FloatArray | None = None
    if stored.content == "channels":
        values = np.array(stored.numbers, np.float64).reshape(n_frames, skeleton.n_channels)
        turned, placed = poses(skeleton, values)
    else:
        shapes: list[tuple[int, ...]] = [
            (n_frames, skeleton.n_joints, 4),
            (n_frames, skeleton.n_joints, 3),
        ]
        if stored.content == "both":
            shapes.append((n_frames, skeleton.n_channels))
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        pieces = np.split(np.array(stored.numbers, np.float64), ends[:-1])
        turned, placed, *rest = (
            piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)
        )
        values = rest[0] if rest else None
    return Motion(
        skeleton,
        stored.frame_time,
        turned,
        placed,
        channel_values=values,
        name=stored.name,
        path=None if stored.path is None else Path(stored.path),
        repairs=stored.repairs,
    )


@dataclass(frozen=True, eq=False)
class IngestedClip:
    """A clip, cut, and its segments sampled.

    Attributes
    ----------
    clip : Motion or Stored
        The clip: at the library's rate if it is a motion; as it was read if it is stored.
    name : str
        What it calls itself; empty where it does not.
    origin : Origin or None
        The file that it was read from.
    facts : Facts
        What it says of itself.
    n_frames : int
        Number of frames at the library's rate.
    segments : Segments
        Its segments.
    is_donor : ndarray of bool, shape (n_segments,)
        Whether each is without fault.
    faults : tuple of str
        What was found that makes segments unfit.
    samples : ndarray of float32, shape (n_segments, n_numbers)
        `Samples.packed` of the segments.
    edges : dict of str to ndarray, shape (n_segments, n_joints, ...)
        What `edges` returns of all joints.
    """

    clip: Motion | PackedMotion
    name: str
    source_file: SourceFile | None
    properties: ClipProperties
    n_frames: int
    segments: Segments
    is_donor: BoolArray
    faults: tuple[str, ...]
    samples: Packed
    boundary_states: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class RefusedClip:
    """A clip that does not fit, and why.

    Attributes
    ----------
    what : str
        Its file or name.
    error : Exception
        The reason.
    facts : Facts or None
        What it says of itself, if it could be read.
    """

    name: str
    error: Exception
    properties: ClipProperties | None


def boundary_states(motion: Motion, cut: Segments) -> dict[str, FloatArray]:
    """Return what the search for donors has to know of the ends of segments.

    Parameters
    ----------
    motion : Motion
        The clip.
    cut : Segments
        Its segments.

    Returns
    -------
    dict of str to ndarray, shape (n_segments, n_joints, 4 or 3)
        As `SegmentPool` names them: ``first`` and ``last``, the local rotations in the first and
        the last frame; ``first_velocity`` and ``last_velocity``, the angular velocities
        there in the joints' own frames, in radians per second.
    """
    return {
        "first": motion.rotations[cut.start],
        "last": motion.rotations[cut.stop],
        "first_velocity": _velocities(motion, cut.start),
        "last_velocity": _velocities(motion, cut.stop),
    }


def _velocities(motion: Motion, frames: IntArray) -> FloatArray:
    before, after = np.maximum(frames - 1, 0), np.minimum(frames + 1, motion.n_frames - 1)
    turned = rotations.multiply(
        rotations.inverse(motion.rotations[before]), motion.rotations[after]
    )
    per_second: FloatArray = rotations.log(turned) * (motion.rate / (after - before))[:, None, None]
    return per_second


def read_properties(task: IngestTask) -> tuple[IngestTask, ClipProperties]:
    """Return a task that needs no reading any more, and what the clip says of itself.

    Raises
    ------
    BvhError, OSError, ValueError
        If it cannot be read, or has a single frame.
    """
    source, origin, as_read = task.source, task.source_file, task.as_read
    if isinstance(source, str):
        try:
            source.encode()
        except UnicodeEncodeError as error:
            raise ValueError(f"{source!r}: the file's name is no UTF-8") from error
        origin, source, as_read = describe_source_file(source), read_bvh(source), True
    motion = _corrected(source, task.rate_override)
    if motion.n_frames < 2:
        raise ValueError(f"{_called(task)} must have at least 2 frames, got 1")
    return IngestTask(source, task.rate_override, origin, as_read), ClipProperties.of(motion)


def _called(task: IngestTask) -> str:
    if task.source_file is not None:
        return task.source_file.path
    return task.source if isinstance(task.source, str) else task.source.name or "a clip"


def _corrected(motion: Motion, rate: float | None) -> Motion:
    return motion if rate is None else replace(motion, frame_time=1.0 / rate)


def ingest(task: IngestTask, terms: LibrarySpec | None, keep: Keep) -> IngestedClip | RefusedClip:
    """Read, cut and sample one clip.

    Parameters
    ----------
    task : Task
        The clip.
    terms : Terms or None
        What it must fit. None fits nothing.
    keep : {"motion", "numbers"}
        Whether the clip itself is wanted as a motion at the library's rate or as numbers.

    Returns
    -------
    Digest or Refusal
        A refusal where it cannot be read, has a single frame or another hierarchy.
    """
    what, facts = _called(task), None
    try:
        read, facts = read_properties(task)
        source = read.source
        if terms is None or isinstance(source, str):
            raise ValueError(f"{what} fits no library")
        motion = _corrected(source, task.rate_override)
        terms.skeleton.check_same_hierarchy(motion.skeleton, motion.name or what)
        even = motion if rates_match(motion.rate, terms.rate) else motion.resample(terms.rate)
        cut = segment(even, terms.config)
        is_donor, faults = _without_faults(even, cut)
        samples = normalise(
            [even],
            cut,
            terms.config,
            root=terms.root,
            up=terms.up,
            heights=[mass_model(even.skeleton).height],
        )
    except (MograftError, OSError, ValueError) as error:
        return RefusedClip(what, error, facts)
    return IngestedClip(
        even if keep == "motion" else pack(source, as_read=read.as_read),
        motion.name,
        read.source_file,
        facts,
        even.n_frames,
        cut,
        is_donor,
        faults,
        samples.packed(),
        boundary_states(even, cut),
    )


def ingest_all(
    tasks: Iterable[IngestTask], terms: LibrarySpec, keep: Keep, executor: Executor | None
) -> Iterator[IngestedClip | RefusedClip]:
    """Digest clips, perhaps in parallel, and yield what comes of them in their order.

    Parameters
    ----------
    tasks : iterable of Task
        The clips; taken as they are needed.
    terms, keep
        As for `digest`.
    executor : concurrent.futures.Executor, optional
        Who does it. Default: this thread.

    Yields
    ------
    Digest or Refusal
        One per task.
    """
    if executor is None:
        for task in tasks:
            yield ingest(task, terms, keep)
        return
    rest = iter(tasks)
    batches = iter(lambda: list(islice(rest, _BATCH)), [])
    waiting: deque[Future[list[IngestedClip | RefusedClip]]] = deque()
    try:
        for batch in batches:
            waiting.append(executor.submit(_digest_batch, batch, terms, keep))
            if len(waiting) >= _AHEAD:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()


def _digest_batch(
    tasks: Sequence[IngestTask], terms: LibrarySpec, keep: Keep
) -> list[IngestedClip | RefusedClip]:
    return [ingest(task, terms, keep) for task in tasks]


def choose_spec(
    facts: Sequence[ClipProperties], config: Config, rate: float | None = None
) -> LibrarySpec:
    """Settle what clips must have in common.

    Parameters
    ----------
    facts : sequence of Facts
        What each says of itself, at least one.
    config : Config
        The configuration.
    rate : float, optional
        Frames per second. Default: the rate of most frames.

    Returns
    -------
    Terms
        The joint names and hierarchy of most clips, the joint that carries most of them
        through the world, the up of the longest. Of equals the first counts.
    """
    votes: dict[tuple[object, ...], list[ClipProperties]] = {}
    for own in facts:
        hierarchy = (own.skeleton.names, own.skeleton.parents.tobytes())
        votes.setdefault(hierarchy, []).append(own)
    fitting = max(votes.values(), key=len)
    frames: dict[float, int] = {}
    for own in fitting:
        key = next((known for known in frames if rates_match(own.rate, known)), own.rate)
        frames[key] = frames.get(key, 0) + own.n_frames
    commonest = max(frames, key=lambda key: frames[key])
    carried = Counter(own.root for own in fitting if own.root >= 0)
    root = carried.most_common(1)[0][0] if carried else 0
    longest = max(fitting, key=lambda own: (own.n_frames - 1) / own.rate)
    return LibrarySpec(
        fitting[0].skeleton, commonest if rate is None else rate, root, longest.up, config
    )


def rates_match(a: float, b: float) -> bool:
    """Tell whether two rates are one but for how files round frame times."""
    # A tenth of a percent: 23.976 and 24 or 29.97 and 30 are told apart no more finely
    # than files that give 0.033 for 1/30 need.
    return abs(a - b) <= 1e-3 * b


def describe_source_file(path: str) -> SourceFile:
    """Return what a file is like now."""
    with open(path, "rb") as stream:
        found = os.fstat(stream.fileno())
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    return SourceFile(path, found.st_size, found.st_mtime_ns, sha256)


def _without_faults(motion: Motion, cut: Segments) -> tuple[BoolArray, tuple[str, ...]]:
    """Tell which segments hold no fault, and what the others hold."""
    good = np.ones(len(cut), bool)
    found = [fault for fault in find_faults(motion) if fault.kind in DISQUALIFYING_FAULTS]
    for fault in found:
        first, last = fault.frames
        good[(cut.start <= last) & (cut.stop >= first)] = False
    return good, tuple(fault.message for fault in found)


def join_segments(ends: Sequence[tuple[IntArray, IntArray]]) -> Segments:
    """Return the segments of several clips, each by starts and stops, as those of one library."""
    clip: IntArray = np.repeat(np.arange(len(ends)), [len(start) for start, _ in ends])
    start, stop = (np.concatenate(several) for several in zip(*ends, strict=True))
    return Segments(start, stop, clip)
