"""Ingest of all clips of a library: options, order, refusals, warnings."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple, Protocol, TypedDict

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


_OPTION_TYPES: Mapping[str, type] = {
    "skeleton": Skeleton,
    "hierarchy": Skeleton,
    "frame_rates": Mapping,
    "tags": Mapping,
    "executor": Executor,
}
"""Types of the options that may be None."""


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
        """Return the metadata of the clip, given the result of its ingest.

        `tags` is the argument of `Library.build`. The name need not be unique.
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
    """Destination of ingested clips: a list, or another object with the same methods."""

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
    is_packed: bool  # as for `ingest`
    include_grafts: bool = False
    rate: float | None = None
    match: Match = "names"
    skeleton: Skeleton | None = None  # the rest pose of files that store none
    hierarchy: Skeleton | None = None  # of the library, if clips are matched by anatomy
    frame_rates: Mapping[str, float] | None = None
    tags: Mapping[str, Iterable[str]] | None = None
    executor: Executor | None = None
    progress: Progress | None = None
    # Results: the errors of refused clips by label, and labels of clips by note.
    errors: dict[str, Exception] = field(init=False, default_factory=dict)
    match_notes: dict[str, list[str]] = field(init=False, default_factory=dict)

    @classmethod
    def from_options(cls, options: "AddOptions | IngestOptions", **fixed: Any) -> "IngestRun":  # noqa: ANN401
        """Return a run with the fields `fixed`, and with `options`, those of a public method.

        Raise TypeError if `options` has a name that is not in `IngestOptions`.
        """
        allowed = sorted(IngestOptions.__optional_keys__)
        for name in options:
            if name not in allowed:
                raise TypeError(
                    f"unknown option `{name}`: expected {join_names(allowed)}"
                    f"{suggest_name(name, allowed)}"
                )
        return cls(**fixed, **options)

    def __post_init__(self) -> None:
        if self.match not in MATCHES:
            hint = suggest_name(self.match, MATCHES)
            raise ValueError(f"`match` must be 'names' or 'anatomy', got {self.match!r}{hint}")
        check_type("config", self.config, Config)
        check_segmentation(self.config)
        if self.is_packed:
            check_storable(self.config)
        for name, kind in _OPTION_TYPES.items():
            if getattr(self, name) is not None:
                check_type(name, getattr(self, name), kind)
        if self.progress is not None and not callable(self.progress):
            raise TypeError(f"`progress` must be a function, got {type(self.progress).__name__}")
        if self.hierarchy is not None and self.match != "anatomy":
            raise ValueError("`match` must be 'anatomy' if `hierarchy` is given, got 'names'")

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
        """Return a found clip as a clip to ingest, with the rate that `frame_rates` gives, if any.

        Raise ValueError if the rate is not above 0.
        """
        rates = matching_values(self.frame_rates, found)
        if rates and not 0 < rates[-1] < float("inf"):
            raise ValueError(
                f"values of `frame_rates` must be above 0 frames per second, got {rates[-1]}"
            )
        return PendingClip(order, found, float(rates[-1]) if rates else None)

    def ingest_and_choose_spec(
        self, clips: Sequence[PendingClip], receiver: ClipReceiver
    ) -> LibrarySpec:
        """Ingest clips, pass them to `receiver`, and return the library specification.

        The specification is first guessed from a few clips. If the properties of all clips
        determine another one, all clips are ingested again.
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

        `tasks` has the task of each clip. The errors of refused clips are stored in `errors`.
        Return the properties of the clips that could be read.
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
        """Add the name of a clip with the hierarchy of `spec` to the errors of clips without it."""
        fitting = {
            order for order, own in properties if own.skeleton.has_same_hierarchy(spec.skeleton)
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
        """Return for each refused clip, by address or name, the reason of the refusal."""
        return {label: str(error) for label, error in self.errors.items()}

    def _guess_spec(self, tasks: list[IngestTask]) -> tuple[list[IngestTask], LibrarySpec]:
        """Guess the specification from a few clips; return the tasks and the specification.

        The tasks of these clips then hold the motions, so that no file is read twice. Raise an
        error if no clip can be used.
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
            "`segmentation` of a stored library must be a name or the cut frames of each clip, got "
            f"the function {config.segmentation!r}"
        )


def warn_of_clips(
    entries: Sequence[ClipInfo],
    rate: float,
    match_notes: Mapping[str, Sequence[str]],
    *,
    stacklevel: int,
) -> None:
    """Warn about clips that were matched by anatomy, resampled to `rate`, or have faults.

    `match_notes` is the field of `IngestRun`. `stacklevel` is the stack frame to which warnings
    refer: 1 for the caller, 2 for its caller.
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
