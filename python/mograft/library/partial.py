"""Libraries of a few clips of a larger library, without features and clusters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from mograft.body.groups import JointGroups
from mograft.body.mirroring import mirror
from mograft.config import Config
from mograft.io.addresses import read_clip
from mograft.library.build import assemble
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
    origins = tuple(
        ClipOrigin(
            source_file=own.source_file,
            is_mirrored=clip.is_mirrored,
            is_in_library=clip.is_in_library,
        )
        for clip, own in zip(clips, ingested, strict=True)
    )
    library = assemble(library_type, ingested, entries, groups, spec, config, None)
    return replace(library, clips=PartialClips(tuple(library.clips), origins, origin))


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
