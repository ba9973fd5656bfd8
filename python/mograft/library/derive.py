"""Libraries derived from a library: with other clusters, mirror images, or one more clip."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from mograft.analysis.channel_groups import samples_alone
from mograft.analysis.embedding import Embedding, Samples, features, normalise
from mograft.analysis.segmentation import Segments, segment
from mograft.body.mass import mass_model
from mograft.body.mirroring import MirroredClips
from mograft.config import Config
from mograft.library.clip_table import ClipInfo
from mograft.library.clusters import (
    cluster_groups,
    embed_groups,
    feature_joints_by_group,
    nearest_clusters,
)
from mograft.library.data import LibraryData
from mograft.library.discover import unique_names
from mograft.library.ingest import boundary_states
from mograft.library.spec import ClipProperties, rates_match
from mograft.library.stored_clips import ExtendedClips
from mograft.motion.motion import Motion

__all__ = ["append_clip", "append_mirror_images", "relabel"]

L = TypeVar("L", bound=LibraryData)

_BUILD_FIELDS = (
    "smoothing",
    "min_length",
    "max_length",
    "omega",
    "inertia",
    "samples",
    "components",
    "keep_heading",
    "rotation_floor",
    "position_floor",
    "length_floor",
)
"""Fields of `Config` on which segments and embeddings depend."""


def relabel(library: L, config: Config) -> L:
    """Cluster a library again; see `Library.relabelled`."""
    for name in _BUILD_FIELDS:
        if getattr(config, name) != getattr(library.config, name):
            raise ValueError(
                f"{name} must be {getattr(library.config, name)!r}, the value with which the "
                f"library was built; got {getattr(config, name)!r}"
            )
    current = library.config
    if (config.sigma, config.sigma_scale) == (current.sigma, current.sigma_scale):
        return replace(library, config=config)
    labels, sigma = cluster_groups(library.embedding, len(library.segments), config)
    return replace(library, config=config, labels=labels, sigma=sigma)


def append_mirror_images(library: L) -> L:
    """Append the mirror images of all clips; see `Library.mirrored`."""
    n = len(library.entries)
    names = [info.name for info in library.entries]
    names = unique_names([*names, *(f"{name}_mirrored" for name in names)])
    clips = MirroredClips(library.clips, tuple(names))
    rows, states = [chunk.packed() for chunk in library.samples.chunks()], []
    for index in range(n):
        image, segments = clips[n + index], library.segments.of_clip(index)
        cut = Segments(library.segments.start[segments], library.segments.stop[segments])
        rows.append(_sample(library, image, cut).packed())
        states.append(boundary_states(image, cut))
    samples = Samples(np.concatenate(rows), library.config.samples, library.skeleton.n_joints)
    embedding = embed_groups(samples, library.groups, library.spec, library.config, _ignore)
    labels, sigma = cluster_groups(embedding, 2 * len(library.segments), library.config)
    images = replace(library.segments, clip=library.segments.clip + n)
    infos = zip(library.entries + library.entries, names, strict=True)
    return replace(
        library,
        clips=clips,
        entries=tuple(replace(info, name=name) for info, name in infos),
        segments=_concatenate([library.segments, images]),
        is_donor=np.concatenate([library.is_donor, library.is_donor]),
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        boundary_states={
            group: {
                key: np.concatenate([known, *(state[key][:, joints] for state in states)])
                for key, known in library.boundary_states[group].items()
            }
            for group, joints in feature_joints_by_group(library.groups, library.skeleton).items()
        },
        samples=samples,
        folder=None,
    )


def append_clip(library: L, motion: Motion) -> L:
    """Append a clip whose segments are excluded as donors; see `Library.with_clip`."""
    name = motion.name or "the base"
    library.skeleton.check_same_hierarchy(motion.skeleton, name)
    if not rates_match(motion.rate, library.rate):
        warnings.warn(
            f"{name} is resampled from {motion.rate:.6g} to {library.rate:.6g} fps, the rate of "
            "the library",
            stacklevel=3,
        )
        motion = motion.resample(library.rate)
    segments = segment(motion, library.config)
    samples = _sample(library, motion, segments)
    samples = replace(samples, rows=samples.packed())
    states = boundary_states(motion, segments)
    held = library.groups.divided_channels(library.skeleton)
    embedding = {
        group: None
        if known is None
        else _project(known, samples_alone(samples, library.skeleton, held[group]))
        for group, known in library.embedding.items()
    }
    n, sigma = len(segments), library.sigma
    labels = {
        group: np.concatenate([known, nearest_clusters(embedding[group], known, n, sigma[group])])
        for group, known in library.labels.items()
    }
    appended = replace(segments, clip=np.full(n, len(library.entries)))
    return replace(
        library,
        clips=ExtendedClips(library.clips, motion),
        entries=(*library.entries, _clip_info(motion)),
        segments=_concatenate([library.segments, appended]),
        is_donor=np.concatenate([library.is_donor, np.zeros(n, bool)]),
        embedding=embedding,
        labels=labels,
        boundary_states={
            group: {
                key: np.concatenate([known, states[key][:, joints]])
                for key, known in library.boundary_states[group].items()
            }
            for group, joints in feature_joints_by_group(library.groups, library.skeleton).items()
        },
    )


def _clip_info(motion: Motion) -> ClipInfo:
    properties = ClipProperties.from_motion(motion)
    return ClipInfo(
        name=motion.name,
        source_name=motion.name,
        source_file=None,
        source_rate=properties.rate,
        rate_override=None,
        source_frames=properties.n_frames,
        n_frames=properties.n_frames,
        root=properties.root,
        up=properties.up,
        faults=(),
        tags=(),
    )


def _sample(library: LibraryData, motion: Motion, segments: Segments) -> Samples:
    """Return samples of a motion's segments, not yet in single precision."""
    return normalise(
        [motion],
        segments,
        library.config,
        root=library.root,
        up=library.up,
        heights=[mass_model(motion.skeleton).height],
    )


def _project(embedding: Embedding, samples: Samples) -> Embedding:
    """Return an embedding with new segments projected into it, behind the others."""
    matrix = features(samples, embedding.joints, embedding.reference, has_root=embedding.has_root)
    return replace(embedding, points=np.concatenate([embedding.points, embedding.project(matrix)]))


def _concatenate(parts: Sequence[Segments]) -> Segments:
    return Segments(
        start=np.concatenate([part.start for part in parts]),
        stop=np.concatenate([part.stop for part in parts]),
        clip=np.concatenate([part.clip for part in parts]),
    )


def _ignore(stage: str, done: int, total: int) -> None:
    pass
