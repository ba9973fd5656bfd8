"""Build a library in memory."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.names import unique_names
from mograft.analysis.embedding import Samples
from mograft.body.groups import JointGroups
from mograft.library.clip_table import ClipInfo
from mograft.library.clusters import cluster_groups, embed_groups, join_boundary_states
from mograft.library.data import LibraryData
from mograft.library.discover import ClipSource
from mograft.library.group_choice import choose_groups, spread_evenly
from mograft.library.ingest import IngestedClip
from mograft.library.ingest_run import ClipOrder, IngestRun, PendingClip, warn_of_clips
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments

L = TypeVar("L", bound=LibraryData)


def build_library(
    library_type: type[L],
    sources: ClipSource | Iterable[ClipSource],
    groups: JointGroups | str,
    run: IngestRun,
) -> L:
    """Build a library in memory; see `Library.build`."""
    found = run.find_clips(sources)
    pending = [run.pending(ClipOrder(index), clip) for index, clip in enumerate(found)]
    ingested: list[tuple[PendingClip, IngestedClip]] = []
    spec = run.ingest_and_choose_spec(pending, ingested)
    clips = [clip for _, clip in ingested]
    skeleton, config = spec.skeleton, run.config
    groups = choose_groups(groups, skeleton, config, spread_evenly(clips))
    entries = name_clips([source.updated_info(clip, run.tags) for source, clip in ingested])
    warn_of_clips(entries, spec.rate, run.match_notes, stacklevel=3)
    segments = join_segments([(clip.segments.start, clip.segments.stop) for clip in clips])
    rows = np.concatenate([clip.samples for clip in clips])
    samples = Samples(rows, config.samples, skeleton.n_joints)
    embedding = embed_groups(samples, groups, spec, config, run.report)
    labels, sigma = cluster_groups(embedding, len(segments), config)
    return library_type(
        clips=_named_motions(clips, entries),
        entries=entries,
        segments=segments,
        is_donor=np.concatenate([clip.is_donor for clip in clips]),
        groups=groups,
        config=config,
        spec=spec,
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        boundary_states=join_boundary_states(
            [clip.boundary_states for clip in clips], groups, skeleton
        ),
        samples=samples,
        refused={},
        folder=None,
    )


def name_clips(entries: Sequence[ClipInfo]) -> tuple[ClipInfo, ...]:
    """Return metadata of clips with unique names, which are made from the names in the sources."""
    names = unique_names([info.source_name for info in entries])
    return tuple(
        info if info.name == name else info._replace(name=name)
        for info, name in zip(entries, names, strict=True)
    )


def _named_motions(
    clips: Sequence[IngestedClip], entries: Sequence[ClipInfo]
) -> tuple[Motion, ...]:
    """Return the motions of ingested clips, renamed to their unique names in the library."""
    return tuple(
        clip.clip if clip.clip.name == info.name else replace(clip.clip, name=info.name)
        for clip, info in zip(clips, entries, strict=True)
        if isinstance(clip.clip, Motion)
    )


def join_segments(ends: Sequence[tuple[IntArray, IntArray]]) -> Segments:
    """Return the segments of several clips; `ends` holds the starts and the stops of each clip."""
    clip: IntArray = np.repeat(np.arange(len(ends)), [len(start) for start, _ in ends])
    starts, stops = zip(*ends, strict=True)
    return Segments(np.concatenate(starts), np.concatenate(stops), clip)
