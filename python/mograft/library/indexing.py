"""The making of libraries: clips digested, compared, labelled, and written to a folder."""

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import HeldSamples
from mograft.analysis.embedding import CHUNK, Embedding, Samples, embed, means_of, normalise
from mograft.analysis.embedding import Source as SampleSource
from mograft.analysis.segmentation import Segments
from mograft.body.anatomy import feature_joints
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model
from mograft.body.mirroring import MirroredClips
from mograft.config import Config
from mograft.errors import MograftError
from mograft.library import storage as store
from mograft.library.clip_table import ClipInfo, ClipLocation
from mograft.library.discover import (
    ClipSource,
    FoundClip,
    find_clips,
    matching_values,
    relative_path,
    sort_by_path,
    unique_names,
)
from mograft.library.ingest import (
    ClipProperties,
    IngestedClip,
    IngestTask,
    Keep,
    LibrarySpec,
    RefusedClip,
    boundary_states,
    choose_spec,
    describe_source_file,
    ingest,
    ingest_all,
    join_segments,
    rates_match,
    read_properties,
)
from mograft.library.library import (
    Library,
    Progress,
    Tags,
    cluster_groups,
    feature_joints_by_group,
    write_and_commit,
)
from mograft.motion.motion import Motion

__all__ = ["IngestRun", "build", "mirror_library", "write"]


def build(
    sources: ClipSource | Iterable[ClipSource],
    groups: JointGroups | str,
    config: Config | None,
    rate: float | None,
    frame_rates: Mapping[str, float] | None,
    tags: Tags | None,
    executor: Executor | None,
    progress: Progress | None,
) -> Library:
    """See `Library.build`."""
    found = find_clips(sources)
    digesting = IngestRun.of(config, rate, executor, progress, strict=True)
    slots = [_Slot.of((index, ()), own, frame_rates) for index, own in enumerate(found)]
    taken: list[IngestedClip] = []
    shelf: list[ClipInfo] = []

    def take(slot: _Slot, own: IngestedClip) -> None:
        taken.append(own)
        shelf.append(slot.entered(own, tags))

    def forget() -> None:
        taken.clear()
        shelf.clear()

    terms = digesting.settled(slots, "motion", take, forget)
    names = unique_names([own.name for own in taken])
    skeleton = terms.skeleton
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, skeleton)
    entries = tuple(_called(own, name) for own, name in zip(shelf, names, strict=True))
    _warn(entries, terms.rate)
    clips = tuple(
        own.clip if own.clip.name == name else replace(own.clip, name=name)
        for own, name in zip(taken, names, strict=True)
        if isinstance(own.clip, Motion)
    )
    segments = join_segments([(own.segments.start, own.segments.stop) for own in taken])
    samples = Samples(
        np.concatenate([own.samples for own in taken]), terms.config.samples, skeleton.n_joints
    )
    members = feature_joints_by_group(groups, skeleton)
    embedding = _embedded(samples, groups, terms, digesting.tell)
    labels, sigma = cluster_groups(embedding, len(segments), terms.config)
    return Library(
        clips,
        groups,
        terms.config,
        segments,
        np.concatenate([own.is_donor for own in taken]),
        embedding,
        labels,
        sigma,
        terms.root,
        terms.up,
        skeleton,
        terms.rate,
        entries,
        {
            group: {
                key: np.concatenate([own.boundary_states[key][:, joints] for own in taken])
                for key in taken[0].boundary_states
            }
            for group, joints in members.items()
        },
        samples,
        {},
    )


def mirror_library(library: Library) -> Library:
    """See `Library.mirrored`."""
    n = len(library.entries)
    names = unique_names(
        [*(e.name for e in library.entries), *(f"{e.name}_mirrored" for e in library.entries)]
    )
    clips = MirroredClips(library.clips, tuple(names))
    rows, ends = [chunk.packed() for chunk in library.samples.chunks()], []
    for index in range(n):
        clip, own = clips[n + index], library.segments.of_clip(index)
        cut = Segments(library.segments.start[own], library.segments.stop[own])
        sampled = normalise(
            [clip],
            cut,
            library.config,
            root=library.root,
            up=library.up,
            heights=[mass_model(clip.skeleton).height],
        )
        rows.append(sampled.packed())
        ends.append(boundary_states(clip, cut))
    samples = Samples(np.concatenate(rows), library.config.samples, library.skeleton.n_joints)
    terms = LibrarySpec(library.skeleton, library.rate, library.root, library.up, library.config)
    embedding = _embedded(samples, library.groups, terms, _say_nothing)
    labels, sigma = cluster_groups(embedding, 2 * len(library.segments), library.config)
    twice = replace(library.segments, clip=library.segments.clip + n)
    return replace(
        library,
        clips=clips,
        segments=Segments(
            *(
                np.concatenate([getattr(cut, part) for cut in (library.segments, twice)])
                for part in ("start", "stop", "clip")
            )
        ),
        is_donor=np.concatenate([library.is_donor, library.is_donor]),
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        entries=tuple(
            replace(e, name=name)
            for e, name in zip(library.entries + library.entries, names, strict=True)
        ),
        boundary_states={
            group: {
                key: np.concatenate([known, *(own[key][:, joints] for own in ends)])
                for key, known in library.boundary_states[group].items()
            }
            for group, joints in feature_joints_by_group(library.groups, library.skeleton).items()
        },
        samples=samples,
        folder=None,
    )


def _say_nothing(*_: object) -> None:
    pass


def _never_mind() -> None:
    pass


Key = tuple[int, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class _Slot:
    """A clip that is to be digested, and where it stands among the others.

    It is either found anew or one of the generation before.
    """

    key: Key
    found: FoundClip | None
    given_rate: float | None
    entry: ClipInfo | None = None

    @classmethod
    def of(cls, key: Key, found: FoundClip, frame_rates: Mapping[str, float] | None) -> "_Slot":
        rates = matching_values(frame_rates, found)
        if rates and not 0 < rates[-1] < float("inf"):
            raise ValueError(f"frame_rates must be above 0 frames per second, got {rates[-1]}")
        return cls(key, found, float(rates[-1]) if rates else None)

    def task(self) -> IngestTask:
        if self.found is None:
            raise RuntimeError("clips of the generation before are read from there")
        source = self.found.source
        where = os.path.abspath(source) if isinstance(source, str) else source
        return IngestTask(where, self.given_rate)

    def entered(self, own: IngestedClip, tags: Tags | None) -> ClipInfo:
        """Return what is known of the clip, now that it is digested; its name is not yet."""
        if self.entry is not None:
            return replace(self.entry, n_frames=own.n_frames, faults=own.faults)
        words: list[str] = []
        if self.found is not None:
            words += self.found.folders
            words += chain.from_iterable(matching_values(tags, self.found))
        return _entry(own, self.given_rate, tuple(dict.fromkeys(words)))


@dataclass(frozen=True, eq=False)
class IngestRun:
    """How clips are digested; collects what was refused."""

    config: Config
    rate: float | None
    executor: Executor | None
    tell: Progress
    strict: bool
    refused: dict[str, Exception]

    @classmethod
    def of(
        cls,
        config: Config | None,
        rate: float | None,
        executor: Executor | None,
        progress: Progress | None,
        *,
        strict: bool,
    ) -> "IngestRun":
        """Begin, with nothing refused yet."""
        own = Config() if config is None else config
        return cls(own, rate, executor, progress or _say_nothing, strict, {})

    def settled(
        self,
        slots: Sequence[_Slot],
        keep: Keep,
        take: Callable[[_Slot, IngestedClip], object],
        forget: Callable[[], object] = _never_mind,
    ) -> LibrarySpec:
        """Digest clips by terms that are guessed; again, if they turn out to be others."""
        tasks, terms = self._guess([slot.task() for slot in slots])
        while True:
            facts = self.once(slots, tasks, keep, take, terms)
            settled = choose_spec(_in_order(facts), self.config, self.rate)
            if settled.agrees(terms):
                self.check_refused()
                return terms
            forget()
            terms = settled

    def once(
        self,
        slots: Sequence[_Slot],
        tasks: Iterable[IngestTask],
        keep: Keep,
        take: Callable[[_Slot, IngestedClip], object],
        terms: LibrarySpec,
    ) -> list[tuple[Key, ClipProperties]]:
        """Digest clips by some terms; return what they say of themselves."""
        facts: list[tuple[Key, ClipProperties]] = []
        self.refused.clear()
        outcomes = ingest_all(tasks, terms, keep, self.executor)
        for done, (slot, outcome) in enumerate(zip(slots, outcomes, strict=True)):
            self.tell("reading", done + 1, len(slots))
            if outcome.properties is not None:
                facts.append((slot.key, outcome.properties))
            if isinstance(outcome, IngestedClip):
                take(slot, outcome)
                continue
            self.refused[outcome.name] = outcome.error
            if outcome.properties is None and self.strict:
                raise outcome.error
        return facts

    def check_refused(self) -> None:
        """Raise the first refusal, where clips that do not fit are not left out."""
        for error in self.refused.values():
            if self.strict:
                raise error

    def reasons(self) -> dict[str, str]:
        """Return the clips that were left out, and why."""
        return {what: str(error) for what, error in self.refused.items()}

    def _guess(self, tasks: list[IngestTask]) -> tuple[list[IngestTask], LibrarySpec]:
        """Ask a few clips spread over all what the terms may be; each is read but once."""
        spread = np.unique(np.linspace(0, len(tasks) - 1, 9).round().astype(int)).tolist()
        facts: list[ClipProperties] = []
        for index in [*spread, *range(len(tasks))]:
            if facts and index not in spread:
                break
            try:
                tasks[index], found = read_properties(tasks[index])
            except (MograftError, OSError, ValueError):
                continue  # it will be refused, with the others of its kind
            facts.append(found)
        if not facts:
            refusal = ingest(tasks[0], None, "numbers")
            if not isinstance(refusal, RefusedClip):
                raise RuntimeError("a clip was read that could not be read")
            if self.strict:
                raise refusal.error
            raise ValueError(f"no clip can be used: {refusal.error}") from refusal.error
        return tasks, choose_spec(facts, self.config, self.rate)


def _in_order(facts: Sequence[tuple[Key, ClipProperties]]) -> list[ClipProperties]:
    """Return facts in the order of their clips."""
    return [own for _, own in sorted(facts, key=lambda pair: pair[0])]


def _entry(own: IngestedClip, given_rate: float | None, tags: tuple[str, ...]) -> ClipInfo:
    return ClipInfo(
        own.name,
        own.name,
        own.source_file,
        own.properties.rate,
        given_rate,
        own.properties.n_frames,
        own.n_frames,
        own.properties.root,
        own.properties.up,
        own.faults,
        tags,
    )


def _called(entry: ClipInfo, name: str) -> ClipInfo:
    return entry if entry.name == name else replace(entry, name=name)


_MOST_WARNINGS = 8


def _warn(entries: Sequence[ClipInfo], rate: float) -> None:
    """Warn of clips that were resampled and of those with faults."""
    others = [entry.name for entry in entries if not rates_match(entry.source_rate, rate)]
    if others:
        more = len(others) - _MOST_WARNINGS
        listed = ", ".join(others[:_MOST_WARNINGS]) + (f" and {more} more" if more > 0 else "")
        warnings.warn(
            f"resampled to {rate:.6g} fps, the rate of most frames: {listed}", stacklevel=4
        )
    faulty = [entry for entry in entries if entry.faults]
    for entry in faulty[:_MOST_WARNINGS]:
        more = len(entry.faults) - 3
        rest = f"; and {more} more" if more > 0 else ""
        warnings.warn(
            f"{entry.name}: {'; '.join(entry.faults[:3])}{rest}. "
            "These frames lend nothing to others",
            stacklevel=4,
        )
    if len(faulty) > _MOST_WARNINGS:
        warnings.warn(
            f"faults in {len(faulty) - _MOST_WARNINGS} more clips; their frames lend nothing "
            "to others either",
            stacklevel=4,
        )


def _embedded(
    samples: SampleSource, groups: JointGroups, terms: LibrarySpec, tell: Progress
) -> dict[str, Embedding | None]:
    members, held = groups.resolve(terms.skeleton), groups.divided_channels(terms.skeleton)
    tell("comparing", 0, len(members))
    means = means_of(samples, terms.skeleton.n_joints)
    found = {}
    for name, joints in members.items():
        counted = feature_joints(terms.skeleton, joints)
        if terms.root in joints:
            counted = np.union1d(counted, [terms.root])
        if terms.root in held[name]:
            raise ValueError(
                f"group {name!r}: {terms.skeleton.names[terms.root]} must be held whole: it "
                "carries the body"
            )
        source, own = samples, means
        if held[name]:
            source = HeldSamples(samples, terms.skeleton, held[name])
            own = means_of(source, terms.skeleton.n_joints)
        found[name] = embed(source, counted, own, terms.config, root=terms.root, group=name)
        tell("comparing", len(found), len(members))
    return found


# Libraries in folders.


@dataclass(frozen=True, eq=False)
class _Shelved:
    """A clip of the generation that is written.

    `row` is the first of its segments among those of the generation before, or among those
    that were taken afresh.
    """

    key: Key
    entry: ClipInfo
    place: ClipLocation
    start: IntArray
    stop: IntArray
    is_donor: BoolArray
    row: int
    is_fresh: bool

    def __len__(self) -> int:
        return len(self.start)


def write(
    draft: store.GenerationWriter,
    base: Library | None,
    found: Sequence[FoundClip],
    groups: JointGroups | str,
    digesting: IngestRun,
    frame_rates: Mapping[str, float] | None,
    tags: Tags | None,
) -> None:
    """Write a library of files, and of what the generation before has of others."""
    slots = [
        _Slot.of((0, way), own, frame_rates)
        for way, own in sort_by_path(found, draft.final).items()
    ]
    fresh: list[_Shelved] = []

    def take(slot: _Slot, own: IngestedClip) -> None:
        place, entry = draft.take(own), slot.entered(own, tags)
        ends = own.segments.start, own.segments.stop
        fresh.append(
            _Shelved(slot.key, entry, place, *ends, own.is_donor, place.first_row, is_fresh=True)
        )

    def forget() -> None:
        fresh.clear()
        draft.restart()

    kept: list[_Shelved] = []
    if base is None:
        terms = digesting.settled(slots, "numbers", take, forget)
    else:
        there = {own.source_file.path: own for own in base.entries if own.source_file is not None}
        slots = [slot for slot in slots if _is_new(slot, there)]
        if not slots and not tags:
            return
        kept = _kept(base, slots, tags)
        terms = LibrarySpec(base.skeleton, base.rate, base.root, base.up, base.config)
        draft.go_on()
        facts = [(own.key, own.entry.properties(base.skeleton)) for own in kept]
        new = digesting.once(slots, map(_Slot.task, slots), "numbers", take, terms)
        facts += [(key, own) for key, own in new if own.same_hierarchy(base.skeleton)]
        # A clip that is not what it was and does not fit any more is left out, unless no
        # other is left.
        settled = choose_spec(_in_order(facts), base.config, digesting.rate) if facts else terms
        if not settled.agrees(terms) or draft.is_scattered([own.place for own in kept]):
            # What clips have in common has changed: all are digested anew, the ones that are
            # here from what is here.
            forget()
            terms = settled
            slots = [
                _Slot(own.key, None, own.entry.rate_override, own.entry) for own in kept
            ] + slots
            tasks = chain(_tasks_of(base, kept), map(_Slot.task, slots[len(kept) :]))
            kept = []
            digesting.once(slots, tasks, "numbers", take, terms)
        digesting.check_refused()

    if not kept and not fresh:
        why = next(iter(digesting.reasons().values()))
        raise ValueError(f"no clip can be used: {why}")
    shelved = sorted([*kept, *fresh], key=lambda own: own.key)
    names = unique_names([own.entry.source_name for own in shelved])
    entries = tuple(_called(own.entry, name) for own, name in zip(shelved, names, strict=True))
    segments = join_segments([(own.start, own.stop) for own in shelved])
    places = [own.place for own in shelved]
    extents = [(own.place.shard, own.place.first_row, len(own)) for own in shelved]
    samples = draft.samples(extents, terms.config.samples, terms.skeleton.n_joints)
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, terms.skeleton)
    _warn(entries, terms.rate)
    if base is not None and kept and not slots:  # nothing has changed but tags
        embedding, labels, sigma = base.embedding, base.labels, base.sigma
    else:
        embedding = _embedded(samples, groups, terms, digesting.tell)
        digesting.tell("clustering", 0, 1)
        labels, sigma = cluster_groups(embedding, len(segments), terms.config)
        digesting.tell("clustering", 1, 1)
    refused = {**(base.refused if base is not None else {}), **digesting.reasons()}
    library = Library(
        (),
        groups,
        terms.config,
        segments,
        np.concatenate([own.is_donor for own in shelved]),
        embedding,
        labels,
        sigma,
        terms.root,
        terms.up,
        terms.skeleton,
        terms.rate,
        entries,
        {},
        samples,
        refused,
    )
    digesting.tell("writing", 0, 1)
    write_and_commit(
        draft, library, places, _edge_pieces(draft, base, shelved, library), digesting.rate
    )
    digesting.tell("writing", 1, 1)


def _is_new(slot: _Slot, there: Mapping[str, ClipInfo]) -> bool:
    """Tell whether a file is not in a library as it is now."""
    path = os.path.abspath(str(slot.found.source)) if slot.found is not None else ""
    entry = there.get(path)
    if entry is None or entry.source_file is None:
        return True
    if slot.given_rate is not None and slot.given_rate != entry.rate_override:
        return True
    try:
        now = os.stat(path)
        if (now.st_size, now.st_mtime_ns) == (entry.source_file.size, entry.source_file.mtime_ns):
            return False
        return describe_source_file(path).sha256 != entry.source_file.sha256
    except OSError:
        return True  # reading it will say why


def _kept(base: Library, slots: Sequence[_Slot], tags: Tags | None) -> list[_Shelved]:
    """Return the clips of a library that no new ones take the place of."""
    if base.folder is None or not isinstance(base.clips, store.StoredClips):
        raise TypeError("the base must be a stored library")
    anew = {slot.key for slot in slots}
    bounds = np.searchsorted(base.segments.clip, np.arange(len(base.entries) + 1)).tolist()
    kept = []
    for index, (entry, place) in enumerate(zip(base.entries, base.clips.places, strict=True)):
        key: Key = (1, (f"{index:09}",))
        own = entry
        if entry.source_file is not None:
            key = (0, relative_path(entry.source_file.path, base.folder).parts)
            words = dict.fromkeys(
                chain(entry.tags, *matching_values(tags, FoundClip(entry.source_file.path)))
            )
            if len(words) > len(entry.tags):
                own = replace(entry, tags=tuple(words))
        if key in anew:
            continue
        rows = slice(bounds[index], bounds[index + 1])
        ends = base.segments.start[rows], base.segments.stop[rows]
        is_donor = base.is_donor[rows]
        kept.append(_Shelved(key, own, place, *ends, is_donor, rows.start, is_fresh=False))
    return kept


def _tasks_of(base: Library, kept: Sequence[_Shelved]) -> Iterator[IngestTask]:
    """Yield clips of a library to be digested anew, each read when it is its turn."""
    if not isinstance(base.clips, store.StoredClips):
        raise TypeError("the base must be a stored library")
    at = {place: index for index, place in enumerate(base.clips.places)}
    for own in kept:
        clip = base.clips.original(at[own.place], as_read=True)
        yield IngestTask(clip, own.entry.rate_override, own.entry.source_file)


def _edge_pieces(
    draft: store.GenerationWriter,
    base: Library | None,
    shelved: Sequence[_Shelved],
    library: Library,
) -> dict[str, dict[str, Iterator[FloatArray]]]:
    """Return the edges of each group, a piece at a time, in the order of segments."""
    runs = store.merge_ranges([(int(own.is_fresh), own.row, len(own)) for own in shelved])

    def pieces(group: str, key: str, joints: IntArray) -> Iterator[FloatArray]:
        for is_fresh, first, n in runs:
            for start in range(first, first + n, CHUNK):
                stop = min(start + CHUNK, first + n)
                if is_fresh:
                    yield draft.fresh_edges(key, start, stop)[:, joints]
                elif base is not None:
                    yield base.boundary_states[group][key][start:stop]

    keys = tuple(draft.edge_keys() if base is None else next(iter(base.boundary_states.values())))
    return {
        group: {key: pieces(group, key, joints) for key in keys}
        for group, joints in feature_joints_by_group(library.groups, library.skeleton).items()
    }
