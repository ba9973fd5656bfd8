"""`BaseClusters`: the clusters of base parts in a library, for a base segment outside of it."""

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Samples, features, normalise
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.search.neighbourhoods import NEIGHBOURHOODS, ClusterMembers


class BaseClusters:
    """The clusters of a library's base group, with which segments outside the library are compared.

    `height` is the skeleton height of the base motion, in the file's unit.
    """

    def __init__(self, library: Library, height: float) -> None:
        base = library.groups.base
        self._library, self._heights = library, [height]
        self._embedding, self._sigma = library.embedding[base], library.sigma[base]
        if self._embedding is not None:
            points = self._embedding.points
            self._members = ClusterMembers.from_labels(library.labels[base], points)

    def sample(self, motion: Motion, segment: Segments) -> Samples:
        """Return the samples of a segment of another motion, as the library's own.

        `segment` is one segment in frames of `motion`, which may be just the segment and a few
        frames on both sides.
        """
        return normalise(
            [motion],
            segment,
            self._library.config,
            root=self._library.root,
            up=self._library.up,
            heights=self._heights,
            is_packed=True,
        )

    def find_members(self, samples: Samples, reach: float) -> tuple[IntArray, FloatArray]:
        """Find the library's segments in the neighbourhood of a segment, given by its samples.

        The first result has the neighbours, ascending: the members of the cluster that the segment
        would join in `Library.with_clip` if `Config.neighbourhood` is "cluster", the segments in a
        ball around the segment if it is "ball". The second result has the distances of the
        neighbours, divided by the cluster diameter threshold.
        """
        library, embedding, sigma = self._library, self._embedding, self._sigma
        if embedding is None:
            return np.zeros(0, np.int64), np.zeros(0)
        point = embedding.project(
            features(samples, embedding.joints, embedding.reference, has_root=embedding.has_root)
        )
        neighbourhood = NEIGHBOURHOODS[library.config.neighbourhood]
        members, distances = neighbourhood.find_near(self._members, point[0], reach * sigma)
        return members, distances / sigma if sigma > 0 else distances
