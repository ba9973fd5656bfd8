"""Build a library in memory."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.names import unique_names
from mograft.analysis.embedding import Embedding, Samples
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.library.clip_table import ClipInfo
from mograft.library.clusters import (
    Progress,
    cluster_groups,
    compare_segments,
    join_boundary_states,
)
from mograft.library.data import LibraryData
from mograft.library.discover import ClipSource
from mograft.library.group_choice import choose_groups, spread_evenly
from mograft.library.ingest import ClipOrder, IngestedClip
from mograft.library.ingest_run import ingest_fitting, warn_of_clips
from mograft.library.plan import IngestPlan
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments

L = TypeVar("L", bound=LibraryData)


def build_library(
    library_type: type[L], sources: ClipSource | Iterable[ClipSource], plan: IngestPlan
) -> L:
    """Build a library in memory; see `Library.build`."""
    found = enumerate(plan.find_clips(sources))
    pending = [plan.pending(ClipOrder(index), clip) for index, clip in found]
    result = ingest_fitting(pending, plan, lambda own, clip: (own.info(clip), clip), lambda: None)
    clips = [clip for _, clip in result.clips]
    groups = choose_groups(plan, result.spec.skeleton, spread_evenly(clips))
    entries = name_clips([info for info, _ in result.clips])
    warn_of_clips(entries, result.spec.rate, result.match_notes, stacklevel=3)
    return assemble(library_type, clips, entries, groups, result.spec, plan.config, plan.report)


def assemble(
    library_type: type[L],
    clips: Sequence[IngestedClip],
    entries: Sequence[ClipInfo],
    groups: JointGroups,
    spec: LibrarySpec,
    config: Config,
    report: Progress | None,
) -> L:
    """Return a library of ingested clips that hold motions, with the metadata `entries`.

    If `report` is None, the segments are not compared: each forms a cluster by itself.
    """
    rows = np.concatenate([clip.samples for clip in clips])
    samples = Samples(rows, config.samples, spec.skeleton.n_joints)
    if report is None:
        embedding: dict[str, Embedding | None] = dict.fromkeys(groups.names)
        labels, sigma = cluster_groups(embedding, len(samples), config)
    else:
        embedding, labels, sigma = compare_segments(samples, groups, spec, config, report)
    return library_type(
        clips=_named_motions(clips, entries),
        entries=tuple(entries),
        segments=join_segments([(clip.segments.start, clip.segments.stop) for clip in clips]),
        is_donor=np.concatenate([clip.is_donor for clip in clips]),
        groups=groups,
        config=config,
        spec=spec,
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        boundary_states=join_boundary_states(
            [clip.boundary_states for clip in clips], groups, spec.skeleton
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
