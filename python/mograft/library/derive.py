"""Libraries derived from a library: with other clusters, mirror images, or one more clip."""

import warnings
from contextlib import suppress
from dataclasses import replace
from typing import Self

import numpy as np

from mograft._util.names import find_matches, unique_names
from mograft._util.validate import check_type
from mograft.analysis.channel_groups import restrict_samples
from mograft.analysis.embedding import Embedding, Samples, features
from mograft.analysis.segmentation import segment_clip
from mograft.config import Config
from mograft.errors import SkeletonMismatchError, join_names, suggest_name, suggest_path
from mograft.library import clusters
from mograft.library.clip_table import ClipInfo
from mograft.library.data import LibraryData
from mograft.library.files.stored_clips import ExtendedClips, JoinedSamples
from mograft.library.spec import rates_match
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments

BUILD_STAGES = ("segmentation", "embedding")
"""Stages that run only when a library is built: their fields of `Config` cannot change later."""


class DerivableLibrary(LibraryData):
    """A library from which other libraries are derived; base class of `mograft.Library`."""

    def relabelled(self, config: Config) -> Self:
        """Return the library with another configuration, and with its segments clustered anew.

        Parameters
        ----------
        config : Config
            The configuration. Options of segmentation and embedding must be those with which
            the library was built.

        Returns
        -------
        Library
            A library with the clusters for the `sigma` and `sigma_scale` of `config`.

        Raises
        ------
        ValueError
            If an option of segmentation or embedding differs; the message names it.
        """
        changed = config.changed_fields(self.config)
        for name in [name for stage in BUILD_STAGES for name in changed.get(stage, ())]:
            raise ValueError(
                f"`{name}` must be {getattr(self.config, name)!r}, the value with which the "
                f"library was built; got {getattr(config, name)!r}"
            )
        relabelled = replace(self, config=config)
        if "neighbourhood" in changed:
            labels, sigma = clusters.cluster_groups(self.embedding, len(self.segments), config)
            relabelled = replace(relabelled, labels=labels, sigma=sigma)
        if self.has_recipe:
            relabelled.set_recipe(type(self).relabelled, self, config)
        return relabelled

    def with_mirror_images(self) -> Self:
        """Return the library with the mirror images of all clips appended.

        This doubles the number of donors. All segments are clustered again.

        Returns
        -------
        Library
            A library in memory. Mirror images have the names of their clips followed by
            ``_mirrored``.

        Raises
        ------
        ValueError
            If the joints of the left and of the right side do not correspond; see `mograft.mirror`.
        """
        # Opening a library must not import the readers of files.
        from mograft.body.mirroring import MirroredClips
        from mograft.library.ingest import boundary_states, sample_segments

        n = len(self.entries)
        names = unique_names([*self.names, *(f"{name}_mirrored" for name in self.names)])
        clips = MirroredClips(self.clips, tuple(names))
        rows, states = [chunk.pack() for chunk in self.samples.chunks()], []
        for index in range(n):
            image, segments = clips[n + index], self.segments.of_clip(index)
            cut = Segments(self.segments.start[segments], self.segments.stop[segments])
            rows.append(sample_segments(image, cut, self.spec, self.config).pack())
            states.append(boundary_states(image, cut))
        samples = Samples(np.concatenate(rows), self.config.samples, self.skeleton.n_joints)
        images = replace(self.segments, clip=self.segments.clip + n)
        infos = zip(self.entries + self.entries, names, strict=True)
        library = replace(
            self,
            clips=clips,
            entries=tuple(info._replace(name=name) for info, name in infos),
            segments=Segments.concatenate([self.segments, images]),
            is_donor=np.concatenate([self.is_donor, self.is_donor]),
            boundary_states=clusters.join_boundary_states(
                states, self.groups, self.skeleton, self.boundary_states
            ),
            samples=samples,
            folder=None,
        )
        return clusters.compare(library, lambda *_: None)

    def resolve_base(self, base: Motion | str | None) -> tuple[Self, int]:
        """Return the library with a base motion among its clips, and the index of the clip.

        Parameters
        ----------
        base : Motion or str, optional
            A motion, or the name of a clip. Default: the first clip.

        Returns
        -------
        library
            This library if the base motion is one of its clips, else the result of `with_clip`.
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
            names = list(self.names)
            found = list[int]()
            with suppress(ValueError):
                found = find_matches("base", base, names)
            if len(found) != 1:
                hint = suggest_name(base, names) or suggest_path(base)
                raise ValueError(
                    f"`base` must be a clip, one of {join_names(names)}; got {base!r}{hint}"
                )
            return self, found[0]
        check_type("base", base, Motion)
        base = self._fit_base(base)
        index = self.find_clip(base)
        return (self.with_clip(base), len(self.entries)) if index is None else (self, index)

    def _fit_base(self, base: Motion) -> Motion:
        """Return a base motion with the hierarchy of the clips.

        Raises SkeletonMismatchError if it has another one; see `LibrarySpec.fit`.
        """
        try:
            return self.spec.fit(base, base.name or "the base")
        except SkeletonMismatchError as error:
            raise SkeletonMismatchError(
                f"{error}, unlike {join_names(self.names, 3)} in the library; the base must have "
                "the hierarchy of the clips, unless joints are matched by anatomy (--match anatomy)"
            ) from None

    def with_clip(self, motion: Motion) -> Self:
        """Return the library with one more clip, whose segments are excluded as donors.

        Each new segment joins the cluster whose members are all within the cluster diameter
        threshold of the segment; of several such clusters, the one with the nearest member. If
        there is none, the segment forms a new cluster. The points and clusters of other segments
        do not change.

        Parameters
        ----------
        motion : Motion
            A motion of the library's hierarchy. It is resampled, with a warning, if its frame
            rate differs from the library's.

        Returns
        -------
        Library
            A library whose last clip is the motion.

        Raises
        ------
        SkeletonMismatchError
            If the hierarchy differs.
        """
        motion = self._fit_base(motion)
        name, own_rate = motion.name or "the base", motion.rate
        if not rates_match(motion.rate, self.rate):
            warnings.warn(
                f"{name} is resampled from {motion.rate:.6g} to {self.rate:.6g} fps, the rate of "
                "the library",
                stacklevel=2,
            )
            motion = motion.resample(self.rate)
        return self._append_clip(motion, own_rate)

    def _append_clip(self, motion: Motion, own_rate: float) -> Self:
        """Return the library with one more clip, which has the library's hierarchy and rate.

        `own_rate` is the clip's rate before it was resampled, in frames per second.
        """
        from mograft.library.ingest import boundary_states, sample_segments

        segments = segment_clip(motion, self.config, own_rate)
        samples = sample_segments(motion, segments, self.spec, self.config)
        states = [boundary_states(motion, segments)]
        held = self.groups.divided_channels(self.skeleton)
        embedding: dict[str, Embedding | None] = dict.fromkeys(self.embedding)
        for group, own in self.embedding.items():
            if own is not None:
                part = restrict_samples(samples, self.skeleton, held[group])
                matrix = features(part, own.joints, own.reference, has_root=own.has_root)
                points = np.concatenate([own.points, own.project(matrix)])
                embedding[group] = replace(own, points=points)
        n, labels = len(segments), {}
        for group, known in self.labels.items():
            new = clusters.nearest_clusters(embedding[group], known, n, self.sigma[group])
            labels[group] = np.concatenate([known, new])
        appended = replace(segments, clip=np.full(n, len(self.entries)))
        extended = replace(
            self,
            clips=ExtendedClips(self.clips, motion),
            entries=(*self.entries, ClipInfo.from_motion(motion)),
            segments=Segments.concatenate([self.segments, appended]),
            is_donor=np.concatenate([self.is_donor, np.zeros(n, bool)]),
            samples=JoinedSamples.append(self.samples, samples),
            embedding=embedding,
            labels=labels,
            boundary_states=clusters.join_boundary_states(
                states, self.groups, self.skeleton, self.boundary_states
            ),
        )
        if self.has_recipe:
            extended.set_recipe(type(self)._append_clip, self, motion, own_rate)
        return extended
