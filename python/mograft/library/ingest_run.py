"""Ingest of all clips of a library: options, order, refusals, warnings."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple, Protocol, TypedDict

import numpy as np

from mograft._util.validate import check_type
from mograft.analysis.segmentation import check_segmentation
from mograft.config import Config
from mograft.errors import SkeletonMismatchError, join_names, suggest_name
from mograft.io.addresses import absolute_address
from mograft.library.clip_table import ClipInfo
from mograft.library.clusters import Progress
from mograft.library.discover import (
    ClipSource,
    FoundClip,
    exclude_grafts,
    find_clips,
    matching_values,
)
from mograft.library.ingest import (
    INGEST_ERRORS,
    IngestedClip,
    IngestTask,
    ingest_all,
    read_properties,
)
from mograft.library.spec import (
    MATCHES,
    ClipProperties,
    LibrarySpec,
    Match,
    choose_spec,
    has_same_hierarchy,
    rates_match,
)
from mograft.motion.skeleton import Skeleton

_MAX_SAMPLED_CLIPS = 9
"""Clips from which the library specification is guessed before all clips are read."""

_MAX_WARNINGS = 8
"""Clips that warnings name."""

_MAX_FAULTS = 3
"""Faults per clip that warnings name."""


class AddOptions(TypedDict, total=False):
    """Keyword arguments that `Library.build`, `index` and `add` share and document."""

    include_grafts: bool
    frame_rates: Mapping[str, float] | None
    tags: Mapping[str, Iterable[str]] | None
    executor: Executor | None
    progress: Progress | None


class IngestOptions(AddOptions, total=False):
    """Keyword arguments of `AddOptions`, and those that only `Library.build` and `index` take."""

    rate: float | None
    match: Match
    skeleton: Skeleton | None
    hierarchy: Skeleton | None


class ClipOrder(NamedTuple):
    """Sort key for the order of clips in a library: first by rank, then by path."""

    rank: int  # library in a folder: 0 for files, 1 for other clips; in memory: index of the clip
    path: tuple[str, ...] = ()  # relative to the library; for a clip without a file, its index


@dataclass(frozen=True, eq=False)
class PendingClip:
    """A clip to ingest."""

    order: ClipOrder
    found: FoundClip | None  # None for a clip of the previous generation
    rate_override: float | None  # frames per second, if the file gives a wrong rate
    info: ClipInfo | None = None  # the metadata of a clip of the previous generation

    def task(self) -> IngestTask:
        """Return the task that reads the clip from its source."""
        if self.found is None:
            raise RuntimeError(
                "a clip of the previous generation must be read from the library, not from a source"
            )
        source = self.found.source
        if isinstance(source, str):
            source = absolute_address(source)
        return IngestTask(source, self.rate_override)

    def updated_info(
        self, clip: IngestedClip, tags: Mapping[str, Iterable[str]] | None
    ) -> ClipInfo:
        """Return the metadata of a clip after its ingest; the name is not yet unique.

        `tags` are those of `Library.build`.
        """
        if self.info is not None:
            return self.info._replace(n_frames=clip.n_frames, faults=clip.faults)
        words: list[str] = []
        if self.found is not None:
            words += self.found.folders
            words += chain.from_iterable(matching_values(tags, self.found))
        return ClipInfo(
            name=clip.name,
            source_name=clip.name,
            source_file=clip.source_file,
            source_rate=clip.properties.rate,
            rate_override=self.rate_override,
            source_frames=clip.properties.n_frames,
            n_frames=clip.n_frames,
            root=clip.properties.root,
            up=clip.properties.up,
            faults=clip.faults,
            tags=tuple(dict.fromkeys(words)),
        )


class ClipReceiver(Protocol):
    """Destination of ingested clips: a list, or a store with the same methods."""

    def append(self, clip: tuple[PendingClip, IngestedClip], /) -> None:
        """Store a clip."""
        ...

    def clear(self) -> None:
        """Remove all clips, before they are ingested again with another specification."""
        ...


@dataclass(frozen=True, eq=False)
class IngestRun:
    """Options for the ingest of several clips, as in `Library.build`, and the errors of the run."""

    config: Config
    strict: bool  # whether a clip that is refused ends the run with an error
    is_packed: bool  # whether clips are returned packed or as motions
    include_grafts: bool = False
    rate: float | None = None
    match: Match = "names"
    skeleton: Skeleton | None = None  # the rest pose of files that store none
    hierarchy: Skeleton | None = None  # of the library, if clips are matched by anatomy
    frame_rates: Mapping[str, float] | None = None
    tags: Mapping[str, Iterable[str]] | None = None
    executor: Executor | None = None
    progress: Progress | None = None
    errors: dict[str, Exception] = field(default_factory=dict)  # of refused clips, by label
    match_notes: dict[str, list[str]] = field(default_factory=dict)  # labels of clips, by note

    def __post_init__(self) -> None:
        if self.match not in MATCHES:
            hint = suggest_name(self.match, MATCHES)
            raise ValueError(f"`match` must be 'names' or 'anatomy', got {self.match!r}{hint}")
        check_segmentation(self.config)
        if self.is_packed:
            check_storable(self.config)
        for name in ("skeleton", "hierarchy"):
            if getattr(self, name) is not None:
                check_type(name, getattr(self, name), Skeleton)
        if self.hierarchy is not None and self.match != "anatomy":
            raise ValueError("`hierarchy` requires `match` 'anatomy', got 'names'")

    def find_clips(self, sources: ClipSource | Iterable[ClipSource]) -> list[FoundClip]:
        """Find the clips that `sources` stand for.

        Grafts that are found in folders are left out, unless `include_grafts` is true.
        """
        found = find_clips(sources)
        return found if self.include_grafts else exclude_grafts(found)

    def report(self, stage: str, done: int, total: int) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(stage, done, total)

    def pending(self, order: ClipOrder, found: FoundClip) -> PendingClip:
        """Return a found clip as a clip to ingest, with its rate if `frame_rates` gives one."""
        rates = matching_values(self.frame_rates, found)
        if rates and not 0 < rates[-1] < float("inf"):
            raise ValueError(
                f"values of `frame_rates` must be above 0 frames per second, got {rates[-1]}"
            )
        return PendingClip(order, found, float(rates[-1]) if rates else None)

    def ingest_and_choose_spec(
        self, clips: Sequence[PendingClip], receiver: ClipReceiver
    ) -> LibrarySpec:
        """Ingest clips, and return the library specification that their properties determine.

        The specification is guessed from a few clips. If the properties of all clips determine
        another one, all clips are ingested again with it.
        """
        tasks, spec = self._guess_spec([clip.task() for clip in clips])
        while True:
            properties = self.ingest_with_spec(clips, tasks, receiver, spec)
            chosen = self.choose_spec(properties)
            if chosen.is_equivalent(spec):
                self.raise_if_strict()
                return spec
            receiver.clear()
            spec = chosen

    def ingest_with_spec(
        self,
        clips: Sequence[PendingClip],
        tasks: Iterable[IngestTask],
        receiver: ClipReceiver,
        spec: LibrarySpec,
    ) -> list[tuple[ClipOrder, ClipProperties]]:
        """Ingest clips with a specification, and pass them to `receiver`.

        Refused clips go to `errors`. Return the properties of the clips that could be read.
        """
        properties: list[tuple[ClipOrder, ClipProperties]] = []
        self.errors.clear()
        self.match_notes.clear()
        results = ingest_all(tasks, spec, self.config, self.executor, is_packed=self.is_packed)
        for done, (clip, result) in enumerate(zip(clips, results, strict=True), start=1):
            self.report("reading", done, len(clips))
            if result.properties is not None:
                properties.append((clip.order, result.properties))
            if isinstance(result, IngestedClip):
                if result.match_note:
                    self.match_notes.setdefault(result.match_note, []).append(result.name)
                receiver.append((clip, result))
                continue
            self.errors[result.label] = result.error
            if result.properties is None and self.strict:
                raise result.error
        self._name_reference_clip(clips, properties, spec)
        return properties

    def _name_reference_clip(
        self,
        clips: Sequence[PendingClip],
        properties: Sequence[tuple[ClipOrder, ClipProperties]],
        spec: LibrarySpec,
    ) -> None:
        """Add the name of a fitting clip to the errors of clips with another hierarchy.

        A fitting clip has the hierarchy of `spec`.
        """
        fitting = {
            order for order, own in properties if has_same_hierarchy(own.skeleton, spec.skeleton)
        }
        label = next((c.task().label for c in clips if c.found and c.order in fitting), None)
        if label is None:
            return
        more = f" and {len(fitting) - 1} more" if len(fitting) > 1 else ""
        remedy = (
            f", unlike {label}{more}; each library or graft takes clips of one hierarchy, unless "
            "joints are matched by anatomy (--match anatomy)"
        )
        for refused, error in self.errors.items():
            if isinstance(error, SkeletonMismatchError):
                self.errors[refused] = SkeletonMismatchError(f"{error}{remedy}")

    def choose_spec(self, properties: Sequence[tuple[ClipOrder, ClipProperties]]) -> LibrarySpec:
        """Choose the library specification; the order of ingest does not affect it."""
        ordered = sorted(properties, key=lambda pair: pair[0])
        return self._choose_spec([clip for _, clip in ordered])

    def _choose_spec(self, clips: Sequence[ClipProperties]) -> LibrarySpec:
        return choose_spec(clips, self.rate, self.match, self.skeleton, self.hierarchy)

    def raise_if_strict(self) -> None:
        """Raise the first error in a strict run."""
        for error in self.errors.values():
            if self.strict:
                raise error

    def reasons(self) -> dict[str, str]:
        """Return the reason why each refused clip was refused, by file or name."""
        return {label: str(error) for label, error in self.errors.items()}

    def _guess_spec(self, tasks: list[IngestTask]) -> tuple[list[IngestTask], LibrarySpec]:
        """Guess the specification from a few clips; return the tasks and the specification.

        The tasks of the clips that were read for the guess hold the motions, which are not read
        again.
        """
        sampled = np.unique(np.linspace(0, len(tasks) - 1, _MAX_SAMPLED_CLIPS).round().astype(int))
        indices = sampled.tolist()
        properties: list[ClipProperties] = []
        errors: list[Exception] = []
        for index in [*indices, *range(len(tasks))]:
            if properties and index not in indices:
                break
            try:
                tasks[index], clip = read_properties(tasks[index], self.skeleton)
            except INGEST_ERRORS as error:
                errors.append(error)
            else:
                properties.append(clip)
        if properties:
            return tasks, self._choose_spec(properties)
        if self.strict:
            raise errors[0]
        raise ValueError(f"no clip can be used: {errors[0]}") from errors[0]


def check_storable(config: Config) -> None:
    """Raise ValueError if a library with this configuration cannot be stored."""
    if callable(config.segmentation):
        raise ValueError(
            "`segmentation` must be a name or the cut frames of each clip in a stored library, got "
            f"{config.segmentation!r}: functions are not stored"
        )


def warn_of_clips(
    entries: Sequence[ClipInfo],
    rate: float,
    match_notes: Mapping[str, Sequence[str]],
    *,
    stacklevel: int,
) -> None:
    """Warn about clips that were matched by anatomy, resampled to `rate`, or have faults.

    `match_notes` are those of `IngestRun`. `stacklevel` is the stack frame to which warnings refer:
    1 for the caller, 2 for its caller.
    """

    def warn(message: str) -> None:
        warnings.warn(message, stacklevel=stacklevel + 2)

    for note, names in match_notes.items():
        warn(f"joints matched by anatomy, {join_names(names, _MAX_WARNINGS)}: {note}")
    resampled = [info.name for info in entries if not rates_match(info.source_rate, rate)]
    if resampled:
        names = join_names(resampled, _MAX_WARNINGS)
        warn(f"resampled to {rate:.6g} fps, the frame rate of the library: {names}")
    faulty = [info for info in entries if info.faults]
    for info in faulty[:_MAX_WARNINGS]:
        faults = list(info.faults[:_MAX_FAULTS])
        if len(info.faults) > _MAX_FAULTS:
            faults.append(f"and {len(info.faults) - _MAX_FAULTS} more")
        warn(f"{info.name}: {'; '.join(faults)}. Segments with these frames are excluded as donors")
    if len(faulty) > _MAX_WARNINGS:
        n = len(faulty) - _MAX_WARNINGS
        warn(f"faults in {n} more clips; segments with faulty frames are excluded as donors")
