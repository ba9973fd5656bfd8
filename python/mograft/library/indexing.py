"""Build a library in a folder, and add clips to it."""

import os
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain
from pathlib import Path

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.embedding import CHUNK
from mograft.body.groups import JointGroups
from mograft.errors import MograftError, join_names
from mograft.io.addresses import find_addresses, open_clips, split_address
from mograft.library.build import join_segments, name_clips
from mograft.library.clip_table import ClipInfo, ClipLocation
from mograft.library.clusters import cluster_groups, embed_groups, feature_joints_by_group
from mograft.library.data import LibraryData
from mograft.library.discover import (
    ClipSource,
    FoundClip,
    SourceFile,
    matching_values,
    relative_path,
)
from mograft.library.files.generation import GenerationWriter, write_generation
from mograft.library.files.loading import load_library
from mograft.library.files.saving import BoundaryParts, commit_library
from mograft.library.files.storage import StoredLibrary
from mograft.library.files.stored_clips import RowRange, StoredClips, merge_ranges
from mograft.library.group_choice import choose_groups, spread_evenly
from mograft.library.ingest import IngestedClip, IngestTask, ingest_all
from mograft.library.ingest_run import ClipOrder, IngestRun, PendingClip, warn_of_clips
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion
from mograft.search.boundary_states import BoundaryStates


@dataclass(frozen=True, eq=False)
class _IndexedClip:
    """A clip of the generation that is being written."""

    order: ClipOrder
    info: ClipInfo
    location: ClipLocation
    start: IntArray  # its segments, shape (n_segments,)
    stop: IntArray
    is_donor: BoolArray  # whether each segment may be a donor
    is_new: bool  # whether the clip was ingested for this generation
    first_row: int  # index of its first segment: of all new clips, or in the previous generation

    def __len__(self) -> int:
        return len(self.start)


class _ClipWriter:
    """Receiver of ingested clips, which writes them to a generation."""

    def __init__(self, writer: GenerationWriter, run: IngestRun) -> None:
        self.clips: list[_IndexedClip] = []
        self._writer, self._tags = writer, run.tags

    def append(self, ingested: tuple[PendingClip, IngestedClip], /) -> None:
        pending, clip = ingested
        location = self._writer.write_clip(clip)
        self.clips.append(
            _IndexedClip(
                order=pending.order,
                info=pending.updated_info(clip, self._tags),
                location=location,
                start=clip.segments.start,
                stop=clip.segments.stop,
                is_donor=clip.is_donor,
                is_new=True,
                first_row=location.first_row,
            )
        )

    def clear(self) -> None:
        self.clips.clear()
        self._writer.restart()


def index_folder(
    path: Path,
    sources: ClipSource | Iterable[ClipSource],
    groups: JointGroups | str,
    run: IngestRun,
    *,
    force: bool,
) -> None:
    """Build a library in a folder; see `Library.index`."""
    with write_generation(path, force=force) as writer:
        pending = _pending_files(run, sources, writer.final)
        receiver = _ClipWriter(writer, run)
        spec = run.ingest_and_choose_spec(pending, receiver)
        accepted = {clip.order for clip in receiver.clips}
        sample = spread_evenly([clip for clip in pending if clip.order in accepted])
        # Read only if groups are discovered.
        motions = ingest_all(
            (clip.task() for clip in sample), spec, run.config, run.executor, is_packed=False
        )
        again = (clip for clip in motions if isinstance(clip, IngestedClip))
        groups = choose_groups(groups, spec.skeleton, run.config, again)
        _complete(writer, run, spec, groups, receiver.clips, base=None)


def add_to_folder(path: Path, sources: ClipSource | Iterable[ClipSource], run: IngestRun) -> None:
    """Add clips to a library in a folder; see `Library.add`."""
    with write_generation(path, add=True) as writer:
        if writer.base is None:
            raise RuntimeError("the writer has no previous generation to add clips to")
        # Another process may have added clips since the library was opened.
        base = load_library(LibraryData, writer.base)
        files = {info.source_file.address: info for info in base.entries if info.source_file}
        run = replace(
            run,
            config=base.config,
            rate=writer.base.manifest["given_rate"],
            match=base.spec.match,
            skeleton=base.spec.rest,
        )
        pending = [
            clip
            for clip in _pending_files(run, sources, writer.final)
            if _is_new_or_changed(clip, files)
        ]
        if not pending and not run.tags:
            return
        stale = _stale_addresses(files, pending, run)
        kept = _kept_clips(base, writer.base, pending, run, stale)
        receiver = _ClipWriter(writer, run)
        spec, clips = _ingest_additions(writer, run, base, kept, pending, receiver)
        # Without new files, and unless all clips were ingested again, only tags have changed.
        is_same = not pending and not receiver.clips
        _complete(writer, run, spec, base.groups, clips, base=base, is_same=is_same)


def _pending_files(
    run: IngestRun, sources: ClipSource | Iterable[ClipSource], folder: Path
) -> list[PendingClip]:
    """Return the clips of files that `sources` stand for, each once, in the order of the library.

    Raise TypeError if a source is a motion.
    """
    by_path = {}
    for found in run.find_clips(sources):
        if isinstance(found.source, Motion):
            raise TypeError(
                "`sources` must be files, got a Motion; store motions by Library.build and save"
            )
        by_path[_path_key(found.source, folder)] = found
    return [run.pending(ClipOrder(0, path), by_path[path]) for path in sorted(by_path)]


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
    address = clip.task().source
    info = files.get(address) if isinstance(address, str) else None
    if info is None or info.source_file is None:
        return True
    if clip.rate_override is not None and clip.rate_override != info.rate_override:
        return True
    known = info.source_file
    try:
        status = os.stat(known.path)
        if (status.st_size, status.st_mtime_ns) == (known.size, known.mtime_ns):
            return False
        return SourceFile.from_path(known.path).sha256 != known.sha256
    except OSError:
        return True  # ingest will raise the error


def _stale_addresses(
    files: Mapping[str, ClipInfo], pending: Sequence[PendingClip], run: IngestRun
) -> frozenset[str]:
    """Return the addresses of the library's clips that are no longer valid.

    `files` holds the metadata of the library's clips by address. Warn about the clips that their
    changed files no longer contain. Do not warn about clips whose address has changed: the address
    of the only clip of a file has no name.
    """
    changed = {split_address(clip.task().label)[0] for clip in pending}
    known: dict[str, list[SourceFile]] = {}
    for info in files.values():
        if info.source_file is not None and info.source_file.path in changed:
            known.setdefault(info.source_file.path, []).append(info.source_file)
    stale: set[str] = set()
    for path, sources in known.items():
        try:
            found = set(find_addresses(path, skeleton=run.skeleton))
            names = {*open_clips(path, skeleton=run.skeleton).names}
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
    return frozenset(stale)


def _kept_clips(
    base: LibraryData,
    stored: StoredLibrary,
    pending: Sequence[PendingClip],
    run: IngestRun,
    stale: Collection[str],
) -> list[_IndexedClip]:
    """Return the clips of the previous generation that no pending clip replaces.

    Clips whose addresses are in `stale` are left out. The tags of the run whose keys match the
    address of a clip are added to its metadata.
    """
    replaced = {clip.order for clip in pending}
    indices = np.arange(len(base.entries) + 1)
    bounds = np.searchsorted(base.segments.clip, indices).tolist()
    kept = []
    clips = zip(base.entries, stored.table.locations, strict=True)
    for index, (info, location) in enumerate(clips):
        order = ClipOrder(1, (f"{index:09}",))
        if info.source_file is not None:
            address = info.source_file.address
            if address in stale:
                continue
            order = ClipOrder(0, _path_key(address, stored.folder))
            tags = dict.fromkeys(chain(info.tags, *matching_values(run.tags, FoundClip(address))))
            if len(tags) > len(info.tags):
                info = info._replace(tags=tuple(tags))
        if order in replaced:
            continue
        rows = slice(bounds[index], bounds[index + 1])
        kept.append(
            _IndexedClip(
                order=order,
                info=info,
                location=location,
                start=base.segments.start[rows],
                stop=base.segments.stop[rows],
                is_donor=base.is_donor[rows],
                is_new=False,
                first_row=rows.start,
            )
        )
    return kept


def _ingest_additions(
    writer: GenerationWriter,
    run: IngestRun,
    base: LibraryData,
    kept: Sequence[_IndexedClip],
    pending: Sequence[PendingClip],
    receiver: _ClipWriter,
) -> tuple[LibrarySpec, list[_IndexedClip]]:
    """Ingest pending clips; return the library specification, and the kept and the new clips.

    If the specification changes, or the files are fragmented, the kept clips are ingested again.
    """
    writer.link_base_shards()
    properties = [(clip.order, clip.info.properties(base.skeleton)) for clip in kept]
    tasks = map(PendingClip.task, pending)
    properties += [
        (order, clip)
        for order, clip in run.ingest_with_spec(pending, tasks, receiver, base.spec)
        # A changed file that no longer fits is left out, unless no clip would remain.
        if clip.skeleton.has_same_hierarchy(base.skeleton)
    ]
    # Clips matched by anatomy keep the specification: their properties are those of other joints.
    is_chosen = bool(properties) and run.match == "names"
    spec = run.choose_spec(properties) if is_chosen else base.spec
    if spec.is_equivalent(base.spec) and not writer.is_fragmented([c.location for c in kept]):
        run.raise_if_strict()
        return base.spec, [*kept, *receiver.clips]
    receiver.clear()
    again = [PendingClip(clip.order, None, clip.info.rate_override, clip.info) for clip in kept]
    all_tasks = chain(_stored_tasks(base, kept), map(PendingClip.task, pending))
    run.ingest_with_spec([*again, *pending], all_tasks, receiver, spec)
    run.raise_if_strict()
    return spec, receiver.clips


def _stored_tasks(base: LibraryData, kept: Sequence[_IndexedClip]) -> Iterator[IngestTask]:
    """Yield the tasks that ingest the `kept` clips again; a clip is read when its task is taken."""
    clips = base.clips
    if not isinstance(clips, StoredClips):
        raise TypeError("the library must be stored in a folder")
    index_of = {location: index for index, location in enumerate(clips.table.locations)}
    for clip in kept:
        motion = clips.original(index_of[clip.location], as_read=True)
        yield IngestTask(motion, clip.info.rate_override, clip.info.source_file)


def _complete(
    writer: GenerationWriter,
    run: IngestRun,
    spec: LibrarySpec,
    groups: JointGroups,
    clips: Sequence[_IndexedClip],
    *,
    base: LibraryData | None,
    is_same: bool = False,
) -> None:
    """Embed and cluster the segments of all clips, and commit the generation.

    If `is_same`, the segments are those of `base`, whose embeddings and clusters are used again.
    Raise ValueError if there is no clip.
    """
    if not clips:
        raise ValueError(f"no clip can be used: {next(iter(run.reasons().values()))}")
    clips = sorted(clips, key=lambda clip: clip.order)
    entries = name_clips([clip.info for clip in clips])
    segments = join_segments([(clip.start, clip.stop) for clip in clips])
    ranges = [RowRange(clip.location.shard, clip.location.first_row, len(clip)) for clip in clips]
    samples = writer.samples(ranges, run.config.samples, spec.skeleton.n_joints)
    warn_of_clips(entries, spec.rate, run.match_notes, stacklevel=4)
    if base is not None and is_same:
        embedding, labels, sigma = base.embedding, base.labels, base.sigma
    else:
        embedding = embed_groups(samples, groups, spec, run.config, run.report)
        run.report("clustering", 0, 1)
        labels, sigma = cluster_groups(embedding, len(segments), run.config)
        run.report("clustering", 1, 1)
    library = LibraryData(
        clips=(),
        entries=entries,
        segments=segments,
        is_donor=np.concatenate([clip.is_donor for clip in clips]),
        groups=groups,
        config=run.config,
        spec=spec,
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        boundary_states={},
        samples=samples,
        refused={**({} if base is None else base.refused), **run.reasons()},
        folder=None,
    )
    run.report("writing", 0, 1)
    states = _boundary_parts(writer, base, clips, library)
    commit_library(writer, library, [clip.location for clip in clips], states, run.rate)
    run.report("writing", 1, 1)


def _boundary_parts(
    writer: GenerationWriter,
    base: LibraryData | None,
    clips: Sequence[_IndexedClip],
    library: LibraryData,
) -> BoundaryParts:
    """Return the boundary states of each group as consecutive parts, in the order of segments.

    They are read from the files of `writer` for new clips, and from `base` for the others.
    """
    runs = merge_ranges(RowRange(int(clip.is_new), clip.first_row, len(clip)) for clip in clips)

    def parts(group: str, key: str, joints: IntArray) -> Iterator[FloatArray]:
        for is_new, first, n in runs:
            for start in range(first, first + n, CHUNK):
                stop = min(start + CHUNK, first + n)
                if is_new:
                    yield writer.read_boundary_states(key, start, stop)[:, joints]
                elif base is not None:
                    yield base.boundary_states[group][key][start:stop]

    return {
        group: {state.name: parts(group, state.name, joints) for state in fields(BoundaryStates)}
        for group, joints in feature_joints_by_group(library.groups, library.skeleton).items()
    }
