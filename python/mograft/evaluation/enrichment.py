"""How many motions could be made of what was captured (paper, 5.4, tables 1 and 2)."""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mograft._util.arrays import IntArray
from mograft.analysis.clustering import cut, threshold
from mograft.body.groups import PRESETS, JointGroups
from mograft.library.library import Library
from mograft.search.candidates import count_combinations

__all__ = [
    "PAPER_TABLES",
    "READINGS",
    "SCALES",
    "Count",
    "Enrichment",
    "Law",
    "cluster_numbers",
    "enrichment",
    "moment_laws",
    "sweep",
]

PAPER_TABLES: Mapping[str, tuple[int, int, Mapping[int, int]]] = {
    "table 1": (6572, 895, {2: 3736, 3: 47018, 4: 3776858, 5: 143030206}),
    "table 2": (6652, 906, {2: 4272, 3: 79012, 4: 1910228, 5: 8330957}),
}
"""Frames, segments and, for each number of groups, combinations that the paper prints."""

READINGS = ("literal", "rms")
SCALES = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
_GROUPS = (2, 3, 4, 5)


@dataclass(frozen=True)
class Count:
    """What can be combined from one number of joint groups.

    Attributes
    ----------
    groups : int
        K, the number of joint groups, the base among them.
    unfiltered : int
        Segments if nothing but the clusters limits the choice: Σ |c|^K.
    filtered : int
        Those whose parts also fit in length (eq. 19) and hold no fault: Σ n_i^(K-1).
    new : int
        Those of `filtered` that are not a captured segment.
    """

    groups: int
    unfiltered: int
    filtered: int
    new: int


@dataclass(frozen=True)
class Enrichment:
    """Counts for one reading of the threshold and one scale.

    Attributes
    ----------
    segments : int
        Captured segments, A in the paper.
    clusters : int
        Clusters of the base group.
    largest : int
        Segments of the largest of these.
    sigma : str or float
        Reading of eq. 14; see `mograft.Config`.
    sigma_scale : float
        Factor on it.
    diameter : float
        The greatest diameter of a cluster that they come to.
    counts : tuple of Count
        For 2 to 5 groups.
    """

    segments: int
    clusters: int
    largest: int
    sigma: str | float
    sigma_scale: float
    diameter: float
    counts: tuple[Count, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it: the counts as text, since they may be of any size."""
        return {
            "segments": self.segments,
            "base_clusters": self.clusters,
            "largest_cluster": self.largest,
            "sigma": self.sigma,
            "sigma_scale": self.sigma_scale,
            "diameter": self.diameter,
            "counts": [
                {
                    "groups": own.groups,
                    "unfiltered": str(own.unfiltered),
                    "filtered": str(own.filtered),
                    "new": str(own.new),
                    "factor_unfiltered": own.unfiltered / self.segments,
                    "factor_filtered": own.filtered / self.segments,
                }
                for own in self.counts
            ],
        }


@dataclass(frozen=True)
class Law:
    """An inequality that counts of clusters obey, and whether some given ones do.

    Attributes
    ----------
    name : str
        The inequality.
    holds : bool
        Whether the counts obey it.
    margin : float
        The greater side over the lesser one as they should be: below 1 where it fails.
    """

    name: str
    holds: bool
    margin: float


def enrichment(library: Library, groups: Sequence[int] = _GROUPS) -> Enrichment:
    """Count the segments that could be put together from a library.

    Parameters
    ----------
    library : Library
        Its base group's clusters and its limits on length count.
    groups : sequence of int
        Numbers of joint groups, each 2 or more.

    Returns
    -------
    Enrichment
        Exact integers of any size.

    Raises
    ------
    ValueError
        If a number of groups is below 2.

    Notes
    -----
    Only clusters of the base group limit the choice (eq. 18), so K groups that share a base
    have Σ_i n_i^(K-1) combinations, where n_i segments may lend segment i their parts. It is
    segments that are counted, where the paper's text says frames.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> found = enrichment(Library.build(dance(strides=1).motion))
    >>> all(own.unfiltered >= own.filtered >= found.segments for own in found.counts)
    True
    """
    if min(groups, default=2) < 2:
        raise ValueError(f"groups must be numbers from 2, got {min(groups)}")
    base, config = library.groups.base, library.config
    return _counted(
        library, library.labels[base], config.sigma, config.sigma_scale, library.sigma[base], groups
    )


def sweep(
    library: Library,
    readings: Sequence[str] = READINGS,
    scales: Sequence[float] = SCALES,
    groups: Sequence[int] = _GROUPS,
) -> tuple[Enrichment, ...]:
    """Count for every reading of the threshold and a range of scales.

    Parameters
    ----------
    library : Library
        Its base group is clustered anew for each.
    readings : sequence of str
        Named readings of eq. 14.
    scales : sequence of float
        Factors on each.
    groups : sequence of int
        Numbers of joint groups.

    Returns
    -------
    tuple of Enrichment
        Reading by reading, by ascending scale; empty where nothing could be compared.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> rows = sweep(Library.build(dance(strides=1).motion), ["rms"], [0.5, 1.0])
    >>> rows[0].clusters >= rows[1].clusters
    True
    """
    own = library.embedding[library.groups.base]
    if own is None:
        return ()
    rows = []
    for reading in readings:
        for scale in sorted(scales):
            diameter = threshold(own.points, reading, scale)
            labels = cut(own.points, diameter)
            rows.append(_counted(library, labels, reading, scale, diameter, groups))
    return tuple(rows)


def _counted(
    library: Library,
    labels: IntArray,
    sigma: str | float,
    scale: float,
    diameter: float,
    groups: Sequence[int],
) -> Enrichment:
    grafted = next(name for name in library.groups.names if name != library.groups.base)
    pool = replace(library.pool(grafted), labels=labels)
    n = len(labels)
    choices = [len(own) for own in pool.candidate_lists(np.arange(n), library.config)]
    sizes = np.bincount(labels)
    counts = []
    for k in groups:
        filtered = sum(own ** (k - 1) for own in choices)
        counts.append(Count(k, count_combinations(labels, k), filtered, filtered - n))
    return Enrichment(
        n, len(sizes), int(sizes.max(initial=0)), sigma, scale, diameter, tuple(counts)
    )


def cluster_numbers(library: Library) -> dict[int, dict[str, int]]:
    """Return how many clusters the parts of 2, 3, 4 and 5 joint groups fall into.

    Parameters
    ----------
    library : Library
        Its clips are compared anew, by its configuration, for every preset of joint groups.

    Returns
    -------
    dict of int to dict of str to int
        For each number of groups that the skeleton has a preset for, the clusters of each.
    """
    found = {}
    skeleton = library.skeleton
    with warnings.catch_warnings():  # what the library itself was built with was told then
        warnings.simplefilter("ignore")
        for preset, names in PRESETS.items():
            try:
                groups = JointGroups.preset(preset, skeleton)
            except ValueError:
                continue
            # Built at one rate already, the same clips are cut into the same segments.
            own = Library.build(library.clips, groups, library.config)
            found[len(names)] = {g: int(own.labels[g].max()) + 1 for g in own.groups.names}
    return found


def moment_laws(segments: int, counts: Mapping[int, int]) -> tuple[Law, ...]:
    """Tell whether one clustering could have produced some counts.

    Parameters
    ----------
    segments : int
        How many segments there are.
    counts : mapping of int to int
        For some numbers K of groups the combinations B_K.

    Returns
    -------
    tuple of Law
        For neighbouring K that are given, 1 (the segments themselves) among them. Where one
        fails, no single set of clusters gives the counts; where "Cauchy-Schwarz" fails, no
        set of choices n_i does, however filtered: the base group, the clusters or the filters
        changed with K.

    Raises
    ------
    ValueError
        If a number of segments or combinations is below 1.

    Notes
    -----
    With n_i choices for segment i, B_K = Σ n_i^(K-1): moments, which obey
    B_(K-1) B_(K+1) ≥ B_K². The n_i of clusters are their sizes, once for each member, so the
    largest cluster has at least B_(K+1) / B_K and at most B_J^(1/J) members for every J. All
    is compared in whole numbers.

    Examples
    --------
    The paper's first table cannot come from one clustering:

    >>> _, segments, counts = PAPER_TABLES["table 1"]
    >>> [law.name for law in moment_laws(segments, counts) if not law.holds][0]
    'Cauchy-Schwarz: B_3 B_5 >= B_4^2'
    """
    known = {1: int(segments), **{int(k): int(b) for k, b in counts.items()}}
    if min(known.values()) < 1:
        raise ValueError(f"counts must be 1 or more, got {min(known.values())}")
    laws = []
    for k in sorted(known):
        if k - 1 in known and k + 1 in known:
            name = f"Cauchy-Schwarz: B_{k - 1} B_{k + 1} >= B_{k}^2"
            laws.append(_law(name, known[k - 1] * known[k + 1], known[k] ** 2))
    for k in sorted(known):
        if k + 1 not in known:
            continue
        for j in sorted(known):
            # (B_(K+1) / B_K)^J <= B_J, without a fraction.
            name = f"largest cluster: B_{k + 1} / B_{k} <= B_{j}^(1/{j})"
            laws.append(_law(name, known[j] * known[k] ** j, known[k + 1] ** j, j))
    return tuple(laws)


def _law(name: str, great: int, small: int, root: int = 1) -> Law:
    # By logarithms, which whole numbers of any size have.
    ratio = (math.log(great) - math.log(small)) / root
    return Law(name, great >= small, math.exp(min(ratio, 700.0)))
