"""Libraries derived from a library: with other clusters, mirror images, or one more clip."""

import warnings
from dataclasses import replace
from typing import Self, TypeVar

import numpy as np

from mograft._util.validate import check_type
from mograft.analysis.channel_groups import restrict_samples
from mograft.analysis.embedding import Embedding, Samples, features, normalise
from mograft.analysis.segmentation import Segments, segment
from mograft.body.mass import mass_model
from mograft.body.mirroring import MirroredClips
from mograft.config import Config
from mograft.errors import join_names
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

__all__ = ["DerivableLibrary"]

L = TypeVar("L", bound=LibraryData)


class DerivableLibrary(LibraryData):
    """A library from which other libraries are derived; base class of `mograft.Library`."""

    def relabelled(self, config: Config) -> Self:
        """Return the library clustered with, and with the options of, another configuration.

        Parameters
        ----------
        config : Config
            The configuration. Options of segmentation and embedding must be those with which
            the library was built.

        Returns
        -------
        Library
            With labels for the configuration's `sigma` and `sigma_scale`.

        Raises
        ------
        ValueError
            If an option of segmentation or embedding differs; the message names it.
        """
        return _relabel(self, config)

    def mirrored(self) -> Self:
        """Return the library with the mirror images of all clips appended, clustered again.

        This doubles the number of donors.

        Returns
        -------
        Library
            In memory. A mirror image has the name of its clip and ``_mirrored``.

        Raises
        ------
        ValueError
            If the skeleton's joints have no partners; see `mograft.mirror`.
        """
        return _append_mirror_images(self)

    def resolve_base(self, base: Motion | str | None) -> tuple[Self, int]:
        """Return the library with a base motion among its clips, and the index of the clip.

        Parameters
        ----------
        base : Motion or str, optional
            A motion, or the name of a clip. Default: the first clip.

        Returns
        -------
        library
            This library if the motion is one of its clips, else the result of `extended`.
        index : int
            The index of the clip.

        Raises
        ------
        SkeletonMismatchError
            If the motion's hierarchy differs.
        ValueError
            If no clip has the name.
        """
        if base is None:
            return self, 0
        if isinstance(base, str):
            names = [info.name for info in self.entries]
            if base not in names:
                raise ValueError(f"`base` must be a clip, one of {join_names(names)}; got {base!r}")
            return self, names.index(base)
        check_type("base", base, Motion)
        self.skeleton.check_same_hierarchy(base.skeleton, base.name or "the base")
        index = self.find_clip(base)
        return (self.extended(base), len(self.entries)) if index is None else (self, index)

    def extended(self, motion: Motion) -> Self:
        """Return the library with one more clip, whose segments are excluded as donors.

        Each new segment joins the cluster whose members are all within the cluster diameter
        threshold of it; of several clusters, the one with the nearest member. If there is none,
        the segment forms a cluster by itself. Other segments, embeddings and clusters
        do not change.

        Parameters
        ----------
        motion : Motion
            A motion of the library's hierarchy. It is resampled, with a warning, if its frame
            rate differs from the library's.

        Returns
        -------
        Library
            The last clip is the motion.

        Raises
        ------
        SkeletonMismatchError
            If the hierarchy differs.
        """
        return _append_clip(self, motion)


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


def _relabel(library: L, config: Config) -> L:
    """Cluster a library again."""
    for name in _BUILD_FIELDS:
        if getattr(config, name) != getattr(library.config, name):
            raise ValueError(
                f"`{name}` must be {getattr(library.config, name)!r}, the value with which the "
                f"library was built; got {getattr(config, name)!r}"
            )
    current = library.config
    if (config.sigma, config.sigma_scale) == (current.sigma, current.sigma_scale):
        return replace(library, config=config)
    labels, sigma = cluster_groups(library.embedding, len(library.segments), config)
    return replace(library, config=config, labels=labels, sigma=sigma)


def _append_mirror_images(library: L) -> L:
    """Append the mirror images of all clips."""
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
        segments=Segments.concatenate([library.segments, images]),
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


def _append_clip(library: L, motion: Motion) -> L:
    """Append a clip whose segments are excluded as donors."""
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
        else _project(known, restrict_samples(samples, library.skeleton, held[group]))
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
        segments=Segments.concatenate([library.segments, appended]),
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


def _ignore(stage: str, done: int, total: int) -> None:
    pass
