"""Neighbourhoods of base segments: the values of `Config.neighbourhood`."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mograft import _core
from mograft._util.arrays import FloatArray, IntArray

FEWEST_DONORS = 2
"""Number of donors up to which the nearest ones beyond a ball are added; see `SegmentPool`."""

_ROUNDING = 1e-11
"""Bound of the rounding error of a squared distance, relative to the greatest squared norm."""

_SORTED: "dict[int, tuple[weakref.ref[FloatArray], tuple[IntArray, FloatArray, FloatArray]]]" = {}
"""The last result of `_sort`, by the identity of its argument."""


@dataclass(frozen=True, eq=False)
class ClusterMembers:
    """Segments sorted by cluster, from which the neighbourhood of a new segment is found."""

    order: IntArray  # the segments, cluster by cluster, ascending within each
    starts: IntArray  # position in `order` at which each cluster begins
    points: FloatArray  # shape (n_segments, n_components), in this order

    @classmethod
    def from_labels(cls, labels: IntArray, points: FloatArray) -> "ClusterMembers":
        """Sort segments, given the cluster and the point of each."""
        order = np.argsort(labels, kind="stable")
        return cls(order, np.flatnonzero(np.diff(labels[order], prepend=-1)), points[order])

    def find_nearest_cluster(self, point: FloatArray, sigma: float) -> tuple[IntArray, FloatArray]:
        """Return the members of the cluster that a new point joins, and their distances from it.

        The point can join a cluster if all members are within `sigma` of the point. Of several such
        clusters, it joins the one with the nearest member; ties go to the first. If there is none,
        both arrays are empty.
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

    def find_within(self, point: FloatArray, radius: float) -> tuple[IntArray, FloatArray]:
        """Return the segments within a radius of a point, ascending, and their distances."""
        distances = np.linalg.norm(self.points - point, axis=1)
        rows = np.flatnonzero(distances <= radius)
        rows = rows[np.argsort(self.order[rows])]
        return self.order[rows], distances[rows]


@dataclass(frozen=True)
class Neighbourhood:
    """Rule that decides which segments are similar enough in the base group to be candidates.

    `find_members` takes the cluster and the point of every segment, the cluster diameter threshold
    and the base segments. The points are None if there is no embedding. It returns the segments in
    the neighbourhood of each base segment, ascending, the base segment itself included.

    `find_near` takes the segments, a new point and the cluster diameter threshold. It returns the
    segments in the neighbourhood of the point, ascending, and their distances. For a ball the
    threshold is the radius.
    """

    inside: str  # relation of a segment in the neighbourhood, as in "same cluster"
    outside: str  # completes "12 segments are ..." for the other segments
    reach: float  # how far donors may be if too few are inside, in radii
    find_members: Callable[[IntArray, FloatArray | None, float, IntArray], list[IntArray]]
    find_near: Callable[[ClusterMembers, FloatArray, float], tuple[IntArray, FloatArray]]


def _cluster_members(
    labels: IntArray, _points: FloatArray | None, _sigma: float, base: IntArray
) -> list[IntArray]:
    """Return the cluster of each base segment (paper, 4.3)."""
    order = np.argsort(labels, kind="stable")
    first = np.searchsorted(labels[order], labels[base], side="left")
    last = np.searchsorted(labels[order], labels[base], side="right")
    return [order[low:high] for low, high in zip(first.tolist(), last.tolist(), strict=True)]


def _ball_members(
    _labels: IntArray, points: FloatArray | None, sigma: float, base: IntArray
) -> list[IntArray]:
    """Return all segments within a radius of each base segment in the embedding.

    Memory is linear in the numbers of segments and of results: distances are computed for one base
    segment at a time, and only to the segments whose first component differs by at most the radius.
    """
    if points is None:
        return [base[index : index + 1] for index in range(len(base))]
    (order, by_first, squares), limit = _sort(points), sigma * sigma
    reach = sigma * (1.0 + 1e-9)  # the sum below is rounded
    first = np.searchsorted(by_first[:, 0], points[base, 0] - reach, side="left")
    last = np.searchsorted(by_first[:, 0], points[base, 0] + reach, side="right")
    found: list[IntArray] = []
    with np.errstate(over="ignore", invalid="ignore"):  # points of a damaged library are far away
        for low, high, point in zip(first.tolist(), last.tolist(), points[base], strict=True):
            # A product of matrices is fast but rounded: distances near the radius are exact.
            gaps = squares[low:high] - 2.0 * (by_first[low:high] @ point) + point @ point
            slack = _ROUNDING * squares[low:high].max()
            near = np.flatnonzero(gaps <= limit + slack)
            unsure = gaps[near] >= limit - slack
            distances = np.linalg.norm(by_first[low:high][near[unsure]] - point, axis=1)
            unsure[unsure] = distances > sigma
            found.append(np.sort(order[low:high][near[~unsure]]))
    return found


def _sort(points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the order by the first component, the points in it, and their squared norms.

    The result is kept: all grafts of a library use the same points.
    """
    known = _SORTED.get(id(points))
    if known is not None and known[0]() is points:
        return known[1]
    order = np.argsort(points[:, 0], kind="stable")
    by_first = points[order]
    found = order, by_first, np.einsum("ij,ij->i", by_first, by_first)
    if not points.flags.writeable:
        _SORTED.clear()
        _SORTED[id(points)] = weakref.ref(points), found
    return found


def point_distances(points: FloatArray, first: IntArray, second: IntArray) -> FloatArray:
    """Return the distance between the two points of each of n pairs, given by their indices."""
    return _core.distances(np.ascontiguousarray(points), first, second)


NEIGHBOURHOODS: dict[str, Neighbourhood] = {
    "cluster": Neighbourhood(
        inside="same cluster",
        outside="in other clusters",
        reach=1.0,
        find_members=_cluster_members,
        find_near=ClusterMembers.find_nearest_cluster,
    ),
    "ball": Neighbourhood(
        inside="within the ball",
        outside="outside the ball",
        reach=2.0,
        find_members=_ball_members,
        find_near=ClusterMembers.find_within,
    ),
}
"""The neighbourhoods by their names in `Config.neighbourhood`."""
