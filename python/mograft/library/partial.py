"""Libraries of a few clips of a larger library, without features and clusters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from mograft.analysis.embedding import Samples
from mograft.body.groups import JointGroups
from mograft.body.mirroring import mirror
from mograft.config import Config
from mograft.io.addresses import read_clip
from mograft.library.build import join_segments
from mograft.library.clusters import cluster_groups, join_boundary_states
from mograft.library.data import LibraryData
from mograft.library.ingest import IngestedClip, IngestTask, boundary_states, ingest
from mograft.library.origin import ClipOrigin, LibraryOrigin, PartialClips
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion

L = TypeVar("L", bound=LibraryData)


@dataclass(frozen=True, kw_only=True)
class PartialClip:
    """A clip to read, by the file that holds it."""

    name: str  # in the library
    address: str
    rate_override: float | None  # frames per second, if the file gives a wrong rate
    is_mirrored: bool  # whether the clip is the mirror image of the clip in the file
    is_in_library: bool  # False for a base outside the library
    tags: tuple[str, ...]


def build_partial_library(
    library_type: type[L],
    clips: Sequence[PartialClip],
    groups: JointGroups,
    config: Config,
    origin: LibraryOrigin,
) -> L:
    """Return a library of some clips of a whole library, cut into the same segments.

    `origin` is the origin of the whole library. The segments are the same because those of a clip
    depend only on the clip, the configuration and the library specification. Every segment is a
    cluster by itself. Raise an error of `read_clip` if a file cannot be read, and ValueError if a
    clip does not fit.
    """
    spec = LibrarySpec(
        skeleton=origin.hierarchy or read_clip(clips[0].address, skeleton=origin.rest).skeleton,
        rate=origin.rate,
        root=origin.root,
        up=origin.up,
        match=origin.match,
        rest=origin.rest,
    )
    ingested = [_ingest(clip, config, spec) for clip in clips]
    entries = [
        own.info(clip.tags)._replace(name=clip.name)
        for clip, own in zip(clips, ingested, strict=True)
    ]
    segments = join_segments([(own.segments.start, own.segments.stop) for own in ingested])
    labels, sigma = cluster_groups(dict.fromkeys(groups.names), len(segments), config)
    rows = np.concatenate([own.samples for own in ingested])
    return library_type(
        clips=PartialClips(
            tuple(own.clip for own in ingested if isinstance(own.clip, Motion)),
            tuple(
                ClipOrigin(
                    source_file=own.source_file,
                    is_mirrored=clip.is_mirrored,
                    is_in_library=clip.is_in_library,
                )
                for clip, own in zip(clips, ingested, strict=True)
            ),
            origin,
        ),
        entries=tuple(entries),
        segments=segments,
        is_donor=np.concatenate([own.is_donor for own in ingested]),
        groups=groups,
        config=config,
        spec=spec,
        embedding=dict.fromkeys(groups.names),
        labels=labels,
        sigma=sigma,
        boundary_states=join_boundary_states(
            [own.boundary_states for own in ingested], groups, spec.skeleton
        ),
        samples=Samples(rows, config.samples, spec.skeleton.n_joints),
        refused={},
        folder=None,
    )


def _ingest(clip: PartialClip, config: Config, spec: LibrarySpec) -> IngestedClip:
    """Read a clip, and mirror it if required."""
    result = ingest(IngestTask(clip.address, clip.rate_override), spec, config, is_packed=False)
    if not isinstance(result, IngestedClip):
        raise result.error
    motion = result.clip
    assert isinstance(motion, Motion)
    if clip.is_mirrored:
        motion = mirror(motion)
        states = boundary_states(motion, result.segments)
        result = replace(result, boundary_states=states)
    return replace(result, clip=replace(motion, name=clip.name))
