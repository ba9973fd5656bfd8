"""The origin of a library and of its clips, and libraries that are read again from origins."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from mograft._util.containers import LazySequence
from mograft._util.documents import optional
from mograft.body.groups import JointGroups
from mograft.body.mirroring import MirroredClips, mirror
from mograft.config import Config
from mograft.errors import MograftError
from mograft.io.formats import join_address, read_clip
from mograft.library.build import assemble
from mograft.library.clip_table import skeleton_to_json
from mograft.library.data import LibraryData, has_same_poses
from mograft.library.derive import BUILD_STAGES
from mograft.library.discover import SourceFile
from mograft.library.files.stored_clips import ExtendedClips, StoredClips
from mograft.library.ingest import IngestedClip, PendingClip, boundary_states, ingest
from mograft.library.spec import LibrarySpec, Match
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

L = TypeVar("L", bound=LibraryData)


@dataclass(frozen=True, kw_only=True)
class LibraryOrigin:
    """How a library was made: its folder, the hash of its data, and its specification.

    A base that was appended to the library is not part of it.
    """

    folder: Path | None  # of a stored library
    sha256: str  # of `hash_library`
    n_clips: int  # without mirror images
    is_mirrored: bool  # whether mirror images were appended by `Library.with_mirror_images`
    rate: float  # frames per second
    root: int  # the joint that carries the body through the world
    up: int  # the axis that points up
    match: Match  # how clips of other hierarchies fit
    hierarchy: Skeleton | None  # of the library, if clips are matched by anatomy
    rest: Skeleton | None  # the rest pose of files that store none


@dataclass(frozen=True, kw_only=True)
class ClipOrigin:
    """Where a clip of a library comes from."""

    source_file: SourceFile | None  # None if no file is known that holds the clip
    is_mirrored: bool = False  # whether the clip is the mirror image of the clip in the file
    is_in_library: bool = True  # False for a base that was appended to the library


@dataclass(frozen=True, kw_only=True)
class ClipRecord:
    """A clip of which a graft is made."""

    name: str
    file: str | None  # relative to the folder of the document
    clip: str | None  # name in the file, if the file holds several clips
    sha256: str | None
    is_base: bool
    is_mirrored: bool
    is_in_library: bool
    true_rate: float | None  # frames per second, if the file gives a wrong rate
    licence: str | None

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Self:
        """Read an item of ``clips``, or the file of the motion of a `Character`."""
        texts = {key: optional(str, record[key]) for key in ("file", "clip", "sha256")}
        return cls(
            name=str(record["name"]),
            **texts,
            is_base="base" in record.get("roles", ()),
            is_mirrored=bool(record.get("is_mirrored")),
            is_in_library=bool(record.get("is_in_library")),
            true_rate=optional(float, record.get("true_rate")),
            licence=optional(str, record.get("licence")),
        )


@dataclass(frozen=True, eq=False)
class PartialClips(LazySequence[Motion]):
    """Some clips of a library, with the origins of these clips and of the library."""

    motions: Sequence[Motion]
    clips: Sequence[ClipRecord]
    library: LibraryOrigin

    def __len__(self) -> int:
        return len(self.motions)

    def item(self, index: int) -> Motion:
        """Return a clip."""
        return self.motions[index]


def _original_clips(library: LibraryData) -> tuple[Sequence[Motion], bool, bool]:
    """Return the clips from which a library was derived, and how it was derived.

    The other results state whether `with_mirror_images` and `with_clip` appended clips.
    """
    clips, is_extended = library.clips, isinstance(library.clips, ExtendedClips)
    if isinstance(clips, ExtendedClips):
        clips = clips.library_clips
    has_images = isinstance(clips, MirroredClips)
    return clips.clips if isinstance(clips, MirroredClips) else clips, has_images, is_extended


def is_partial(library: LibraryData) -> bool:
    """Return whether a library was built by `build_partial_library` and has only some clips."""
    return isinstance(library.clips, PartialClips)


def is_mirrored(library: LibraryData) -> bool:
    """Return whether `Library.with_mirror_images` appended the mirror images of the clips."""
    return _original_clips(library)[1]


def n_library_clips(library: LibraryData) -> int:
    """Return the number of clips of a library; an appended base motion is not counted."""
    return len(library.entries) - _original_clips(library)[2]


def find_library_origin(library: LibraryData) -> LibraryOrigin:
    """Return the origin of a library.

    For a library of `build_partial_library`, return the origin of the whole library.
    """
    if isinstance(library.clips, PartialClips):
        return library.clips.library
    clips, has_images, _ = _original_clips(library)
    return LibraryOrigin(
        folder=clips.folder if isinstance(clips, StoredClips) else None,
        sha256=hash_library(library),
        n_clips=len(clips),
        is_mirrored=has_images,
        rate=float(library.rate),
        root=int(library.root),
        up=int(library.up),
        match=library.spec.match,
        hierarchy=library.skeleton if library.spec.match == "anatomy" else None,
        rest=library.spec.rest,
    )


def hash_library(library: LibraryData) -> str:
    """Return the SHA-256 of the data that determine a library's segments, features and clips.

    These are the clips without mirror images and without an appended base, the joint groups, the
    specification and the fields of the configuration that are fixed when a library is built. A
    library has the same hash in memory and in a folder.
    """
    clips = []
    for index, info in enumerate(library.entries[: len(_original_clips(library)[0])]):
        file = info.source_file
        content = join_address(file.sha256, file.clip) if file else hash_poses(library.clips[index])
        clips.append([info.name, content, info.rate_override, info.n_frames])
    config, build_fields = library.config.as_dict(), library.config.fields_of(*BUILD_STAGES)
    document = {
        "clips": clips,
        "groups": library.groups.to_toml(),
        "rate": library.rate,
        "root": int(library.root),
        "up": int(library.up),
        "config": {name: config[name] for name in build_fields if name in config},
    }
    # Other libraries keep the hash that earlier versions computed.
    if library.spec.match != "names":
        document["hierarchy"] = skeleton_to_json(library.skeleton)
    if library.spec.rest is not None:
        document["rest"] = skeleton_to_json(library.spec.rest)
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def hash_poses(motion: Motion) -> str:
    """Return the SHA-256 of the frame time, rotations and positions of a motion."""
    digest = hashlib.sha256(np.float64(motion.frame_time).tobytes())
    for array in (motion.rotations, motion.positions):
        digest.update(np.ascontiguousarray(array, np.float64).data)
    return digest.hexdigest()


def find_clip_origin(library: LibraryData, clip: int) -> ClipOrigin:
    """Return the origin of a clip of a library."""
    if isinstance(library.clips, PartialClips):
        own, file = library.clips.clips[clip], library.entries[clip].source_file
        return ClipOrigin(
            source_file=file, is_mirrored=own.is_mirrored, is_in_library=own.is_in_library
        )
    clips, _, is_extended = _original_clips(library)
    is_base = is_extended and clip == len(library.entries) - 1
    index = clip if is_base else clip % len(clips)
    file = library.entries[index].source_file
    if file is None:
        file = find_source_file(library.clips[index], library.spec)
    return ClipOrigin(source_file=file, is_mirrored=index != clip, is_in_library=not is_base)


def find_source_file(motion: Motion, spec: LibrarySpec | None = None) -> SourceFile | None:
    """Return the file of a motion, or None if the file does not hold the poses of the motion.

    If `spec` is given, the clip in the file is first converted to this library specification.
    """
    if motion.path is None:
        return None
    try:
        source_file = SourceFile.from_path(os.path.abspath(motion.path), motion.clip)
        read = read_clip(source_file.address, skeleton=spec.rest if spec else None)
        read = spec.convert(read, str(motion.path)) if spec else read
    except (MograftError, OSError, ValueError):
        return None
    is_same = read.frame_time == motion.frame_time and has_same_poses(read, motion)
    return source_file if is_same else None


def build_partial_library(
    library_type: type[L],
    clips: Sequence[ClipRecord],
    addresses: Sequence[str],
    groups: JointGroups,
    config: Config,
    origin: LibraryOrigin,
) -> L:
    """Return a library of some clips of a whole library, cut into the same segments.

    `addresses` are those of the clips, `origin` is that of the whole library. The segments are the
    same because those of a clip depend only on the clip, the configuration and the library
    specification. Every segment is a cluster by itself. Raise an error of `read_clip` if a file
    cannot be read, and ValueError if a clip does not fit.
    """
    spec = LibrarySpec(
        skeleton=origin.hierarchy or read_clip(addresses[0], skeleton=origin.rest).skeleton,
        rate=origin.rate,
        root=origin.root,
        up=origin.up,
        match=origin.match,
        rest=origin.rest,
    )
    ingested = [_ingest(*own, config, spec) for own in zip(clips, addresses, strict=True)]
    entries = [own.info._replace(name=clip.name) for clip, own in zip(clips, ingested, strict=True)]
    library = assemble(library_type, ingested, entries, groups, spec, config)
    return replace(library, clips=PartialClips(library.clips, clips, origin))


def _ingest(clip: ClipRecord, address: str, config: Config, spec: LibrarySpec) -> IngestedClip:
    """Read a clip, and mirror it if required."""
    tags = () if clip.licence is None else (f"licence:{clip.licence}",)
    pending = PendingClip((0, ()), address, tags, clip.true_rate)
    result = ingest(pending, spec, config, is_packed=False)
    if not isinstance(result, IngestedClip):
        raise result.error
    if clip.is_mirrored:
        assert isinstance(result.clip, Motion)
        motion = mirror(result.clip)
        states = boundary_states(motion, result.segments)
        return replace(result, clip=motion, boundary_states=states)
    return result
