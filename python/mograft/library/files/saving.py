"""Write libraries to folders."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.library.clip_table import ClipInfo, ClipLocation, skeleton_to_json
from mograft.library.data import LibraryData
from mograft.library.files.generation import GenerationWriter, write_generation
from mograft.library.files.packing import pack
from mograft.library.files.storage import EMBEDDING_ARRAYS
from mograft.library.files.stored_clips import ExtendedClips, StoredClips
from mograft.library.ingest_run import check_storable
from mograft.motion.motion import Motion

BoundaryParts = Mapping[str, Mapping[str, FloatArray | Iterator[FloatArray]]]
"""Boundary states by group and key: arrays, or their parts in order."""


def save_library(library: LibraryData, path: Path, *, force: bool) -> None:
    """Write a library to a folder; see `Library.save`."""
    if isinstance(library.clips, ExtendedClips):
        raise ValueError("a library with an appended base motion cannot be saved")
    check_storable(library.config)
    with write_generation(path, force=force) as writer:
        entries: list[ClipInfo] = []
        locations: list[ClipLocation] = []
        first_rows = np.searchsorted(library.segments.clip, np.arange(len(library.entries)))
        for index, first_row in enumerate(first_rows.tolist()):
            info, clip = _saved_clip(library, index)
            entries.append(info)
            locations.append(writer.write_frames(pack(clip), first_row))
        for chunk in library.samples.chunks():
            writer.write_samples(chunk.pack())
        saved = replace(library, entries=tuple(entries))
        commit_library(writer, saved, locations, library.boundary_states, None)


def _saved_clip(library: LibraryData, index: int) -> tuple[ClipInfo, Motion]:
    """Return the metadata and the motion of a clip to save.

    A clip of a stored library is saved with the frames of its file, any other clip with the frames
    that it has in the library.
    """
    info = library.entries[index]
    if isinstance(library.clips, StoredClips):
        return info, library.clips.original(index, as_read=True)
    clip = library.clips[index]
    return info._replace(
        source_rate=clip.rate, rate_override=None, source_frames=clip.n_frames
    ), clip


def commit_library(
    writer: GenerationWriter,
    library: LibraryData,
    locations: Sequence[ClipLocation],
    boundary_states: BoundaryParts,
    requested_rate: float | None,
) -> None:
    """Write the files of a generation other than ``frames`` and ``samples``, and commit it.

    ``frames`` and ``samples`` must already be written, at `locations`. `boundary_states` holds the
    states of the feature joints; `library.boundary_states` and `library.clips` are ignored.
    `requested_rate` is the `rate` that the caller of `Library.index` gave; it is stored for clips
    that are added later.
    """
    segments = library.segments
    for name in ("start", "stop", "clip"):
        writer.write_array(f"{name}s", "<i8", getattr(segments, name))
    writer.write_array("donors", "|b1", library.is_donor)
    groups = {
        group: _write_group(writer, library, index, boundary_states[group])
        for index, group in enumerate(library.groups.names)
    }
    writer.write_clip_table(library, locations)
    writer.commit(
        {
            "config": library.config.as_dict(),
            "groups": library.groups.to_toml(),
            "group": groups,
            "skeleton": skeleton_to_json(library.skeleton),
            "rate": library.rate,
            "given_rate": requested_rate,
            "root": library.root,
            "up": library.up,
            "match": library.spec.match,
            "rest": None if library.spec.rest is None else skeleton_to_json(library.spec.rest),
            "clips": len(library.entries),
            "frames": sum(info.n_frames for info in library.entries),
            "segments": len(segments),
        }
    )


def _write_group(
    writer: GenerationWriter,
    library: LibraryData,
    index: int,
    states: Mapping[str, FloatArray | Iterator[FloatArray]],
) -> dict[str, Any]:
    """Write the arrays of the joint group with this index; return its entry in the manifest."""
    group = library.groups.names[index]
    embedding, labels = library.embedding[group], library.labels[group]
    writer.write_array(f"{index}/labels", "<i8", labels)
    for key, parts in states.items():
        writer.write_array(f"{index}/{key}", "<f8", parts)
    if embedding is not None:
        writer.write_array(f"{index}/joints", "<i8", embedding.joints)
        for name in EMBEDDING_ARRAYS:
            writer.write_array(f"{index}/{name}", "<f8", getattr(embedding, name))
    return {
        "folder": str(index),
        "sigma": library.sigma[group],
        "compared": embedding is not None,
        "has_root": embedding is not None and embedding.has_root,
        "clusters": int(labels.max(initial=-1)) + 1,
    }
