"""Beam search for base segments whose root follows a path on the floor."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray, IntArray, as_floats
from mograft.body.mass import mass_model
from mograft.library.library import Library
from mograft.scenario.scenario import Scenario
from mograft.scenario.transition_graph import Transitions, transitions

_BEAM_WIDTH = 2048
_N_HEADINGS = 8
_OFF_PATH_WEIGHT, _REMAINING_WEIGHT = 3.0, 2.0
"""Weights, in radians: of the distance from the path times the distance walked, both in skeleton
heights; and of the remaining length of the path, in heights. Walking on the path lowers their sum
if the distance from the path is below two thirds of a height."""
_MIN_WALKING_SPEED = 0.25  # heights per second of a segment that walks; people walk at about 0.8
_MAX_DURATION_FACTOR = 10.0  # limit of the duration, as a multiple of that at mean walking speed

ComplexArray = npt.NDArray[np.complex128]


def follow(library: Library, path: npt.ArrayLike, *, graph: Transitions | None = None) -> Scenario:
    """Find segments whose root follows a path on the floor.

    Parameters
    ----------
    library : Library
        The library of the segments.
    path : array_like, shape (n_points, 2)
        Corners of the path in the unit of the library's skeleton. The columns are the two
        horizontal axes in their order: x and z if y points up.
    graph : Transitions, optional
        The transition graph of the library, to save its computation. Default: `transitions`.

    Returns
    -------
    Scenario
        The segments, and the position and turn of the first one: at the first corner, with the
        heading that gives the lowest cost.

    Raises
    ------
    ValueError
        If the path has fewer than two different points, if no segment sequence reaches its end
        within the time limit, or if the library has no transition graph; see `transitions`.

    Notes
    -----
    The time limit is ten times the time to walk the length of the path plus one skeleton height, at
    the mean speed of the segments that walk. A segment walks if its root moves over the floor by at
    least 0.25 heights per second; if no segment does, the speed is 0.25 heights per second.

    The method is a beam search of width 2048 over segment sequences. Of sequences that end with the
    same segment and heading (in steps of 45°), only the best is kept. The cost of a sequence is the
    sum of its transition costs, plus a term for each segment: 3 rad times its displacement times
    the distance between the root at its end and the nearest point of the path, both in skeleton
    heights. The nearest point never moves back along the path, and moves forward by at most twice
    the displacement. Sequences of equal numbers of segments are compared by cost plus 2 rad per
    skeleton height of remaining path.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> follow(library, [[0, 0], [300, 0]]).place
    array([0., 0., 0.])
    """
    corners = as_floats("path", path, ("n_points", 2))
    is_new = np.concatenate([[True], (np.diff(corners, axis=0) != 0).any(axis=1)])
    if is_new.sum() < 2:
        raise ValueError("`path` must have at least two different points, got 1")
    graph = transitions(library) if graph is None else graph
    nodes, turn = _PathSearch(library, graph, corners[is_new]).run()
    place = np.zeros(3)
    place[[axis for axis in range(3) if axis != library.up]] = corners[0]
    return Scenario(graph.segments[nodes], None, place, turn)


# Segment sequences of the search, one per row; lengths are in skeleton heights.
_BEAM = np.dtype(
    [
        ("node", np.int64),  # the segment
        ("previous", np.int64),  # the segment before it; -1 at the start
        ("initial_turn", float),  # rotation that places the first segment, about up, in radians
        ("turn", float),  # rotation that places the segment `node`
        ("position", complex),  # of the root
        ("progress", float),  # arc length of the nearest point of the path
        ("cost", float),
        ("seconds", float),
        ("parent", np.int64),  # row, in the previous beam, of the sequence without `node`
    ]
)
_Beam: TypeAlias = npt.NDArray[np.void]


class _PathSearch:
    """A beam search for segments that follow a path.

    Lengths are in skeleton heights, and floor positions are complex numbers.
    """

    def __init__(self, library: Library, graph: Transitions, corners: FloatArray) -> None:
        """Convert the graph and the path to skeleton heights; successive corners must differ."""
        self.graph = graph
        self.height = mass_model(library.skeleton).height
        corners = (corners - corners[0]) / self.height
        legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        self.arc_lengths = np.concatenate([[0.0], np.cumsum(legs)])
        to_complex = np.array([1.0, 1j])
        self.corners = corners @ to_complex
        floor = [axis for axis in range(3) if axis != library.up]
        self.displacements, self.seam_displacements = (
            vectors[:, floor] @ to_complex / self.height
            for vectors in (graph.displacements, graph.seam_displacements)
        )
        self.durations = library.segments.lengths[graph.segments] / library.rate
        # A rotation about the up axis goes from x to y, but from z to x if y points up.
        self.rotation_sense = -1.0 if library.up == 1 else 1.0

    def run(self) -> tuple[IntArray, float]:
        """Return the nodes of the best sequence to the path's end, and its first turn."""
        total = self.arc_lengths[-1]
        distances, speed = np.abs(self.displacements), _MIN_WALKING_SPEED
        walks = distances >= _MIN_WALKING_SPEED * self.durations
        if walks.any():
            speed = float(distances[walks].sum() / self.durations[walks].sum())
        max_seconds = _MAX_DURATION_FACTOR * float(total + 1.0) / speed
        # At the start, sequences of one segment: every segment with every heading.
        first = np.zeros((_N_HEADINGS, len(self.displacements)), _BEAM)
        first["node"], first["previous"] = np.arange(len(self.displacements)), -1
        first["turn"] = 2 * np.pi / _N_HEADINGS * np.arange(_N_HEADINGS)[:, None]
        first["initial_turn"] = first["turn"]
        beam: _Beam = first.ravel()
        history: list[_Beam] = []
        while not history or beam["progress"][0] != total:
            beam = self._expand(beam) if history else beam
            self._walk_segment(beam)
            rows = self._best_rows(beam, max_seconds)
            if not len(rows):
                reached = beam["progress"].max() * self.height
                raise ValueError(
                    f"no segment sequence follows the whole path: at most {reached:.4g} of "
                    f"{total * self.height:.4g} units in {max_seconds:.4g} s; add walking clips"
                )
            beam = beam[rows]
            history.append(beam)
        nodes, row = [], 0
        for states in reversed(history):
            nodes.append(int(states["node"][row]))
            row = int(states["parent"][row])
        return np.array(nodes[::-1]), float(beam["initial_turn"][0])

    def _rotate(self, vectors: ComplexArray, turn: FloatArray) -> ComplexArray:
        return np.exp(1j * self.rotation_sense * turn) * vectors

    def _walk_segment(self, beam: _Beam) -> None:
        """Move each sequence along its last segment, in place."""
        step = self._rotate(self.displacements[beam["node"]], beam["turn"])
        length = np.abs(step)
        beam["position"] += step
        beam["progress"], distance = self._nearest_on_path(
            beam["position"], beam["progress"], beam["progress"] + 2.0 * length
        )
        beam["cost"] += _OFF_PATH_WEIGHT * distance * length
        beam["seconds"] += self.durations[beam["node"]]

    def _best_rows(self, beam: _Beam, max_seconds: float) -> IntArray:
        """Return the rows to keep, best first: at most one for each last segment and heading."""
        remaining = self.arc_lengths[-1] - beam["progress"]
        order = np.argsort(beam["cost"] + _REMAINING_WEIGHT * remaining, kind="stable")
        order = order[beam["seconds"][order] <= max_seconds]
        heading = np.round(beam["turn"][order] / (2 * np.pi / _N_HEADINGS)).astype(np.int64)
        key = beam["node"][order] * _N_HEADINGS + heading % _N_HEADINGS
        _, first = np.unique(key, return_index=True)
        return order[np.sort(first)[:_BEAM_WIDTH]]

    def _expand(self, beam: _Beam) -> _Beam:
        """Append every possible next segment to each sequence.

        Transitions back to the segment before the last one are left out, unless all transitions of
        all sequences lead back.
        """
        graph, nodes = self.graph, beam["node"]
        counts = np.diff(graph.first_edge)[nodes]
        parent = np.repeat(np.arange(len(nodes)), counts)
        offsets = graph.first_edge[nodes] - np.cumsum(counts) + counts
        edge = np.arange(len(parent)) + np.repeat(offsets, counts)
        is_new: BoolArray = graph.targets[edge] != beam["previous"][parent]
        if is_new.any():
            parent, edge = parent[is_new], edge[is_new]
        longer = beam[parent]
        longer["position"] += self._rotate(self.seam_displacements[edge], longer["turn"])
        longer["previous"], longer["node"] = longer["node"], graph.targets[edge]
        longer["turn"] += graph.yaw_changes[edge]
        longer["cost"] += graph.costs[edge]
        longer["parent"] = parent
        return longer

    def _nearest_on_path(
        self, positions: ComplexArray, lower: FloatArray, upper: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the arc length of the path point nearest to each position, and its distance.

        Only points with arc lengths from `lower` to `upper` are compared.
        """
        best, nearest = lower, np.full(len(positions), np.inf)
        bounds = self.arc_lengths[:-1], self.arc_lengths[1:]
        legs = zip(self.corners[:-1], np.diff(self.corners), *bounds, strict=True)
        for corner, leg, start, stop in legs:
            low, high = np.maximum(lower, start), np.minimum(upper, stop)
            length = stop - start
            along = start + ((positions - corner) * np.conj(leg)).real / length
            along = np.clip(along, low, np.maximum(high, low))
            distance = np.abs(positions - corner - leg * ((along - start) / length))
            is_nearer = (distance < nearest) & (low <= high)
            best = np.where(is_nearer, along, best)
            nearest = np.where(is_nearer, distance, nearest)
        return best, nearest
