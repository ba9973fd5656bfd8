"""Build a library in a folder, and add clips to it."""

import os
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.embedding import CHUNK
from mograft.errors import MograftError, join_names
from mograft.io.formats import find_addresses, open_clips, split_address
from mograft.library import ingest_run
from mograft.library.build import choose_groups, join_clips, name_clips, spread_evenly
from mograft.library.clip_table import ClipInfo, ClipLocation
from mograft.library.clusters import compare, feature_joints_by_group
from mograft.library.data import LibraryData
from mograft.library.discover import ClipSource, FoundClip, SourceFile, relative_path
from mograft.library.files import generation
from mograft.library.files.generation import GenerationWriter
from mograft.library.files.storage import load_library
from mograft.library.files.stored_clips import JoinedSamples, StoredClips
from mograft.library.ingest import ClipOrder, IngestedClip, PendingClip, ingest_all
from mograft.library.ingest_run import IngestPlan, IngestResult, ingest_pending
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.search.boundary_states import BoundaryStates


@dataclass(frozen=True, eq=False)
class _Update:
    """The generation that is being written, with the options and the clips to ingest."""

    writer: GenerationWriter
    plan: IngestPlan
    pending: Sequence[PendingClip]
    base: LibraryData | None = None  # the previous generation, if clips are added to it


@dataclass(frozen=True, eq=False)
class _IndexedClip:
    """A clip of the generation that is being written."""

    order: ClipOrder
    info: ClipInfo
    location: ClipLocation
    segments: Segments
    is_donor: BoolArray  # whether each segment may be a donor
    old_row: int | None = None  # first segment in the previous generation; None for a new clip


_Ingested = IngestResult[_IndexedClip]


def index_folder(
    path: Path, sources: ClipSource | Iterable[ClipSource], plan: IngestPlan, *, force: bool
) -> None:
    """Build a library in a folder; see `Library.index`."""
    with generation.write_generation(path, force=force) as writer:
        found = _find_files(plan, sources, writer.final)
        pending = [plan.pending((0, key), own) for key, own in found.items()]
        plan.warn_of_keys(stacklevel=3)
        result = ingest_run.ingest_fitting(pending, plan, partial(_store, writer), writer.restart)
        _complete(_Update(writer, plan, pending), result)


def add_to_folder(path: Path, sources: ClipSource | Iterable[ClipSource], plan: IngestPlan) -> None:
    """Add clips to a library in a folder; see `Library.add`."""
    with generation.write_generation(path, add=True) as writer:
        assert writer.base is not None
        # Another process may have added clips since the library was opened.
        base = load_library(LibraryData, writer.base)
        files = {info.source_file.address: info for info in base.entries if info.source_file}
        plan = replace(
            plan,
            config=base.config,
            groups=base.groups,
            rate=writer.base.manifest["given_rate"],
            match=base.spec.match,
            skeleton=base.spec.rest,
        )
        found = _find_files(plan, sources, writer.final)
        given = [plan.pending((0, key), own) for key, own in found.items()]
        pending = [clip for clip in given if _is_new_or_changed(clip, files)]
        if not pending and not plan.tags:
            return
        update = _Update(writer, plan, pending, base)
        kept = _kept_clips(update, base, _stale_addresses(update, files), found)
        plan.warn_of_keys(stacklevel=3)
        writer.link_shards(writer.base)
        _complete(update, _ingest_additions(update, base, kept))


def _store(writer: GenerationWriter, clip: IngestedClip) -> _IndexedClip:
    """Write an ingested clip to a generation."""
    order, _, info = clip.properties
    return _IndexedClip(order, info, writer.write_clip(clip), clip.segments, clip.is_donor)


def _find_files(
    plan: IngestPlan, sources: ClipSource | Iterable[ClipSource], folder: Path
) -> dict[tuple[str, ...], FoundClip]:
    """Return the clips of files that `sources` stand for, by `_path_key`, in its order.

    Raise TypeError if a source is a motion.
    """
    by_path = {}
    for found in plan.find_clips(sources):
        if isinstance(found.source, Motion):
            raise TypeError(
                "`sources` must be files, got a Motion; store motions by Library.build and save"
            )
        by_path[_path_key(found.source, folder)] = found
    return {path: by_path[path] for path in sorted(by_path)}


def _path_key(address: str, folder: Path) -> tuple[str, ...]:
    """Return the sort key of a clip in a library in `folder`.

    It consists of the path of the file relative to the folder and the name of the clip, if any.
    """
    path, clip = split_address(address)
    parts = relative_path(path, folder).parts
    return parts if clip is None else (*parts, clip)


def _is_new_or_changed(clip: PendingClip, files: Mapping[str, ClipInfo]) -> bool:
    """Return whether a clip is not in the library, or its file or its frame rate has changed.

    `files` holds the metadata of the library's clips by address.
    """
    info = files.get(clip.label)
    known = None if info is None else info.source_file
    if info is None or known is None or clip.rate_override not in (None, info.rate_override):
        return True
    try:
        status = os.stat(known.path)
        if (status.st_size, status.st_mtime_ns) == (known.size, known.mtime_ns):
            return False
        return SourceFile.from_path(known.path).sha256 != known.sha256
    except OSError:
        return True  # ingest will raise the error


def _stale_addresses(update: _Update, files: Mapping[str, ClipInfo]) -> set[str]:
    """Return the addresses of the library's clips that are no longer valid.

    `files` holds the metadata of the library's clips by address. Warn about the clips that their
    changed files no longer contain. Do not warn about clips whose address has changed: the address
    of the only clip of a file has no name.
    """
    changed = {split_address(clip.label)[0] for clip in update.pending}
    rest = update.plan.skeleton
    known: dict[str, list[SourceFile]] = {}
    for info in files.values():
        if info.source_file is not None and info.source_file.path in changed:
            known.setdefault(info.source_file.path, []).append(info.source_file)
    stale: set[str] = set()
    for path, sources in known.items():
        try:
            found = set(find_addresses(path, skeleton=rest))
            names = {*open_clips(path, skeleton=rest).names}
        except (OSError, MograftError):
            continue  # the ingest reports the error
        old = [source for source in sources if source.address not in found]
        stale |= {source.address for source in old}
        removed = [source.clip for source in old if source.clip and source.clip not in names]
        if removed:
            warnings.warn(
                f"removed from the library, because {path} no longer contains them: "
                f"{join_names(removed)}",
                stacklevel=4,
            )
    return stale


def _kept_clips(
    update: _Update,
    base: LibraryData,
    stale: Collection[str],
    found: Mapping[tuple[str, ...], FoundClip],
) -> list[_IndexedClip]:
    """Return the clips of the previous generation `base` that no pending clip replaces.

    Clips whose addresses are in `stale` are left out. The tags of the plan whose keys match a clip
    are added to its metadata; `found` has the clips of the sources, whose keys are known.
    """
    clips = base.clips
    assert isinstance(clips, StoredClips)
    replaced = {clip.order for clip in update.pending}
    bounds = np.searchsorted(base.segments.clip, np.arange(len(base.entries) + 1)).tolist()
    kept = []
    for index, info in enumerate(base.entries):
        order: ClipOrder = (1, (f"{index:09}",))
        if info.source_file is not None:
            address = info.source_file.address
            if address in stale:
                continue
            key = _path_key(address, update.writer.final)
            order = (0, key)
            own = found.get(key) or FoundClip(address)
            tags = dict.fromkeys(chain(info.tags, *update.plan.tag_keys.match(own)))
            if len(tags) > len(info.tags):
                info = info._replace(tags=tuple(tags))
        if order in replaced:
            continue
        rows = slice(bounds[index], bounds[index + 1])
        location, cut = clips.table.locations[index], base.segments[rows]
        kept.append(_IndexedClip(order, info, location, cut, base.is_donor[rows], rows.start))
    return kept


def _ingest_additions(
    update: _Update, base: LibraryData, kept: Sequence[_IndexedClip]
) -> _Ingested:
    """Ingest pending clips; return the result for the kept and the new clips.

    If the specification changes, or there are too many shards, the kept clips are ingested again.
    """
    writer, plan, pending = update.writer, update.plan, update.pending
    result = ingest_pending(pending, base.spec, plan, partial(_store, writer))
    properties = [(clip.order, base.skeleton, clip.info) for clip in kept]
    # A changed file that no longer fits is left out, unless no clip would remain.
    properties += [own for own in result.properties if own[1].has_same_hierarchy(base.skeleton)]
    # Clips matched by anatomy keep the specification: their properties are those of other joints.
    is_chosen = bool(properties) and plan.match == "names"
    spec = ingest_run.choose_spec(properties, plan) if is_chosen else base.spec
    if spec.is_equivalent(base.spec) and len(writer.shards) <= generation.MAX_SHARDS:
        result = replace(result, clips=[*kept, *result.clips])
    else:
        writer.restart()
        again = list(_pending_again(base, kept))
        result = ingest_pending([*again, *pending], spec, plan, partial(_store, writer))
    return result.checked(plan)


def _pending_again(base: LibraryData, kept: Sequence[_IndexedClip]) -> Iterator[PendingClip]:
    """Yield the `kept` clips as clips to ingest, which are read when they are ingested."""
    clips = base.clips
    assert isinstance(clips, StoredClips)
    index_of = {location: index for index, location in enumerate(clips.table.locations)}
    for clip in kept:
        info, read = clip.info, partial(clips.original, index_of[clip.location], as_read=True)
        file = info.source_file
        yield PendingClip(clip.order, read, (), info.rate_override, file, known=info)


def _complete(update: _Update, result: _Ingested) -> None:
    """Embed and cluster the segments of all clips, and commit the generation.

    If no clip is new, only tags differ from those of the previous one. Raise ValueError if there is
    no clip.
    """
    writer, plan, base = update.writer, update.plan, update.base
    reasons = {label: str(error) for label, error in result.errors.items()}
    if not result.clips:
        raise ValueError(f"no clip can be used: {next(iter(reasons.values()))}")
    spec, config = result.spec, plan.config
    groups = choose_groups(plan, spec.skeleton, _sample_motions(update, result))
    only_tags = base is not None and not update.pending and spec is base.spec
    # If only tags differ, the segments keep the order of the clips of `base`.
    clips = result.clips if only_tags else sorted(result.clips, key=lambda clip: clip.order)
    entries = name_clips([clip.info for clip in clips])
    ranges = [(own.location.shard, own.location.first_row, len(own.segments)) for own in clips]
    n_joints = spec.skeleton.n_joints
    samples = JoinedSamples(writer.map_samples(), np.array(ranges), config.samples, n_joints)
    ingest_run.warn_of_clips(entries, result, stacklevel=4)
    if base is not None and only_tags:
        library = replace(base, entries=entries)
    else:
        cuts = [(clip.segments, clip.is_donor) for clip in clips]
        library = join_clips(LibraryData, cuts, entries, samples, groups, spec, config)
        library = compare(library, plan.report)
    known = {} if base is None else base.refused
    library = replace(library, refused={**known, **reasons})
    plan.report("writing", 0, 1)
    states = _boundary_parts(update, clips, library)
    generation.commit_library(writer, library, [clip.location for clip in clips], states, plan.rate)
    plan.report("writing", 1, 1)


def _sample_motions(update: _Update, result: _Ingested) -> Iterator[IngestedClip]:
    """Ingest some of the clips that were not refused, as motions; read only when they are used."""
    accepted, plan = {clip.order for clip in result.clips}, update.plan
    sample = spread_evenly([clip for clip in update.pending if clip.order in accepted])
    clips = ingest_all(sample, result.spec, plan.config, plan.executor, is_packed=False)
    return (clip for clip in clips if isinstance(clip, IngestedClip))


def _boundary_parts(
    update: _Update, clips: Sequence[_IndexedClip], library: LibraryData
) -> generation.BoundaryParts:
    """Return the boundary states of each group as consecutive parts, in the order of segments.

    They are read from the files of the writer for new clips, and from the previous generation for
    the others.
    """
    writer, base = update.writer, update.base
    counts = np.array([len(clip.segments) for clip in clips])
    firsts = [own.location.first_row if own.old_row is None else own.old_row for own in clips]
    rows = np.repeat(firsts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    is_new = np.repeat([clip.old_row is None for clip in clips], counts)

    def parts(group: str, key: str, joints: IntArray) -> Iterator[FloatArray]:
        for start in range(0, len(rows), CHUNK):
            chosen, new = rows[start : start + CHUNK], is_new[start : start + CHUNK]
            states = np.empty((len(chosen), len(joints), 3 if key.endswith("velocity") else 4))
            if new.any():
                states[new] = writer.read_boundary_states(key, chosen[new])[:, joints]
            if base is not None:
                states[~new] = base.boundary_states[group][key][chosen[~new]]
            yield states

    return {
        group: {state.name: parts(group, state.name, joints) for state in fields(BoundaryStates)}
        for group, joints in feature_joints_by_group(library.groups, library.skeleton).items()
    }
