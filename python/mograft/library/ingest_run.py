"""Ingest of all clips of a library: the options, and the specification that the clips determine."""

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Generic, Self, TypedDict, TypeVar, get_args

import numpy as np

from mograft._util.validate import check_choice, check_type
from mograft.body.anatomy import anatomy
from mograft.body.groups import JointGroups
from mograft.body.size import describe_sizes
from mograft.config import Config
from mograft.errors import SkeletonMismatchError, join_names
from mograft.io.formats import absolute_address
from mograft.library import ingest
from mograft.library.clip_keys import ClipKeys
from mograft.library.clip_table import ClipInfo
from mograft.library.clusters import Progress
from mograft.library.discover import ClipSource, FoundClip, exclude_grafts, find_clips
from mograft.library.ingest import ClipOrder, ClipProperties, IngestedClip, PendingClip
from mograft.library.spec import LibrarySpec, Match, describe_match, rates_match
from mograft.motion.skeleton import Skeleton

T = TypeVar("T")

_MAX_SAMPLED_CLIPS = 9
"""Clips from which the library specification is guessed before all clips are read."""

_MAX_WARNINGS = 8
"""Clips that warnings name."""

MISMATCH_REMEDY = "unless joints are matched by anatomy (--match anatomy)"
"""How the reason ends for which a clip of another hierarchy is refused."""

_MAX_FAULTS = 3
"""Faults per clip that warnings name."""


class AddOptions(TypedDict, total=False):
    """Keyword arguments of all of `Library.build`, `index` and `add`, which document them."""

    include_grafts: bool
    frame_rates: Mapping[str, float] | None
    tags: Mapping[str, Iterable[str]] | None
    executor: Executor | None
    progress: Progress | None


class IngestOptions(AddOptions, total=False):
    """Keyword arguments of `Library.build` and `index`; `add` takes those of `AddOptions` only."""

    rate: float | None
    match: Match
    skeleton: Skeleton | None
    hierarchy: Skeleton | None


_OPTION_TYPES: dict[str, type] = {"skeleton": Skeleton, "hierarchy": Skeleton, "tags": Mapping}
_OPTION_TYPES |= {"config": Config, "frame_rates": Mapping, "executor": Executor}
"""Types of the options, most of which may be None."""


@dataclass(frozen=True, eq=False, kw_only=True)
class IngestPlan:
    """The options of a library that is built, as in `Library.build`.

    It passes down unchanged from the methods of `Library` to the ingest of clips and to storage.
    """

    config: Config
    groups: JointGroups | str = "lower_upper"
    strict: bool = True  # whether a clip that is refused ends the run with an error
    is_packed: bool = False  # as for `ingest`
    include_grafts: bool = False
    rate: float | None = None
    match: Match = "names"
    skeleton: Skeleton | None = None  # the rest pose of files that store none
    hierarchy: Skeleton | None = None  # of the library, if clips are matched by anatomy
    frame_rates: Mapping[str, float] | None = None
    tags: Mapping[str, Iterable[str]] | None = None
    executor: Executor | None = None
    progress: Progress | None = None

    def __post_init__(self) -> None:
        check_choice("match", self.match, get_args(Match))
        for name, kind in _OPTION_TYPES.items():
            if getattr(self, name) is not None:
                check_type(name, getattr(self, name), kind)
        if self.is_packed:
            check_storable(self.config)
        if self.progress is not None and not callable(self.progress):
            raise TypeError(f"`progress` must be a function, got {type(self.progress).__name__}")
        if self.hierarchy is not None and self.match != "anatomy":
            raise ValueError("`match` must be 'anatomy' if `hierarchy` is given, got 'names'")

    @cached_property
    def tag_keys(self) -> ClipKeys[Iterable[str]]:
        """The tags by the keys of clips."""
        return ClipKeys(self.tags)

    @cached_property
    def rate_keys(self) -> ClipKeys[float]:
        """The frame rates by the keys of clips."""
        return ClipKeys(self.frame_rates)

    def warn_of_keys(self, *, stacklevel: int) -> None:
        """Warn about keys of `tags` and `frame_rates` that match no clip, or several."""
        self.tag_keys.warn("tags", stacklevel=stacklevel + 1)
        self.rate_keys.warn("frame_rates", stacklevel=stacklevel + 1)

    def find_clips(self, sources: ClipSource | Iterable[ClipSource]) -> list[FoundClip]:
        """Find the clips that `sources` stand for.

        Grafts that are found in folders are left out, unless `include_grafts` is true.
        """
        found = find_clips(sources)
        return found if self.include_grafts else exclude_grafts(found)

    def pending(self, order: ClipOrder, found: FoundClip) -> PendingClip:
        """Return a found clip as a clip to ingest, with its tags and the rate of `frame_rates`.

        Raise ValueError if the rate is not above 0.
        """
        rates = self.rate_keys.match(found)
        if rates and not 0 < rates[-1] < float("inf"):
            raise ValueError(
                f"values of `frame_rates` must be above 0 frames per second, got {rates[-1]}"
            )
        source = found.source
        if isinstance(source, str):
            source = absolute_address(source)
        tags = tuple(dict.fromkeys(chain(found.folders, *self.tag_keys.match(found))))
        return PendingClip(order, source, tags, float(rates[-1]) if rates else None)

    def report(self, stage: str, done: int, total: int) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(stage, done, total)


def check_storable(config: Config) -> None:
    """Raise ValueError if a library with this configuration cannot be stored."""
    if callable(config.segmentation):
        raise ValueError(
            "`segmentation` of a stored library must be 'energy' or the cut frames of each clip, "
            f"got the function {config.segmentation!r}"
        )


@dataclass(frozen=True, eq=False)
class IngestResult(Generic[T]):
    """The result of the ingest of several clips."""

    spec: LibrarySpec  # with which they were ingested
    clips: list[T]  # what `store` returned for each clip that was not refused
    properties: Sequence[ClipProperties]  # of all clips that could be read
    errors: Mapping[str, Exception]  # of refused clips, by address or name
    match_notes: Mapping[str, Sequence[str]]  # names of clips matched by anatomy, by note

    def checked(self, plan: IngestPlan) -> Self:
        """Return the result; if the plan is strict, raise the error of the first refused clip."""
        for error in self.errors.values() if plan.strict else ():
            raise error
        return self


def ingest_motions(found: Iterable[FoundClip], plan: IngestPlan) -> IngestResult[IngestedClip]:
    """Ingest clips as motions, in the order in which they were found; see `ingest_fitting`."""
    pending = [plan.pending((index, ()), clip) for index, clip in enumerate(found)]
    return ingest_fitting(pending, plan, lambda clip: clip, lambda: None)


def ingest_fitting(
    pending: Sequence[PendingClip],
    plan: IngestPlan,
    store: Callable[[IngestedClip], T],
    restart: Callable[[], object],
) -> IngestResult[T]:
    """Ingest clips with the library specification that they determine.

    The specification is first guessed from a few clips. If the properties of all clips determine
    another one, `restart` is called, and all clips are ingested again.
    """
    pending, spec = _guess_spec(list(pending), plan)
    while True:
        result = ingest_pending(pending, spec, plan, store)
        chosen = choose_spec(result.properties, plan)
        if chosen.is_equivalent(spec):
            return result.checked(plan)
        restart()
        spec = chosen


def ingest_pending(
    pending: Sequence[PendingClip],
    spec: LibrarySpec,
    plan: IngestPlan,
    store: Callable[[IngestedClip], T],
) -> IngestResult[T]:
    """Ingest clips with a specification, and call `store` with each clip that is not refused."""
    clips: list[T] = []
    properties: list[ClipProperties] = []
    errors: dict[str, Exception] = {}
    notes: dict[str, list[str]] = {}
    results = ingest.ingest_all(pending, spec, plan.config, plan.executor, is_packed=plan.is_packed)
    for done, result in enumerate(results, start=1):
        plan.report("reading", done, len(pending))
        if result.properties is not None:
            properties.append(result.properties)
        if isinstance(result, IngestedClip):
            if result.match_note:
                notes.setdefault(result.match_note, []).append(result.info.source_name)
            clips.append(store(result))
        elif result.properties is None and plan.strict:
            raise result.error
        else:
            errors[result.label] = result.error
    remedy = _mismatch_remedy(pending, properties, spec)
    for label, error in errors.items():
        if remedy and isinstance(error, SkeletonMismatchError):
            errors[label] = SkeletonMismatchError(f"{error}{remedy}")
    return IngestResult(spec, clips, properties, errors, notes)


def _mismatch_remedy(
    pending: Sequence[PendingClip], properties: Sequence[ClipProperties], spec: LibrarySpec
) -> str:
    """Return a text that names a new clip with the hierarchy of `spec`; "" if there is none."""
    fitting = {order for order, own, _ in properties if own.has_same_hierarchy(spec.skeleton)}
    labels = [clip.label for clip in pending if clip.known is None and clip.order in fitting]
    if not labels:
        return ""
    more = f" and {len(fitting) - 1} more" if len(fitting) > 1 else ""
    return (
        f", unlike {labels[0]}{more}; each library or graft takes clips of one hierarchy, "
        f"{MISMATCH_REMEDY}"
    )


def choose_spec(properties: Sequence[ClipProperties], plan: IngestPlan) -> LibrarySpec:
    """Choose the library specification from the properties of at least one clip, in any order.

    Its hierarchy (joint names and parents) is `hierarchy` of the plan or, by default, the one that
    most clips have. Only the clips with this hierarchy determine the other parameters: the most
    frequent root, the up axis of the longest clip and, unless the plan has a `rate`, the rate with
    the most frames. Ties go to the first clip. If no clip has the given `hierarchy`, all clips
    determine rate and up axis, and the hips are the root.
    """
    by_hierarchy = _by_hierarchy(sorted(properties, key=lambda own: own[0]))
    fitting, hierarchy = max(by_hierarchy.values(), key=len), plan.hierarchy
    if hierarchy is not None:
        fitting = by_hierarchy.get((hierarchy.names, hierarchy.parents.tobytes()), [])
    skeleton = hierarchy or fitting[0][0]
    roots = Counter(info.root for _, info in fitting if info.root >= 0)
    if not fitting:
        fitting = list(chain(*by_hierarchy.values()))
        roots = Counter([anatomy(skeleton).hips])
    frames: dict[float, int] = {}
    for _, info in fitting:
        rate = next((own for own in frames if rates_match(info.source_rate, own)), info.source_rate)
        frames[rate] = frames.get(rate, 0) + info.source_frames
    _, longest = max(fitting, key=lambda own: (own[1].source_frames - 1) / own[1].source_rate)
    return LibrarySpec(
        skeleton=skeleton,
        rate=max(frames, key=lambda own: frames[own]) if plan.rate is None else plan.rate,
        root=roots.most_common(1)[0][0] if roots else 0,
        up=longest.up,
        match=plan.match,
        rest=plan.skeleton,
    )


def _by_hierarchy(
    properties: Iterable[ClipProperties],
) -> dict[tuple[tuple[str, ...], bytes], list[tuple[Skeleton, ClipInfo]]]:
    """Return the skeletons and the metadata of clips by their joint names and parents."""
    found: dict[tuple[tuple[str, ...], bytes], list[tuple[Skeleton, ClipInfo]]] = {}
    for _, skeleton, info in properties:
        key = (skeleton.names, skeleton.parents.tobytes())
        found.setdefault(key, []).append((skeleton, info))
    return found


def _guess_spec(
    pending: list[PendingClip], plan: IngestPlan
) -> tuple[list[PendingClip], LibrarySpec]:
    """Guess the specification from a few clips; return the clips and the specification.

    The sources of these clips are then the motions, so that no file is read twice. Raise an error
    if no clip can be used.
    """
    n = len(pending)
    sampled = np.unique(np.linspace(0, n - 1, _MAX_SAMPLED_CLIPS).round().astype(int)).tolist()
    properties: list[ClipProperties] = []
    errors: list[Exception] = []
    for index in [*sampled, *range(n)]:
        if properties and index not in sampled:
            break
        try:
            pending[index], _, own = ingest.read_pending(pending[index], plan.skeleton)
            properties.append(own)
        except ingest.INGEST_ERRORS as error:
            errors.append(error)
    if properties:
        return pending, choose_spec(properties, plan)
    if plan.strict:
        raise errors[0]
    raise ValueError(f"no clip can be used: {errors[0]}") from errors[0]


def _describe_hierarchies(result: IngestResult[T]) -> str:
    """Return a table of the hierarchies of clips; "" unless some clips have another one."""
    clips = _by_hierarchy(result.properties)
    if len(clips) < 2 or result.spec.match != "names":
        return ""
    lines, n_fitting = [], 0
    for members in sorted(clips.values(), key=len, reverse=True):
        skeleton, names = members[0][0], [info.source_name for _, info in members]
        with suppress(SkeletonMismatchError):
            describe_match(result.spec.skeleton, skeleton)
            n_fitting += len(members)
        count = f"{len(members):6} with {skeleton.n_joints:3} joints below {skeleton.names[0]}"
        is_used = result.spec.skeleton.has_same_hierarchy(skeleton)
        lines.append(f"{count}: {join_names(names, 3)}{' (used)' if is_used else ''}")
    n = len(result.properties)
    fit = f"{n_fitting} of {n} clips fit with --match anatomy (match='anatomy')"
    return "\n".join([f"the clips have {len(clips)} hierarchies:", *lines, f"  {fit}"])


def warn_of_clips(entries: Sequence[ClipInfo], result: IngestResult[T], *, stacklevel: int) -> None:
    """Warn about clips that were matched by anatomy, resampled, have another size, or faults.

    `stacklevel` is the stack frame to which warnings refer: 1 for the caller, 2 for its caller.
    """
    rate = result.spec.rate

    def warn(message: str) -> None:
        warnings.warn(message, stacklevel=stacklevel + 2)

    if table := _describe_hierarchies(result):
        warn(table)
    for note, names in result.match_notes.items():
        warn(f"joints matched by anatomy, {join_names(names, _MAX_WARNINGS)}: {note}")
    resampled = [info.name for info in entries if not rates_match(info.source_rate, rate)]
    if resampled:
        names = join_names(resampled, _MAX_WARNINGS)
        warn(f"resampled to {rate:.6g} fps, the frame rate of the library: {names}")
    known, skeleton = result.properties, result.spec.skeleton
    same = {info.source_name: own for _, own, info in known if own.has_same_hierarchy(skeleton)}
    for line in describe_sizes(same):
        warn(f"{line}. Their lengths are scaled to the leg length of the base")
    faulty: dict[tuple[str, ...], list[str]] = {}  # clips of the same content have the same faults
    for info in entries:
        if info.faults:
            faulty.setdefault(tuple(info.faults), []).append(info.name)
    for faults, clips in list(faulty.items())[:_MAX_WARNINGS]:
        more = [f"and {len(faults) - _MAX_FAULTS} more"] * (len(faults) > _MAX_FAULTS)
        listed = "; ".join([*faults[:_MAX_FAULTS], *more])
        names = join_names(clips, _MAX_WARNINGS)
        warn(f"{names}: {listed}. Segments with these frames are excluded as donors")
    if len(faulty) > _MAX_WARNINGS:
        n = sum(map(len, list(faulty.values())[_MAX_WARNINGS:]))
        warn(f"faults in {n} more clips; segments with faulty frames are excluded as donors")
