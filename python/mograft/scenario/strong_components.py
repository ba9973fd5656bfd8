"""Strongly connected components of a directed graph."""

from itertools import pairwise

import numpy as np

from mograft._util.arrays import IntArray


def largest_strong_component(n: int, sources: IntArray, targets: IntArray) -> IntArray:
    """Return the nodes of the largest strongly connected component of a graph, ascending.

    In such a component, every node is reachable from every other one. The graph has the nodes 0 to
    `n` - 1. Its edges lead from `sources` to `targets` and are sorted by source. Of components of
    the same size, the one that is found first is returned. The algorithm is that of Tarjan
    (Depth-first search and linear graph algorithms, 1972), without recursion.
    """
    bounds = np.searchsorted(sources, np.arange(n + 1)).tolist()
    every_target = targets.tolist()
    successors = [every_target[start:stop] for start, stop in pairwise(bounds)]
    order, low = [-1] * n, [0] * n
    path: list[int] = []
    is_on_path = [False] * n
    largest: list[int] = []
    count = 0
    for root in range(n):
        visits = [(root, 0)] if order[root] < 0 else []
        while visits:
            node, first = visits.pop()
            if first == 0:
                order[node] = low[node] = count
                count += 1
                path.append(node)
                is_on_path[node] = True
            for index in range(first, len(successors[node])):
                other = successors[node][index]
                if order[other] < 0:
                    visits += [(node, index + 1), (other, 0)]
                    break
                if is_on_path[other]:
                    low[node] = min(low[node], order[other])
            else:
                if low[node] == order[node]:
                    component = _pop_component(path, is_on_path, node)
                    largest = component if len(component) > len(largest) else largest
                if visits:
                    parent = visits[-1][0]
                    low[parent] = min(low[parent], low[node])
    return np.array(sorted(largest), np.int64)


def _pop_component(path: list[int], is_on_path: list[bool], root: int) -> list[int]:
    """Remove the nodes from `root` to the end of the path, one component, and return them."""
    component = [path.pop()]
    while component[-1] != root:
        component.append(path.pop())
    for node in component:
        is_on_path[node] = False
    return component
