"""The transition graph: which base segments may be consecutive in a scenario."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.names import as_words, find_matches
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.scenario.segment_ends import SegmentEnds, segment_ends, transition_costs

_CHEAPEST_SHARE = 0.1  # share of all allowed pairs whose costs are within the limit
_MAX_LIMIT = np.radians(25.0)
_MIN_SEGMENT_SHARE = 0.5  # the limit grows while fewer segments remain, and is below the next one
_MAX_WIDENED_LIMIT = np.radians(45.0)
_STEADY_SHARE = 0.95  # share of starts and ends, those of least root acceleration, with transitions
_MAX_EXIT_COST = np.radians(60.0)
_EXIT_SECONDS = 2.0  # interval of a run of segments with one transition each; see `_exits`
_TRANSITION_TEMPERATURE = np.radians(5.0)
_MIN_SEGMENTS = 4
_MAX_SUCCESSORS = 64  # nearest segments considered after each; determines the memory of a graph
_MAX_SEGMENTS = 100_000  # segments of a graph; all pairs are compared once by their feature points
_MAX_SAMPLED_PAIRS = 200_000  # pairs from which the cheapest tenth is estimated
_MAX_CHUNK = 1 << 22


@dataclass(frozen=True, eq=False)
class Transitions:
    """A graph of which base segments may be consecutive; made by `transitions`.

    A segment's *node* is its index in `segments`. *Edges* are sorted by source, then by target.

    Attributes
    ----------
    segments : ndarray of int, shape (n,)
        The segments, ascending. Every one is reachable from every other.
    first_edge : ndarray of int, shape (n + 1,)
        Index of the first edge from each node; the last entry is the number of edges.
    targets : ndarray of int, shape (m,)
        Node to which each edge leads.
    costs : ndarray, shape (m,)
        Cost of each edge in radians; 0 from a segment to its successor in the clip.
    limit : float
        Largest cost of an allowed transition, in radians. The transitions that are added to runs of
        segments with one transition each may exceed it; see `transitions`.
    displacements : ndarray, shape (n, 3)
        Captured displacement of the root over the floor within each segment, in the file's unit.
    yaw_changes : ndarray, shape (m,)
        Angle in radians by which the target segment must be rotated about the up axis to continue
        the heading of the source segment, if the source segment is not rotated.
    seam_displacements : ndarray, shape (m, 3)
        Displacement in the file's unit that the seam adds to those of the two segments, because it
        blends their root velocities, if the source segment is not rotated.
    is_at_rest : ndarray of bool, shape (n,)
        Whether a segment ends at a minimum of kinetic energy. `to_beats` places beats only there.
    """

    segments: IntArray
    first_edge: IntArray
    targets: IntArray
    costs: FloatArray
    limit: float
    displacements: FloatArray
    yaw_changes: FloatArray
    seam_displacements: FloatArray
    is_at_rest: BoolArray

    def __repr__(self) -> str:
        return f"Transitions({len(self.segments)} segments, {len(self.targets)} transitions)"

    @property
    def sources(self) -> IntArray:
        """Node from which each edge leads, shape (m,)."""
        return np.repeat(np.arange(len(self.segments)), np.diff(self.first_edge))

    def edges_from(self, node: int) -> slice:
        """Return the slice of `targets` and `costs` with the edges from a node."""
        return slice(int(self.first_edge[node]), int(self.first_edge[node + 1]))

    def probabilities(self) -> FloatArray:
        """Return the probability of each edge given its source, proportional to exp(-cost / 5°)."""
        weights = np.exp(-self.costs / _TRANSITION_TEMPERATURE)
        totals = np.add.reduceat(weights, self.first_edge[:-1])
        return weights / totals[self.sources]


def transitions(library: Library, clips: Sequence[str] | str | None = None) -> Transitions:
    """Find which base segments may be consecutive.

    Parameters
    ----------
    library : Library
        The library of the segments.
    clips : str or sequence of str, optional
        Names of clips, or globs of names, whose segments are used. Default: all.

    Returns
    -------
    Transitions
        The graph of the largest set of segments in which every one is reachable from every other.

    Raises
    ------
    ValueError
        If a name or glob matches no clip, if all segments are excluded as donors or there are more
        than 100 000, or if fewer than four segments are reachable from one another.

    Notes
    -----
    The cost of a transition is the mean joint angle between the last pose of the source and the
    first pose of the target, plus the angle between the tilts of the root, plus twice the
    difference in root height (in skeleton heights), plus 0.1 s times the same sum over velocities:
    mean difference of joint angular velocities, difference of root angular velocity, and twice that
    of root velocity relative to the root's heading. Of the transitions with equal foot contacts,
    the cheapest tenth is allowed, but only those with a cost of at most 25°. If less than half of
    the segments would be reachable from one another, this limit of the cost is raised by 25 % at a
    time until half are, or until it is 45° or more. A segment's successor in the clip is always
    allowed. A segment is never followed by itself or by its predecessor in the clip.

    A run of segments with only one transition each is divided into intervals of 2 s. In every
    interval except the first, the cheapest other transition is allowed too, if its cost is at most
    60°. Otherwise walks would repeat such runs.

    The 5 % of all starts and ends at which the root accelerates most over the floor, within 0.15 s
    inside the segment, have no transitions except those within the clip: a transition could
    increase the acceleration beyond that of the recording.

    From each segment, transitions to only the 64 nearest others are considered. The distance is the
    square root of the sum of the squared terms of the cost.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> transitions(Library.build(dance(strides=1).motion)).costs.min()
    np.float64(0.0)
    """
    segments = _donor_segments(library, clips)
    has_successor = np.diff(segments, append=-1) == 1
    has_successor &= np.diff(library.segments.clip[segments], append=-1) == 0
    pairs = _Pairs(*segment_ends(library, segments), has_successor)
    sources, targets, costs = pairs.candidate_edges()
    limit = min(pairs.cheap_cost(), _MAX_LIMIT)
    while True:
        is_within = costs <= limit
        nodes = largest_strong_component(len(segments), sources[is_within], targets[is_within])
        if len(nodes) >= _MIN_SEGMENT_SHARE * len(segments) or limit >= _MAX_WIDENED_LIMIT:
            break
        limit *= 1.25
    if len(nodes) < _MIN_SEGMENTS:
        raise ValueError(
            f"at least {_MIN_SEGMENTS} of {len(segments)} segments must be reachable from one "
            f"another, got {len(nodes)}: the motion never returns to a similar pose; add clips"
        )
    node_of = np.full(len(segments), -1)
    node_of[nodes] = np.arange(len(nodes))
    is_inside = (node_of[sources] >= 0) & (node_of[targets] >= 0)
    is_edge = is_within & is_inside
    seconds = library.segments.lengths[segments] / library.rate
    is_edge |= _exits(sources, np.where(is_inside, costs, np.inf), is_edge, seconds)
    sources, targets, costs = sources[is_edge], targets[is_edge], costs[is_edge]
    yaw_changes, seam_displacements = pairs.root_changes(sources, targets, library.up)
    is_level, ends = np.arange(3) != library.up, pairs.ends
    return Transitions(
        segments=segments[nodes],
        first_edge=np.searchsorted(node_of[sources], np.arange(len(nodes) + 1)),
        targets=node_of[targets],
        costs=costs,
        limit=limit,
        displacements=(is_level * (ends.root_positions - pairs.starts.root_positions))[nodes],
        yaw_changes=yaw_changes,
        seam_displacements=seam_displacements,
        is_at_rest=ends.is_at_rest[nodes],
    )


def _donor_segments(library: Library, clips: Sequence[str] | str | None) -> IntArray:
    """Return the segments of the named clips, without excluded donors, ascending."""
    segments = np.flatnonzero(library.is_donor)
    if clips is not None:
        named = find_matches("clips", as_words("clips", clips), library.names)
        segments = segments[np.isin(library.segments.clip[segments], named)]
    if not len(segments):
        subject = "the library" if clips is None else "`clips`"
        raise ValueError(f"{subject} must have segments that are not excluded as donors, got none")
    if len(segments) > _MAX_SEGMENTS:
        n = len(segments)
        raise ValueError(f"a graph must have at most {_MAX_SEGMENTS} segments, got {n}: name fewer")
    return segments


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of segments: the end of a source, an index into `ends`, and the start of a target."""

    starts: SegmentEnds
    ends: SegmentEnds
    has_successor: BoolArray  # whether the next segment continues this one in the clip

    def is_successor(self, sources: IntArray, targets: IntArray) -> BoolArray:
        """Return whether each target is the successor of its source in the clip."""
        return (targets == sources + 1) & self.has_successor[sources]

    def is_allowed(self, sources: IntArray, targets: IntArray) -> BoolArray:
        """Return whether source and target are neither equal nor neighbours in a clip."""
        are_neighbors = self.is_successor(sources, targets) | self.is_successor(targets, sources)
        return ~are_neighbors & (sources != targets)

    @cached_property
    def steady(self) -> tuple[BoolArray, BoolArray]:
        """Whether each start, and each end, is among the 95 % with least root acceleration."""
        accelerations = self.starts.root_accelerations, self.ends.root_accelerations
        limit = np.quantile(np.concatenate(accelerations), _STEADY_SHARE)
        return accelerations[0] <= limit, accelerations[1] <= limit

    def candidate_edges(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Return source, target and cost of the transitions to consider, sorted as `Transitions`.

        From each segment, they lead to the nearest segments, and at cost 0 to its successor in the
        clip. Raise ValueError if there are only successors.
        """
        sources, targets = self.nearest()
        if not len(sources):
            raise ValueError(
                "segments must have equal foot contacts at their ends, got none: add clips"
            )
        costs = transition_costs(self.ends, self.starts, sources, targets)
        successor_of = np.flatnonzero(self.has_successor)
        sources = np.concatenate([sources, successor_of])
        targets = np.concatenate([targets, successor_of + 1])
        costs = np.concatenate([costs, np.zeros(len(successor_of))])
        order = np.lexsort((targets, sources))
        return sources[order], targets[order], costs[order]

    def nearest(self) -> tuple[IntArray, IntArray]:
        """Return pairs of each segment and the nearest allowed ones with equal foot contacts."""
        starts, ends, (steady_starts, steady_ends) = self.starts, self.ends, self.steady
        end_points, start_points = (
            own.feature_points().astype(np.float32) for own in (ends, starts)
        )
        patterns = np.unique(np.concatenate([starts.contacts, ends.contacts]), axis=0)
        sources, targets = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for pattern in patterns:
            leaving = np.flatnonzero((ends.contacts == pattern).all(axis=1) & steady_ends)
            entering = np.flatnonzero((starts.contacts == pattern).all(axis=1) & steady_starts)
            if not len(entering):
                continue
            squares = (start_points[entering] ** 2).sum(axis=1)
            size = max(_MAX_CHUNK // len(entering), 1)
            for rows in np.split(leaving, range(size, len(leaving), size)):
                distances = squares - 2.0 * (end_points[rows] @ start_points[entering].T)
                distances[~self.is_allowed(rows[:, None], entering[None, :])] = np.inf
                count = min(_MAX_SUCCESSORS, len(entering))
                columns = np.argpartition(distances, count - 1, axis=1)[:, :count]
                row, index = np.nonzero(np.isfinite(np.take_along_axis(distances, columns, axis=1)))
                sources.append(rows[row])
                targets.append(entering[columns[row, index]])
        return np.concatenate(sources), np.concatenate(targets)

    def cheap_cost(self) -> float:
        """Return the cost that the cheapest tenth of all allowed pairs does not exceed."""
        n, (steady_starts, steady_ends) = len(self.starts.poses), self.steady
        if n * n <= _MAX_SAMPLED_PAIRS:
            i, j = (indices.ravel() for indices in np.indices((n, n)))
        else:
            i, j = np.random.default_rng(0).integers(n, size=(2, _MAX_SAMPLED_PAIRS))
        allowed = self.is_allowed(i, j) & steady_ends[i] & steady_starts[j]
        allowed &= (self.ends.contacts[i] == self.starts.contacts[j]).all(axis=1)
        costs = transition_costs(self.ends, self.starts, i[allowed], j[allowed])
        return float(np.quantile(costs, _CHEAPEST_SHARE)) if len(costs) else 0.0

    def root_changes(
        self, sources: IntArray, targets: IntArray, up: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return `yaw_changes` and `seam_displacements` of the edges; see `Transitions`."""
        starts, ends = self.starts, self.ends
        difference = rotations.multiply(
            ends.root_rotations[sources], rotations.inverse(starts.root_rotations[targets])
        )
        heading = rotations.twist(difference, up)
        next_steps, next_faded = (
            np.hstack([rotations.rotate(heading, steps[targets, :3]), steps[targets, 3:]])
            for steps in (starts.steps, starts.faded_steps)
        )
        added = ends.weight_sums[sources, None] * next_steps - ends.faded_steps[sources]
        added += starts.weight_sums[targets, None] * ends.steps[sources] - next_faded
        added[self.is_successor(sources, targets)] = 0.0
        return rotations.log(heading)[:, up] + added[:, 3], added[:, :3]


def _exits(
    sources: IntArray, costs: FloatArray, is_edge: BoolArray, seconds: FloatArray
) -> BoolArray:
    """Return which transitions to add to runs of segments with only one transition each.

    Such a run is divided into intervals of 2 s. To every interval except the first, the cheapest
    transition that is not allowed yet is added, if its cost is at most 60°. `is_edge` marks the
    transitions allowed so far; `seconds` has the duration of every segment.
    """
    has_choice = np.bincount(sources[is_edge], minlength=len(seconds)) != 1
    stops = np.cumsum(seconds)
    last_choice = np.maximum.accumulate(np.where(has_choice, stops, 0.0))
    period = (stops - last_choice) // _EXIT_SECONDS
    begins = np.append(True, (np.diff(period) != 0) | (np.diff(last_choice) != 0))
    group = np.cumsum(begins)[sources]
    further = np.flatnonzero(~is_edge & (costs <= _MAX_EXIT_COST) & (period[sources] >= 1))
    further = further[np.lexsort((costs[further], group[further]))]
    _, cheapest = np.unique(group[further], return_index=True)
    is_exit = np.zeros(len(sources), bool)
    is_exit[further[cheapest]] = True
    return is_exit


def largest_strong_component(n: int, sources: IntArray, targets: IntArray) -> IntArray:
    """Return the nodes of the largest strongly connected component of a graph, ascending.

    In such a component, every node is reachable from every other one. The graph has the nodes 0 to
    `n` - 1. Its edges lead from `sources` to `targets` and are sorted by source. Of components of
    the same size, the one that is found first is returned. The algorithm is that of Gabow
    (Path-based depth-first search for strong and biconnected components, 2000), without recursion.
    """
    bounds = np.searchsorted(sources, np.arange(1, n))
    successors = [iter(own.tolist()) for own in np.split(targets, bounds)]
    order = [-1] * n  # position in `path`; -1 before a visit, n in a component that is complete
    path: list[int] = []
    roots: list[int] = []  # first nodes of the components that are not complete
    largest: list[int] = []
    for start in range(n):
        visits = [start] if order[start] < 0 else []
        while visits:
            node = visits[-1]
            if order[node] < 0:
                order[node] = len(path)
                path.append(node)
                roots.append(node)
            for other in successors[node]:
                if order[other] < 0:
                    visits.append(other)
                    break
                while order[roots[-1]] > order[other]:
                    roots.pop()
            else:
                visits.pop()
                if roots[-1] == node:
                    roots.pop()
                    component = path[order[node] :]
                    del path[order[node] :]
                    for own in component:
                        order[own] = n
                    largest = max(largest, component, key=len)
    return np.array(sorted(largest), np.int64)
