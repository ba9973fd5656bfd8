"""Numbers of combinations of captured parts (paper, 5.4, tables 1 and 2)."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lab.common import RenamedRecord
from lab.donors.methods import cluster_candidates
from mograft import JointGroups, Library
from mograft.clustering import cut, threshold
from mograft.evaluation.estimate import Record

PAPER_TABLES = {
    "table 1": (6572, 895, {2: 3736, 3: 47018, 4: 3776858, 5: 143030206}),
    "table 2": (6652, 906, {2: 4272, 3: 79012, 4: 1910228, 5: 8330957}),
}
"""Frames, segments and, for each number of groups, combinations in the tables of the paper."""

PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")
_GROUPS = (2, 3, 4, 5)
_READINGS = ("literal", "rms")


@dataclass(frozen=True)
class Count:
    """Numbers of combinations of captured parts, for one number K of joint groups.

    n_i is the number of candidates of segment i: the segment itself, and the segments in its
    cluster that have a similar length (eq. 19) and no faults.
    """

    groups: int  # K, including the base group
    unfiltered: int  # within the clusters c of the base group: Σ |c|^K
    filtered: int  # of the base segments with their candidates only: Σ n_i^(K-1)
    new: int  # number of the `filtered` combinations that were not captured


@dataclass(frozen=True)
class Enrichment(RenamedRecord):
    """Numbers of combinations for one cluster diameter threshold.

    The threshold is given by an interpretation of eq. 14 of the paper and a scale.

    Attributes
    ----------
    segments, clusters, largest : int
        Numbers of captured segments (A in the paper), of clusters of the base group, and of
        segments in the largest cluster.
    sigma : str
        Interpretation of eq. 14; see `sigma` of `mograft.Config`.
    sigma_scale : float
        Factor on `sigma`.
    diameter : float
        Maximum cluster diameter that results from `sigma` and `sigma_scale`.
    counts : tuple of Count
        Counts for each number of groups.
    """

    segments: int
    clusters: int
    largest: int
    sigma: str | float
    sigma_scale: float
    diameter: float
    counts: tuple[Count, ...]

    JSON_KEYS: ClassVar[Mapping[str, str]] = {
        "clusters": "base_clusters",
        "largest": "largest_cluster",
    }

    def as_dict(self):
        """Return a dict for JSON; the counts are strings, since they may be of any size."""
        return {
            **super().as_dict(),
            "counts": [
                {
                    "groups": count.groups,
                    "unfiltered": str(count.unfiltered),
                    "filtered": str(count.filtered),
                    "new": str(count.new),
                    "factor_unfiltered": count.unfiltered / self.segments,
                    "factor_filtered": count.filtered / self.segments,
                }
                for count in self.counts
            ],
        }


@dataclass(frozen=True)
class Law(Record):
    """An inequality that holds for every clustering, and whether it holds for given counts."""

    name: str  # the inequality
    holds: bool
    margin: float  # the side that must be greater, divided by the other; below 1 if it is smaller


def enrichment(library, groups=_GROUPS):
    """Count the segments that can be composed of the parts of captured segments.

    Parameters
    ----------
    library : Library
        Library with the clusters of the base group and the length limits.
    groups : sequence of int
        Numbers of joint groups to count for, each at least 2.

    Returns
    -------
    Enrichment
        The counts, exact integers of any size.

    Raises
    ------
    ValueError
        If a number of groups is below 2.

    Notes
    -----
    Only the clusters of the base group restrict the donors (eq. 18), whatever
    `Config.neighbourhood` is. If segment i has n_i
    candidates, the base group and K - 1 other groups therefore have Σ_i n_i^(K-1) combinations.
    These are numbers of segments; the text of the paper calls them frames.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> found = enrichment(Library.build(dance(strides=1).motion))
    >>> all(c.unfiltered >= c.filtered >= found.segments for c in found.counts)
    True
    """
    _check_groups(groups)
    base, config = library.groups.base, library.config
    labels, diameter = library.labels[base], library.sigma[base]
    return _count_combinations(library, labels, config.sigma, config.sigma_scale, diameter, groups)


def _check_groups(groups):
    if min(groups, default=2) < 2:
        raise ValueError(f"`groups` must contain numbers of at least 2, got {min(groups)}")


def sweep(library, readings=_READINGS, scales=(0.25, 0.5, 0.75, 1.0, 1.25, 1.5), groups=_GROUPS):
    """Count the combinations for each interpretation of eq. 14 and each scale.

    Parameters
    ----------
    library : Library
        Library whose base group is clustered again for each threshold.
    readings : sequence of str
        Interpretations of eq. 14, the cluster diameter threshold: names for `Config.sigma`.
    scales : sequence of float
        Factors on each threshold.
    groups : sequence of int
        Numbers of joint groups to count for, each at least 2.

    Returns
    -------
    tuple of Enrichment
        Counts by interpretation and ascending scale; empty if the base group has no embedding.

    Raises
    ------
    ValueError
        If an interpretation is unknown, or a number of groups is below 2.
    """
    _check_groups(groups)
    for reading in readings:
        if reading not in _READINGS:
            raise ValueError(f"`readings` must be among {', '.join(_READINGS)}, got {reading!r}")
    embedding = library.embedding[library.groups.base]
    if embedding is None:
        return ()
    rows = []
    for reading in readings:
        for scale in sorted(scales):
            diameter = threshold(embedding.points, reading, scale)
            labels = cut(embedding.points, diameter)
            rows.append(_count_combinations(library, labels, reading, scale, diameter, groups))
    return tuple(rows)


def _count_combinations(library, labels, sigma, scale, diameter, groups):
    n = len(labels)
    candidates = cluster_candidates(library, np.arange(n), labels)
    sizes = np.bincount(labels)
    counts = []
    for k in groups:
        filtered = sum(len(segments) ** (k - 1) for segments in candidates)
        unfiltered = sum(int(size) ** k for size in np.bincount(labels))
        counts.append(Count(k, unfiltered, filtered, filtered - n))
    return Enrichment(
        segments=n,
        clusters=len(sizes),
        largest=int(sizes.max(initial=0)),
        sigma=sigma,
        sigma_scale=scale,
        diameter=diameter,
        counts=tuple(counts),
    )


def cluster_numbers(library):
    """Cluster the clips for presets of 2, 3, 4 and 5 joint groups; return the numbers of clusters.

    The keys are the number of groups of the preset, then the name of a group. Presets that the
    skeleton does not support are omitted. The configuration is that of the library.
    """
    found = {}
    skeleton = library.skeleton
    with warnings.catch_warnings():  # building the library has already issued them
        warnings.simplefilter("ignore")
        for preset in PRESETS:
            try:
                groups = JointGroups.preset(preset, skeleton)
            except ValueError:
                continue
            labels = Library.build(library.clips, groups, library.config).labels
            numbers = {group: int(labels[group].max()) + 1 for group in groups.names}
            found[len(numbers)] = numbers
    return found


def moment_laws(segments, counts):
    """Test whether a single clustering can have the given counts.

    Parameters
    ----------
    segments : int
        Number of segments, which is B_1.
    counts : mapping of int to int
        Combinations B_K for some numbers K of groups.

    Returns
    -------
    tuple of Law
        Inequalities between the counts of successive K. If one of them fails, no single
        clustering gives the counts. If one named "Cauchy-Schwarz" fails, no numbers of candidates
        n_i give the counts: the base group, the clusters or the filters changed with K.

    Raises
    ------
    ValueError
        If a number of segments or combinations is below 1.

    Notes
    -----
    With n_i candidates for segment i, the B_K = Σ n_i^(K-1) are moments. They satisfy
    B_(K-1) B_(K+1) ≥ B_K². In a clustering, n_i is the size of the cluster of segment i. The
    largest cluster therefore has at least B_(K+1) / B_K and, for every J, at most B_J^(1/J)
    members. All comparisons use exact integers.

    Examples
    --------
    Table 1 of the paper cannot come from a single clustering:

    >>> _, segments, counts = PAPER_TABLES["table 1"]
    >>> [law.name for law in moment_laws(segments, counts) if not law.holds][0]
    'Cauchy-Schwarz: B_3 B_5 >= B_4^2'
    """
    known = {1: int(segments), **{int(k): int(b) for k, b in counts.items()}}
    if min(known.values()) < 1:
        raise ValueError(f"`segments` and `counts` must be at least 1, got {min(known.values())}")
    laws = []
    for k in sorted(known):
        if k - 1 in known and k + 1 in known:
            name = f"Cauchy-Schwarz: B_{k - 1} B_{k + 1} >= B_{k}^2"
            laws.append(_law(name, known[k - 1] * known[k + 1], known[k] ** 2))
    for k in sorted(known):
        if k + 1 not in known:
            continue
        for j in sorted(known):
            # (B_(K+1) / B_K)^J <= B_J, multiplied by B_K^J.
            name = f"largest cluster: B_{k + 1} / B_{k} <= B_{j}^(1/{j})"
            laws.append(_law(name, known[j] * known[k] ** j, known[k + 1] ** j, j))
    return tuple(laws)


def _law(name, left, right, root=1):
    # Integers of any size have a logarithm; their quotient may overflow.
    ratio = (math.log(left) - math.log(right)) / root
    return Law(name, left >= right, math.exp(min(ratio, 700.0)))
