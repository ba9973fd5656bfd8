"""Embed and cluster the segments of a library, group by group."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.channel_groups import RestrictedSamples
from mograft.analysis.clustering import cut, threshold
from mograft.analysis.embedding import Embedding, Source, embed, means_of
from mograft.body.anatomy import feature_joints
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.library.spec import LibrarySpec
from mograft.motion.skeleton import Skeleton

__all__ = [
    "ClusterMembers",
    "Progress",
    "cluster_groups",
    "embed_groups",
    "feature_joints_by_group",
    "nearest_clusters",
]

Progress = Callable[[str, int, int], None]


def feature_joints_by_group(groups: JointGroups, skeleton: Skeleton) -> dict[str, IntArray]:
    """Return the joints of each group whose rotations are compared."""
    members = groups.resolve(skeleton)
    return {name: feature_joints(skeleton, joints) for name, joints in members.items()}


def embed_groups(
    samples: Source, groups: JointGroups, spec: LibrarySpec, config: Config, report: Progress
) -> dict[str, Embedding | None]:
    """Embed the segments for each group.

    Parameters
    ----------
    samples : Source
        The samples of all segments.
    groups : JointGroups
        The joint groups.
    spec : LibrarySpec
        The library specification.
    config : Config
        The configuration.
    report : callable
        Called with "comparing", the number of groups that are embedded, and of all groups.

    Returns
    -------
    dict of str to Embedding or None
        None for a group that `embed` cannot embed.

    Raises
    ------
    ValueError
        If a group holds single channels of the root.
    """
    skeleton, root = spec.skeleton, spec.root
    members, held = groups.resolve(skeleton), groups.divided_channels(skeleton)
    report("comparing", 0, len(members))
    means = means_of(samples, skeleton.n_joints)
    embeddings: dict[str, Embedding | None] = {}
    for name, joints in members.items():
        compared = feature_joints(skeleton, joints)
        if root in joints:
            compared = np.union1d(compared, [root])
        if root in held[name]:
            raise ValueError(
                f"group {name!r}: {skeleton.names[root]} carries the body, so its channels must "
                "all be in one group"
            )
        group_samples, group_means = samples, means
        if held[name]:
            group_samples = RestrictedSamples(samples, skeleton, held[name])
            group_means = means_of(group_samples, skeleton.n_joints)
        embeddings[name] = embed(
            group_samples, compared, group_means, config, root=root, group=name
        )
        report("comparing", len(embeddings), len(members))
    return embeddings


def cluster_groups(
    embedding: Mapping[str, Embedding | None], n_segments: int, config: Config
) -> tuple[dict[str, IntArray], dict[str, float]]:
    """Cluster the segments for each group.

    Returns
    -------
    labels : dict of str to ndarray of int, shape (n_segments,)
        The cluster of each segment. Without an embedding each segment is a cluster.
    sigma : dict of str to float
        The cluster diameter threshold of each group; 0 without an embedding.
    """
    labels: dict[str, IntArray] = {}
    sigma: dict[str, float] = {}
    for group, embedded in embedding.items():
        if embedded is None:
            labels[group], sigma[group] = np.arange(n_segments), 0.0
        else:
            sigma[group] = threshold(embedded.points, config.sigma, config.sigma_scale)
            labels[group] = cut(embedded.points, sigma[group])
    return labels, sigma


@dataclass(frozen=True, eq=False)
class ClusterMembers:
    """Segments sorted by cluster, to find the cluster of a new segment.

    Attributes
    ----------
    order : ndarray of int, shape (n_segments,)
        The segments, cluster by cluster, ascending within each.
    starts : ndarray of int, shape (n_clusters,)
        Position in `order` at which each cluster begins.
    points : ndarray, shape (n_segments, n_components)
        The points of the segments in `order`.
    """

    order: IntArray
    starts: IntArray
    points: FloatArray

    @classmethod
    def from_labels(cls, labels: IntArray, points: FloatArray) -> "ClusterMembers":
        """Sort segments, given the cluster and the point of each."""
        order = np.argsort(labels, kind="stable")
        return cls(order, np.flatnonzero(np.diff(labels[order], prepend=-1)), points[order])

    def find_nearest_cluster(self, point: FloatArray, sigma: float) -> tuple[IntArray, FloatArray]:
        """Find the cluster that a new point joins.

        Parameters
        ----------
        point : ndarray, shape (n_components,)
            The point.
        sigma : float
            The cluster diameter threshold.

        Returns
        -------
        members : ndarray of int, shape (n,)
            The members of the cluster; empty if no cluster fits. A cluster fits if all its
            members are within `sigma` of the point. Of several that with the nearest member is
            taken; ties go to the first.
        distances : ndarray, shape (n,)
            Their distances from the point.
        """
        # Most clusters are ruled out by their first member.
        first = np.linalg.norm(self.points[self.starts] - point, axis=1)
        ends = np.append(self.starts[1:], len(self.order))
        members, distances = self.order[:0], np.zeros(0)
        for cluster in np.flatnonzero(first <= sigma).tolist():
            rows = slice(self.starts[cluster], ends[cluster])
            from_point = np.linalg.norm(self.points[rows] - point, axis=1)
            if from_point.max() > sigma:
                continue
            if not len(members) or from_point.min() < distances.min():
                members, distances = self.order[rows], from_point
        return members, distances


def nearest_clusters(
    embedding: Embedding | None, labels: IntArray, n_new: int, sigma: float
) -> IntArray:
    """Return the clusters of new segments, whose points are the last of an embedding.

    Parameters
    ----------
    embedding : Embedding or None
        The embedding of all segments.
    labels : ndarray of int, shape (n_segments,)
        The clusters of the segments that are not new.
    n_new : int
        Number of new segments.
    sigma : float
        The cluster diameter threshold.

    Returns
    -------
    ndarray of int, shape (n_new,)
        See `ClusterMembers.find_nearest_cluster`; a cluster of its own if none fits.
    """
    clusters: IntArray = labels.max(initial=-1) + 1 + np.arange(n_new)
    if embedding is None:
        return clusters
    members = ClusterMembers.from_labels(labels, embedding.points[:-n_new])
    for index, point in enumerate(embedding.points[-n_new:]):
        nearest, _ = members.find_nearest_cluster(point, sigma)
        if len(nearest):
            clusters[index] = labels[nearest[0]]
    return clusters
