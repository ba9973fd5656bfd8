"""Complete linkage that merges only neighbours in a graph."""

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray


def connected_linkage(distances: FloatArray, is_neighbour: BoolArray) -> FloatArray:
    """Cluster by complete linkage; two clusters merge only if some of their points are neighbours.

    `distances` and `is_neighbour` have shape (n, n) and are symmetric, and the graph of neighbours
    is connected. The result is a tree in SciPy's format, shape (n - 1, 4). Heights never decrease:
    a merge adds neighbours to a cluster, but none is closer than the merged clusters were.
    Merges of equal distance are ordered by the lowest points of the two clusters, as in
    `mograft_linkage.linkage`, whose tree results if all points are neighbours.
    """
    n = len(distances)
    members = {point: [point] for point in range(n)}
    rows = []
    for step in range(n - 1):
        candidates = []
        for first, left in members.items():
            for second, right in members.items():
                if left[0] < right[0] and is_neighbour[np.ix_(left, right)].any():
                    distance = float(distances[np.ix_(left, right)].max())
                    candidates.append((distance, left[0], right[0], first, second))
        if not candidates:
            raise ValueError("the graph of neighbours must be connected")
        distance, _, _, first, second = min(candidates)
        merged = sorted(members.pop(first) + members.pop(second))
        members[n + step] = merged
        rows.append([min(first, second), max(first, second), distance, len(merged)])
    return np.array(rows, np.float64).reshape(-1, 4)
