"""Embed and cluster the segments of a library, group by group."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from mograft._standalone.mograft_linkage import cut, threshold
from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.channel_groups import restrict_samples
from mograft.analysis.embedding import Embedding, embed, mean_rotations
from mograft.body.anatomy import feature_joints
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.library.data import LibraryData
from mograft.motion.skeleton import Skeleton
from mograft.search.neighbourhoods import ClusterMembers

L = TypeVar("L", bound=LibraryData)

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the number of items done and of all items."""


def feature_joints_by_group(groups: JointGroups, skeleton: Skeleton) -> dict[str, IntArray]:
    """Return for each group the joints whose rotations are compared between segments."""
    members = groups.resolve(skeleton)
    return {name: feature_joints(skeleton, joints) for name, joints in members.items()}


def join_boundary_states(
    clips: Sequence[Mapping[str, FloatArray]],
    groups: JointGroups,
    skeleton: Skeleton,
    known: Mapping[str, Mapping[str, FloatArray]] | None = None,
) -> dict[str, dict[str, FloatArray]]:
    """Join the boundary states of clips; return those of the feature joints of each group.

    The result has two levels of keys: groups, then keys of `boundary_states` such as ``first``.
    `clips` holds the result of `boundary_states` for each clip. `known`, an earlier result, is
    prepended.
    """
    joined: dict[str, dict[str, FloatArray]] = {}
    for group, joints in feature_joints_by_group(groups, skeleton).items():
        joined[group] = {}
        for key in clips[0]:
            states = [known[group][key]] if known else []
            states += [clip[key].take(joints, axis=1) for clip in clips]
            joined[group][key] = np.concatenate(states)
    return joined


def compare(library: L, report: Progress) -> L:
    """Return a library with the embedding and the clusters of all segments."""
    embedding = embed_groups(library, report)
    report("clustering", 0, 1)
    labels, sigma = cluster_groups(embedding, len(library.segments), library.config)
    report("clustering", 1, 1)
    return replace(library, embedding=embedding, labels=labels, sigma=sigma)


def embed_groups(library: LibraryData, report: Progress) -> dict[str, Embedding | None]:
    """Return the embedding of the segments for each group; None if they cannot be embedded.

    Segments cannot be embedded if there are too few or if they are too similar. `report` is called
    with the progress. Raise ValueError if the root's channels are divided between groups.
    """
    samples, config = library.samples, library.config
    skeleton, root = library.skeleton, library.root
    members, held = library.groups.resolve(skeleton), library.groups.divided_channels(skeleton)
    report("comparing", 0, len(members))
    means = mean_rotations(samples.chunks())
    embeddings: dict[str, Embedding | None] = {}
    for name, joints in members.items():
        compared = feature_joints(skeleton, joints)
        if root in joints:
            compared = np.union1d(compared, [root])
        if root in held[name]:
            raise ValueError(
                f"all channels of {skeleton.names[root]}, which carries the body, must be in one "
                f"group, got some in {name!r}"
            )
        restrict = partial(restrict_samples, skeleton=skeleton, channels=held[name])
        own = mean_rotations(map(restrict, samples.chunks())) if held[name] else means
        embeddings[name] = embed(
            samples, compared, own, config, root=root, group=name, restrict=restrict
        )
        report("comparing", len(embeddings), len(members))
    return embeddings


def cluster_groups(
    embedding: Mapping[str, Embedding | None], n_segments: int, config: Config
) -> tuple[dict[str, IntArray], dict[str, float]]:
    """Return the cluster of each segment, and the cluster diameter threshold, by group.

    Without an embedding each segment forms a separate cluster, and the threshold is 0.
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


def nearest_clusters(
    embedding: Embedding | None, labels: IntArray, n_new: int, sigma: float
) -> IntArray:
    """Return the clusters of `n_new` new segments, whose points are the last of an embedding.

    `labels` holds the clusters of the other segments. A new segment joins the cluster that
    `ClusterMembers.find_nearest_cluster` returns for the threshold `sigma`. If it returns none, the
    segment forms a new cluster.
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
