"""Transition graphs made from cost matrices, and back."""

import numpy as np

from mograft.scenario import Transitions


def cost_matrix(graph):
    """The costs of a graph as a matrix; infinite where there is no transition."""
    n = len(graph.segments)
    costs = np.full((n, n), np.inf)
    costs[graph.sources, graph.targets] = graph.costs
    return costs


def graph_from_costs(costs):
    """A graph of segments 0 to n - 1 that do not move over the floor."""
    n = len(costs)
    sources, targets = np.nonzero(np.isfinite(costs))
    return Transitions(
        segments=np.arange(n),
        first_edge=np.searchsorted(sources, np.arange(n + 1)),
        targets=targets,
        costs=costs[sources, targets],
        limit=0.0,
        displacements=np.zeros((n, 3)),
        yaw_changes=np.zeros(len(targets)),
        seam_displacements=np.zeros((len(targets), 3)),
        is_at_rest=np.ones(n, bool),
    )


def is_walk(graph, segments):
    """Whether every step between segments is a transition of the graph."""
    nodes = np.searchsorted(graph.segments, segments)
    return np.isfinite(cost_matrix(graph)[nodes[:-1], nodes[1:]]).all()
