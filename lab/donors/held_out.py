"""Libraries whose features and clusters are fitted on some segments only, for tests on others."""

import warnings
from dataclasses import replace

import numpy as np

from mograft.analysis.channel_groups import restrict_samples
from mograft.analysis.embedding import features
from mograft.clustering import cut, threshold
from mograft.evaluation import estimate
from mograft.library.clusters import embed_groups, nearest_clusters

GROUP_SEGMENTS = 20  # neighbouring segments that stay in one fold: about five seconds


def fold_groups(library):
    """Return the fold group of each segment: the unit that is assigned to a fold as a whole.

    The units are the clips if there are ten or more, and blocks of 20 consecutive segments of a
    clip otherwise. They are numbered from 0.
    """
    return estimate.segment_blocks(library.segments.clip, GROUP_SEGMENTS)


def fit_on(library, is_fitted):
    """Return a library whose features and clusters are computed from some of its segments.

    Mean rotations, scales, principal components, the cluster diameter threshold and the clusters
    are those of a library that holds only the segments `is_fitted`, shape (n_segments,). The other
    segments are treated as those of a clip that `Library.with_clip` appends: they are projected,
    join the nearest cluster, and are excluded as donors. All groups must have an embedding.
    """
    fitted, others = np.flatnonzero(is_fitted), np.flatnonzero(~is_fitted)
    with warnings.catch_warnings():  # building the library has already issued them
        warnings.simplefilter("ignore")
        embeddings = embed_groups(replace(library, samples=library.samples.select(fitted)), _ignore)
    held = library.groups.divided_channels(library.skeleton)
    rest = library.samples.select(others)
    order = np.argsort(np.concatenate([fitted, others]))
    embedding = {}
    labels = {}
    sigma = {}
    config = library.config
    for group, known in embeddings.items():
        if known is None:
            embedding[group], sigma[group] = None, 0.0
            labels[group] = np.arange(len(order))
            continue
        added = _project(known, restrict_samples(rest, library.skeleton, held[group]))
        joined = replace(known, points=np.concatenate([known.points, added]))
        sigma[group] = threshold(known.points, config.sigma, config.sigma_scale)
        clusters = cut(known.points, sigma[group])
        new = nearest_clusters(joined, clusters, len(others), sigma[group])
        labels[group] = np.concatenate([clusters, new])[order]
        embedding[group] = replace(joined, points=joined.points[order])
    return replace(
        library,
        embedding=embedding,
        labels=labels,
        sigma=sigma,
        is_donor=library.is_donor & is_fitted,
    )


def _project(embedding, samples):
    if not len(samples):
        return np.empty((0, embedding.points.shape[1]))
    matrix = features(samples, embedding.joints, embedding.reference, has_root=embedding.has_root)
    return embedding.project(matrix)


def shuffle_parts(is_donor, rng, groups=None):
    """Return a random permutation of the segments, shape (n_segments,).

    Segments that are not in `is_donor` stay in place. If `groups` is given, the result of
    `fold_groups`, segments are permuted only within each clip or block.
    """
    shuffled = np.arange(len(is_donor))
    donors = np.flatnonzero(is_donor)
    if groups is None:
        shuffled[donors] = rng.permutation(donors)
        return shuffled
    for group in np.unique(groups[donors]):
        members = donors[groups[donors] == group]
        shuffled[members] = rng.permutation(members)
    return shuffled


def _ignore(stage, done, total):
    pass
