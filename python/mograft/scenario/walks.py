"""Which base segments, in which order: new base motion from captured pieces (paper, 4.4)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray, as_floats, as_indices, make_read_only
from mograft._util.validate import as_integer
from mograft.body.mass import mass_model
from mograft.library.library import Library
from mograft.scenario.transition_graph import Transitions, transitions

__all__ = ["Scenario", "Transitions", "fill", "follow", "to_beats", "transitions", "walk"]

_APART = 2
_TABLE = 1 << 29
"""Chances, one for each frame and segment, that are kept at most: two gigabytes, and twice that."""
_WARP = 0.15
"""By which part of their length segments may be stretched to meet a beat."""
_BEAM = 2048
_TURNS = 8
_STRAY, _REST = 3.0, 2.0
"""Radians per skeleton height beside a path and height gone, and per height that is left of it.
So going on is worth its price up to two thirds of a height beside it."""
_STROLL = 0.25
"""Heights a second: slower segments do not travel. People who walk make about 0.8."""
_DAWDLING = 10.0
"""Times as long as at the pace of segments that travel: a way along a path takes no longer."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """Base segments in order, how long each lasts, and where the first one starts.

    Parameters
    ----------
    segments : array_like of int, shape (n,)
        Segments of a library, one after the other.
    lengths : array_like of int, shape (n,), optional
        Intervals that each lasts. Default: as long as it is.
    place : array_like, shape (3,), optional
        Where the root's first frame is to be, over the floor, in the file's unit; its height
        is its own. Default: where it was captured.
    turn : float
        Radians by which the first segment is turned about up.

    Raises
    ------
    ValueError
        If there is no segment, the lengths are not as many, one is below 1, or a number is not
        finite.

    Examples
    --------
    >>> Scenario([3, 4, 0], turn=0.5)
    Scenario(3 segments)
    """

    segments: IntArray
    lengths: IntArray | None = None
    place: FloatArray | None = None
    turn: float = 0.0

    def __post_init__(self) -> None:
        segments = as_indices("segments", self.segments, ("n",)).copy()
        if not len(segments):
            raise ValueError("segments must hold at least one, got none")
        make_read_only(segments)
        object.__setattr__(self, "segments", segments)
        object.__setattr__(self, "turn", float(as_floats("turn", self.turn, ())))
        if self.lengths is not None:
            lengths = as_indices("lengths", self.lengths, (len(segments),)).copy()
            if (lengths < 1).any():
                raise ValueError(f"lengths must be at least 1, got {lengths.min()}")
            make_read_only(lengths)
            object.__setattr__(self, "lengths", lengths)
        if self.place is not None:
            place = as_floats("place", self.place, (3,)).copy()
            make_read_only(place)
            object.__setattr__(self, "place", place)

    def __repr__(self) -> str:
        return f"Scenario({len(self.segments)} segments)"


def walk(
    library: Library, duration: float, seed: int = 0, *, graph: Transitions | None = None
) -> IntArray:
    """Walk at random from base segment to base segment.

    Parameters
    ----------
    library : Library
        Where the segments come from.
    duration : float
        Seconds that the segments should last together; they last up to one segment longer.
    seed : int
        Another seed, another walk.
    graph : Transitions, optional
        To walk several times without finding them anew.

    Returns
    -------
    ndarray of int
        Segments of the library, for `graft`.

    Raises
    ------
    ValueError
        If the duration is not above 0, the seed is no whole number from 0, or there is
        nowhere to walk; see `transitions`.

    Notes
    -----
    The cheaper a transition the likelier, as exp(-cost / 5°); every time that a segment was
    there makes it e times less likely, lest a walk stays where someone stands. A segment comes
    back after two others at the earliest, where there is a choice.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> chosen = walk(library, 10.0, seed=3)
    >>> bool(library.segments.lengths[chosen].sum() >= 300)
    True
    """
    if isinstance(duration, bool) or not as_floats("duration", duration, ()) > 0.0:
        raise ValueError(f"duration must be above 0 seconds, got {duration!r}")
    rng = _chance(seed)
    graph = transitions(library) if graph is None else graph
    chances = graph.chances()
    lengths = library.segments.lengths[graph.segments]
    wanted = duration * library.rate
    way, uses = _begun(int(rng.integers(len(lengths))), len(lengths))
    frames = int(lengths[way[-1]])
    while frames < wanted:
        near = graph.after(way[-1])
        frames += int(lengths[_go_on(rng, graph.to[near], chances[near], way, uses)])
    return graph.segments[way]


def fill(
    library: Library, frames: int, seed: int = 0, *, graph: Transitions | None = None
) -> IntArray:
    """Walk at random for exactly so many frames.

    Parameters
    ----------
    library : Library
        Where the segments come from.
    frames : int
        Frames that the motion is to have, at the library's rate.
    seed : int
        Another seed, another walk.
    graph : Transitions, optional
        To walk several times without finding them anew.

    Returns
    -------
    ndarray of int
        Segments of the library, for `graft`; no one is stretched.

    Raises
    ------
    ValueError
        If no row of segments has so many frames, with the nearest number that one has; if
        `frames` is no whole number from 2 or too many, the seed none from 0, or there is nowhere
        to walk.

    Notes
    -----
    The walk is that of `walk` under the condition that a segment ends with the last frame: how
    likely that is from every segment, for every number of frames that may be left, is found
    backwards; the walk is then drawn forwards by these.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> int(library.segments.lengths[fill(library, 301)].sum())
    300
    """
    wanted = as_integer("frames", frames, 2) - 1
    rng = _chance(seed)
    graph = transitions(library) if graph is None else graph
    _check_size(wanted, graph)
    lengths = library.segments.lengths[graph.segments]
    steps = _Steps.of(graph)
    most = int(lengths.max())
    # By frames left: how likely a walk that starts with a segment ends with the last of them.
    ends = np.zeros((wanted + most + 1, len(lengths)), np.float32)
    after = np.zeros_like(ends)
    after[0] = 1.0
    for left in range(1, len(ends)):
        fits = lengths <= left
        ends[left, fits] = after[left - lengths[fits], fits]
        after[left] = steps.ahead(ends[left])
        if left == wanted and ends[left].any():
            break
    if not ends[wanted].any():
        can = np.flatnonzero(ends.any(axis=1))
        nearest = int(can[np.abs(can - wanted).argmin()]) + 1
        raise ValueError(f"no row of segments has {frames} frames; the nearest has {nearest}")
    way, uses = _begun(int(rng.choice(len(lengths), p=_shares(ends[wanted]))), len(lengths))
    left = wanted
    while left > lengths[way[-1]]:
        left -= int(lengths[way[-1]])
        near = graph.after(way[-1])
        to = graph.to[near]
        _go_on(rng, to, steps.chances[near] * ends[left, to], way, uses)
    return graph.segments[way]


def to_beats(
    library: Library,
    beats: npt.ArrayLike,
    seed: int = 0,
    *,
    graph: Transitions | None = None,
) -> Scenario:
    """Walk at random so that the body comes to rest on every beat.

    Parameters
    ----------
    library : Library
        Where the segments come from.
    beats : array_like, shape (n_beats,)
        When beats are, in seconds, ascending: the motion starts with the first and ends with
        the last. ``np.arange(0.0, 60.0, 0.5)`` are those of a minute at 120 a minute.
    seed : int
        Another seed, another walk.
    graph : Transitions, optional
        To walk several times without finding them anew.

    Returns
    -------
    Scenario
        Segments, stretched all alike from beat to beat, by up to 15 % (and a frame).

    Raises
    ------
    ValueError
        If no row of segments can be stretched to the beats, with the beat that cannot be met;
        if the beats are fewer than two or do not ascend, the seed is no whole number from 0,
        or there is nowhere to walk.

    Notes
    -----
    A beat is where a segment ends at which the kinetic energy is least: in dance the joints
    come to rest there (Kim, Park and Shin, Rhythmic-motion synthesis based on motion-beat
    analysis, SIGGRAPH 2003). The walk is drawn as in `fill`.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> to_beats(library, np.arange(0.0, 8.0, 0.6)).lengths.sum()
    np.int64(234)
    """
    times = as_floats("beats", beats, ("n_beats",))
    if len(times) < 2 or (np.diff(times) <= 0).any():
        raise ValueError("beats must be two or more times in seconds that ascend")
    rng = _chance(seed)
    graph = transitions(library) if graph is None else graph
    lengths = library.segments.lengths[graph.segments]
    steps = _Steps.of(graph)
    _check_size(round(float(times[-1] - times[0]) * library.rate), graph)
    spans = np.diff(np.round((times - times[0]) * library.rate).astype(np.int64))
    n = len(lengths)
    # By beat: how likely a walk that starts there with a segment meets all later ones; and by
    # the frames that have passed since.
    meets = np.ones((len(spans) + 1, n), np.float32)
    passed: list[npt.NDArray[np.float32]] = []
    for beat in range(len(spans) - 1, -1, -1):
        least, most = _paces(int(spans[beat]))
        ahead = np.where(graph.rests, steps.ahead(meets[beat + 1]), 0.0).astype(np.float32)
        own = np.zeros((most + 1, n), np.float32)
        goes_on = np.zeros_like(own)
        for done in range(most - 1, -1, -1):
            then = done + lengths
            fits = then <= most
            own[done, fits] = goes_on[then[fits], fits]
            ends = (then >= least) & fits
            own[done, ends] += ahead[ends]
            goes_on[done] = steps.ahead(own[done])
        if not own[0].any():
            raise ValueError(
                f"no row of segments can be stretched by up to {_WARP:.0%} to come to rest at "
                f"the beats from {times[beat]:.4g} s on"
            )
        # Only shares count: the chance of many beats would be too small for a number.
        meets[beat] = own[0] / own[0].max()
        passed.append(own)
    passed.reverse()
    way, uses = _begun(int(rng.choice(n, p=_shares(meets[0]))), n)
    lasting: list[int] = []
    for beat, span in enumerate(spans.tolist()):
        least, most = _paces(span)
        own_lengths = [int(lengths[way[-1]])]
        while True:
            done = sum(own_lengths)
            near = graph.after(way[-1])
            to = graph.to[near]
            ending = steps.chances[near] * meets[beat + 1, to]
            going = steps.chances[near] * passed[beat][done, to]
            ending *= graph.rests[way[-1]] and done >= least
            if rng.random() * (ending.sum() + going.sum()) < ending.sum():
                break
            own_lengths.append(int(lengths[_go_on(rng, to, going, way, uses)]))
        bounds = np.round(np.cumsum([0, *own_lengths]) * (span / done)).astype(np.int64)
        lasting += np.diff(bounds).tolist()
        if beat < len(spans) - 1:
            _go_on(rng, to, ending, way, uses)
    return Scenario(graph.segments[way], np.array(lasting))


def follow(library: Library, path: npt.ArrayLike, *, graph: Transitions | None = None) -> Scenario:
    """Find the segments that go along a path on the floor.

    Parameters
    ----------
    library : Library
        Where the segments come from.
    path : array_like, shape (n_points, 2)
        Corners of the path in the file's unit, on the axes other than up in their order: x and
        z where y points up.
    graph : Transitions, optional
        To search several times without finding them anew.

    Returns
    -------
    Scenario
        It starts at the path's first point and is turned as is best for its first leg.

    Raises
    ------
    ValueError
        If the path has fewer than two different points, the segments do not get to its end in
        time, or there is nowhere to walk.

    Notes
    -----
    In time is up to ten times as long as the path and a height more take at the mean speed of
    those segments that travel, by a quarter of a height a second at least, or at this speed
    where none does.

    A beam search of 2048 rows, no two of which do the same with the same heading: the
    transitions' costs, plus for each segment's way, in skeleton heights, 3 rad per height
    between the root and the nearest point of the path, which may be ahead of that before by no
    more than twice the way. Of rows of as many segments those are kept that are cheapest with
    2 rad per height of path that is still ahead of them.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> follow(library, [[0, 0], [300, 0]]).place
    array([0., 0., 0.])
    """
    corners = as_floats("path", path, ("n_points", 2))
    keep = np.concatenate([[True], (np.diff(corners, axis=0) != 0).any(axis=1)])
    corners = corners[keep]
    if len(corners) < 2:
        raise ValueError("path must have at least two different points")
    graph = transitions(library) if graph is None else graph
    height = mass_model(library.skeleton).height
    corners = (corners - corners[0]) / height
    legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(legs)])
    floor = [axis for axis in range(3) if axis != library.up]
    ways, shifts = (
        own[:, floor] @ np.array([1.0, 1j]) / height for own in (graph.ways, graph.shifts)
    )
    # A turn about up is one from x to y, but from z to x where y points up.
    sense = -1.0 if library.up == 1 else 1.0
    n = len(ways)
    target = corners @ np.array([1.0, 1j])
    at, before = np.tile(np.arange(n), _TURNS), np.full(n * _TURNS, -1)
    began = turn = np.repeat(2 * np.pi / _TURNS * np.arange(_TURNS), n)
    spot, gone, cost = np.zeros(len(at), complex), np.zeros(len(at)), np.zeros(len(at))
    parent = np.arange(len(at))
    history: list[tuple[IntArray, IntArray]] = []
    clock, lasts = np.zeros(len(at)), library.segments.lengths[graph.segments] / library.rate
    longest = _DAWDLING * float(passed[-1] + 1.0) / _pace(np.abs(ways), lasts)
    while True:
        step = np.exp(1j * sense * turn) * ways[at]
        spot = spot + step
        gone, off = _along(target, passed, spot, gone, gone + 2.0 * np.abs(step))
        cost = cost + _STRAY * off * np.abs(step)
        clock = clock + lasts[at]
        left = passed[-1] - gone
        best = np.argsort(cost + _REST * left, kind="stable")
        best = best[clock[best] <= longest]
        if not len(best):
            raise ValueError(
                f"the segments go {gone.max() * height:.4g} along the path of "
                f"{passed[-1] * height:.4g} in {longest:.4g} s, ten times as long as segments "
                "that travel would take: add clips of someone who walks"
            )
        # Of those that do the same with the same heading only the best goes on.
        octant = np.round(turn[best] / (2 * np.pi / _TURNS)).astype(np.int64) % _TURNS
        _, alone = np.unique(at[best] * _TURNS + octant, return_index=True)
        best = best[np.sort(alone)[:_BEAM]]
        at, before, began, turn, spot = (own[best] for own in (at, before, began, turn, spot))
        gone, cost, clock, parent, left = (own[best] for own in (gone, cost, clock, parent, left))
        history.append((at, parent))
        if left[0] == 0:
            break
        counts = np.diff(graph.first)[at]
        parent = np.repeat(np.arange(len(at)), counts)
        edge = np.arange(len(parent)) + np.repeat(
            graph.first[at] - np.cumsum(counts) + counts, counts
        )
        fresh = graph.to[edge] != before[parent]
        parent, edge = (own[fresh] if fresh.any() else own for own in (parent, edge))
        before, at, began = at[parent], graph.to[edge], began[parent]
        spot = spot[parent] + np.exp(1j * sense * turn[parent]) * shifts[edge]
        turn, gone = turn[parent] + graph.turns[edge], gone[parent]
        cost, clock = cost[parent] + graph.costs[edge], clock[parent]
    way, row = [], 0
    for nodes, parents in reversed(history):
        way.append(int(nodes[row]))
        row = int(parents[row])
    place = np.zeros(3)
    place[floor] = as_floats("path", path)[0]
    return Scenario(graph.segments[way[::-1]], None, place, float(began[0]))


def _pace(ways: FloatArray, lasts: FloatArray) -> float:
    """Return the mean speed of those segments that travel, or the least that counts as one."""
    travels = ways >= _STROLL * lasts
    return float(ways[travels].sum() / lasts[travels].sum()) if travels.any() else _STROLL


def _along(
    corners: npt.NDArray[np.complex128],
    passed: FloatArray,
    spots: npt.NDArray[np.complex128],
    least: FloatArray,
    most: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return how far along a path its points nearest to spots are, within bounds, and how near."""
    best, nearest = least, np.full(len(spots), np.inf)
    for corner, leg, start, stop in zip(
        corners[:-1], np.diff(corners), passed[:-1], passed[1:], strict=True
    ):
        low, high = np.maximum(least, start), np.minimum(most, stop)
        length = stop - start
        on = start + ((spots - corner) * np.conj(leg)).real / length
        on = np.clip(on, low, np.maximum(high, low))
        off = np.abs(spots - corner - leg * ((on - start) / length))
        nearer = (off < nearest) & (low <= high)
        best, nearest = np.where(nearer, on, best), np.where(nearer, off, nearest)
    return best, nearest


@dataclass(frozen=True, eq=False)
class _Steps:
    """The walk's transitions as a matrix that is mostly empty."""

    first: IntArray
    to: IntArray
    chances: FloatArray

    @classmethod
    def of(cls, graph: Transitions) -> "_Steps":
        return cls(graph.first, graph.to, graph.chances())

    def ahead(self, values: npt.NDArray[np.float32]) -> FloatArray:
        """Return the mean of values over what may come next, by its chance; one per segment."""
        mean: FloatArray = np.add.reduceat(self.chances * values[self.to], self.first[:-1])
        return mean


def _chance(seed: int) -> np.random.Generator:
    return np.random.default_rng(as_integer("seed", seed))


def _check_size(steps: int, graph: Transitions) -> None:
    """Refuse walks whose chances, by frame and segment, would not fit in memory."""
    n = len(graph.segments)
    most = _TABLE // n
    if steps > most:
        raise ValueError(
            f"{steps + 1} frames are too many to plan among {n} segments: at most {most + 1}, or "
            "more among the segments of fewer clips"
        )


def _shares(weights: npt.NDArray[np.floating]) -> FloatArray:
    whole = weights.astype(np.float64)
    shares: FloatArray = whole / whole.sum()
    return shares


def _begun(first: int, n: int) -> tuple[list[int], IntArray]:
    """Return a walk that is at its first segment, and how often it was at each."""
    uses = np.zeros(n, np.int64)
    uses[first] = 1
    return [first], uses


def _go_on(
    rng: np.random.Generator, to: IntArray, weights: FloatArray, way: list[int], uses: IntArray
) -> int:
    """Go on to a segment by its weight; to one that was just used, only if there is no other."""
    been = uses[to]
    weights = weights * np.exp(been[weights > 0].min() - been)
    fresh = np.where(np.isin(to, way[-_APART - 1 :]), 0.0, weights)
    way.append(int(rng.choice(to, p=_shares(fresh if fresh.any() else weights))))
    uses[way[-1]] += 1
    return way[-1]


def _paces(span: int) -> tuple[int, int]:
    """Return the least and the most frames that can be stretched to a beat's."""
    return int(np.ceil(span / (1.0 + _WARP))), int(np.floor(span / (1.0 - _WARP)))
