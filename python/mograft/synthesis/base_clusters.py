"""`BaseClusters`: the clusters of base parts in a library, for a base segment outside of it."""

from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import features, normalise
from mograft.analysis.segmentation import Segments
from mograft.library.clusters import ClusterMembers
from mograft.library.library import Library
from mograft.motion.motion import Motion

__all__ = ["BaseClusters"]


@dataclass(frozen=True, eq=False)
class BaseClusters:
    """The clusters of a library's base parts. Made by `BaseClusters.build`.

    Attributes
    ----------
    library : Library
        The library.
    height : float
        Stature of the base motion's skeleton.
    members : ClusterMembers or None
        The segments sorted by cluster; None if the base parts have no embedding.
    """

    library: Library
    height: float
    members: ClusterMembers | None

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

        Parameters
        ----------
        motion : Motion
            The motion, or an excerpt of it with the frames beside the segment.
        segment : Segments
            One segment in frames of `motion`.

        Returns
        -------
        members : ndarray of int, shape (n,)
            The cluster's segments, ascending; empty if no cluster fits.
        distances : ndarray, shape (n,)
            Their distances from the segment, in cluster diameters.
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
