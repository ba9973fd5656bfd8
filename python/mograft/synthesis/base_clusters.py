"""`BaseClusters`: the clusters of base parts in a library, for a base segment outside of it."""

from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import features, normalise
from mograft.analysis.segmentation import Segments
from mograft.library.clusters import ClusterMembers
from mograft.library.library import Library
from mograft.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class BaseClusters:
    """The clusters of a library's base parts. Made by `BaseClusters.build`."""

    library: Library
    height: float  # stature of the base motion's skeleton
    members: ClusterMembers | None  # None if the base parts have no embedding

    @classmethod
    def build(cls, library: Library, height: float) -> "BaseClusters":
        """Return the clusters of a library for a base motion of the given stature."""
        base = library.groups.base
        labels, embedding = library.labels[base], library.embedding[base]
        if embedding is None:
            return cls(library, height, None)
        return cls(library, height, ClusterMembers.from_labels(labels, embedding.points))

    def find_members(self, motion: Motion, segment: Segments) -> tuple[IntArray, FloatArray]:
        """Find the cluster that a segment of another motion joins, as `Library.extended` does.

        `segment` is one segment in frames of `motion`, which may be an excerpt with the frames
        beside the segment. The first result is the cluster's segments, ascending, empty if no
        cluster fits; the second is their distances from the segment, in cluster diameters.
        """
        library = self.library
        base, config = library.groups.base, library.config
        embedding, sigma = library.embedding[base], library.sigma[base]
        if embedding is None or self.members is None:
            return np.zeros(0, np.int64), np.zeros(0)
        samples = normalise(
            [motion], segment, config, root=library.root, up=library.up, heights=[self.height]
        )
        samples = replace(samples, rows=samples.packed())
        point = embedding.project(
            features(samples, embedding.joints, embedding.reference, has_root=embedding.has_root)
        )
        members, distances = self.members.find_nearest_cluster(point[0], sigma)
        return members, distances / sigma if sigma > 0 else distances
