"""Ingest of all clips of a library, with the specification that they determine."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from mograft.errors import SkeletonMismatchError, join_names
from mograft.library.clip_table import ClipInfo
from mograft.library.ingest import (
    INGEST_ERRORS,
    ClipOrder,
    IngestedClip,
    PendingClip,
    ingest_all,
    read_properties,
)
from mograft.library.plan import IngestPlan
from mograft.library.spec import ClipProperties, LibrarySpec, choose_spec, rates_match

T = TypeVar("T")
Properties = Sequence[tuple[ClipOrder, ClipProperties]]
Store = Callable[[PendingClip, IngestedClip], T]
"""Called with each ingested clip; returns what is kept of it."""

_MAX_SAMPLED_CLIPS = 9
"""Clips from which the library specification is guessed before all clips are read."""

_MAX_WARNINGS = 8
"""Clips that warnings name."""

_MAX_FAULTS = 3
"""Faults per clip that warnings name."""


@dataclass(frozen=True, eq=False)
class IngestResult(Generic[T]):
    """The result of the ingest of several clips."""

    spec: LibrarySpec  # with which they were ingested
    clips: list[T]  # what `Store` returned for each clip that was not refused
    properties: Properties  # of all clips that could be read
    errors: Mapping[str, Exception]  # of refused clips, by address or name
    match_notes: Mapping[str, Sequence[str]]  # names of clips matched by anatomy, by note

    def raise_first_error(self) -> None:
        """Raise the error of the first refused clip, if there is one."""
        for error in self.errors.values():
            raise error


def ingest_fitting(
    pending: Sequence[PendingClip], plan: IngestPlan, store: Store[T], restart: Callable[[], object]
) -> IngestResult[T]:
    """Ingest clips with the library specification that they determine.

    The specification is first guessed from a few clips. If the properties of all clips determine
    another one, `restart` is called, and all clips are ingested again.
    """
    pending, spec = _guess_spec(list(pending), plan)
    while True:
        result = ingest_pending(pending, spec, plan, store)
        chosen = choose_library_spec(result.properties, plan)
        if chosen.is_equivalent(spec):
            if plan.strict:
                result.raise_first_error()
            return result
        restart()
        spec = chosen


def ingest_pending(
    pending: Sequence[PendingClip], spec: LibrarySpec, plan: IngestPlan, store: Store[T]
) -> IngestResult[T]:
    """Ingest clips with a specification, and call `store` with each clip that is not refused."""
    clips: list[T] = []
    properties: list[tuple[ClipOrder, ClipProperties]] = []
    errors: dict[str, Exception] = {}
    notes: dict[str, list[str]] = {}
    tasks = (clip.task() for clip in pending)
    results = ingest_all(tasks, spec, plan.config, plan.executor, is_packed=plan.is_packed)
    for done, (clip, result) in enumerate(zip(pending, results, strict=True), start=1):
        plan.report("reading", done, len(pending))
        if result.properties is not None:
            properties.append((clip.order, result.properties))
        if isinstance(result, IngestedClip):
            if result.match_note:
                notes.setdefault(result.match_note, []).append(result.name)
            clips.append(store(clip, result))
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
    pending: Sequence[PendingClip], properties: Properties, spec: LibrarySpec
) -> str:
    """Return a text that names a new clip with the hierarchy of `spec`; "" if there is none."""
    fitting = {order for order, own in properties if own.skeleton.has_same_hierarchy(spec.skeleton)}
    new = (clip for clip in pending if clip.known is None and clip.order in fitting)
    label = next((clip.task().label for clip in new), None)
    if label is None:
        return ""
    more = f" and {len(fitting) - 1} more" if len(fitting) > 1 else ""
    return (
        f", unlike {label}{more}; each library or graft takes clips of one hierarchy, unless "
        "joints are matched by anatomy (--match anatomy)"
    )


def choose_library_spec(properties: Properties, plan: IngestPlan) -> LibrarySpec:
    """Choose the library specification; the order of ingest does not affect it."""
    clips = [clip for _, clip in sorted(properties, key=lambda pair: pair[0])]
    return choose_spec(clips, plan.rate, plan.match, plan.skeleton, plan.hierarchy)


def _guess_spec(
    pending: list[PendingClip], plan: IngestPlan
) -> tuple[list[PendingClip], LibrarySpec]:
    """Guess the specification from a few clips; return the clips and the specification.

    The tasks of these clips then hold the motions, so that no file is read twice. Raise an error if
    no clip can be used.
    """
    n = len(pending)
    sampled = np.unique(np.linspace(0, n - 1, _MAX_SAMPLED_CLIPS).round().astype(int)).tolist()
    properties: list[tuple[ClipOrder, ClipProperties]] = []
    errors: list[Exception] = []
    for index in [*sampled, *range(n)]:
        if properties and index not in sampled:
            break
        clip = pending[index]
        try:
            task, own = read_properties(clip.task(), plan.skeleton)
        except INGEST_ERRORS as error:
            errors.append(error)
        else:
            pending[index] = replace(clip, task=lambda task=task: task)
            properties.append((clip.order, own))
    if properties:
        return pending, choose_library_spec(properties, plan)
    if plan.strict:
        raise errors[0]
    raise ValueError(f"no clip can be used: {errors[0]}") from errors[0]


def warn_of_clips(
    entries: Sequence[ClipInfo],
    rate: float,
    match_notes: Mapping[str, Sequence[str]],
    *,
    stacklevel: int,
) -> None:
    """Warn about clips that were matched by anatomy, resampled to `rate`, or have faults.

    `match_notes` is the field of `IngestResult`. `stacklevel` is the stack frame to which warnings
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
