"""Which base segments, in which order: new base motion from captured pieces (paper, 4.4)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mograft import rotations
from mograft._arrays import BoolArray, FloatArray, IntArray, as_floats, as_indices, frozen
from mograft.anatomy import feature_joints
from mograft.body import body
from mograft.footskate import contacts, foot_heights, legs, plant_feet
from mograft.library import Library
from mograft.motion import Motion
from mograft.planning import take
from mograft.seams import TURNS
from mograft.segmentation import Segments, gaussian, kinetic_energy
from mograft.transplant import recombine, states, transplant
from mograft.travel import fading, turns

__all__ = ["Scenario", "Transitions", "fill", "follow", "to_beats", "transitions", "walk"]

_TILT, _HEIGHT, _VELOCITY = 1.0, 2.0, 0.1
"""Radians per radian of the root's tilt, per skeleton height, and per radian a second."""
_NEAREST = 0.1
_WIDEST = np.radians(25.0)
_SHARE = 0.5
"""Share of all segments that must be left; else wider transitions are allowed, up to this."""
_WIDEST_OF_ALL = np.radians(45.0)
_CHOOSY = np.radians(5.0)
_APART = 2
_FEWEST = 4
_FOLLOWERS = 64
"""Segments that are looked at after each, at most: the nearest. Their number, not that of all
pairs, is what a graph takes in memory."""
_MOST = 100_000
"""Segments that a graph may be found of: every pair is looked at once, if only coarsely."""
_PAIRS = 200_000
"""Pairs that the cheapest tenth is told from."""
_CHUNK = 1 << 22
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
        frozen(segments)
        object.__setattr__(self, "segments", segments)
        object.__setattr__(self, "turn", float(as_floats("turn", self.turn, ())))
        if self.lengths is not None:
            lengths = as_indices("lengths", self.lengths, (len(segments),)).copy()
            if (lengths < 1).any():
                raise ValueError(f"lengths must be at least 1, got {lengths.min()}")
            frozen(lengths)
            object.__setattr__(self, "lengths", lengths)
        if self.place is not None:
            place = as_floats("place", self.place, (3,)).copy()
            frozen(place)
            object.__setattr__(self, "place", place)

    def __repr__(self) -> str:
        return f"Scenario({len(self.segments)} segments)"


@dataclass(frozen=True, eq=False)
class Transitions:
    """Which base segments may follow which; made by `transitions`.

    Attributes
    ----------
    segments : ndarray of int, shape (n,)
        The segments, ascending: from each of them all others can be reached.
    first : ndarray of int, shape (n + 1,)
        Where the transitions from each begin in `to` and `costs`; in the end their number.
    to : ndarray of int, shape (m,)
        What each leads to, as a place in `segments`; ascending for each.
    costs : ndarray, shape (m,)
        What each costs, in radians; 0 to a segment's own successor in its clip.
    limit : float
        The greatest cost that was allowed.
    ways : ndarray, shape (n, 3)
        Each segment's way over the floor from its first frame to its last, as captured.
    turns : ndarray, shape (m,)
        By what angle about up the next segment is turned more than the one before, to go on
        from the heading that it comes to.
    shifts : ndarray, shape (m, 3)
        By how much farther the root gets over the floor than on the two segments' ways, for
        its velocity fades from the one's to the other's; turned as the one was captured.
    rests : ndarray of bool, shape (n,)
        Whether a segment ends where the kinetic energy is least: there a beat may be.
    """

    segments: IntArray
    first: IntArray
    to: IntArray
    costs: FloatArray
    limit: float
    ways: FloatArray
    turns: FloatArray
    shifts: FloatArray
    rests: BoolArray

    def __repr__(self) -> str:
        return f"Transitions({len(self.segments)} segments, {len(self.to)} transitions)"

    @property
    def source(self) -> IntArray:
        """What each transition leads from, as a place in `segments`, shape (m,)."""
        return np.repeat(np.arange(len(self.segments)), np.diff(self.first))

    def after(self, place: int) -> slice:
        """Return the transitions from a segment, as a slice of `to` and `costs`."""
        return slice(int(self.first[place]), int(self.first[place + 1]))

    def chances(self) -> FloatArray:
        """Return how likely a walk takes each transition: as exp(-cost / 5°), shape (m,)."""
        weights = np.exp(-self.costs / _CHOOSY)
        shares: FloatArray = weights / np.add.reduceat(weights, self.first[:-1])[self.source]
        return shares


def transitions(library: Library, clips: Sequence[str] | str | None = None) -> Transitions:
    """Find which base segments may follow which.

    Parameters
    ----------
    library : Library
        Where the segments come from.
    clips : str or sequence of str, optional
        Names of the clips, or globs of these, to take segments from. Default: all. Each is
        read once.

    Returns
    -------
    Transitions
        The largest set of segments of which each can be reached from each.

    Raises
    ------
    ValueError
        If no clip has such a name, there are more than 100 000 segments, or no four of them
        can follow one another in a circle.

    Notes
    -----
    The cost is the mean joint angle between the last pose of the one and the first of the
    other, plus the root's tilt between them and twice its height (in skeleton heights), plus
    0.1 s times how these change: the mean difference of the joints' angular velocities, that of
    the root's, and twice that of the root's velocity seen from where it faces. The cheapest
    tenth up to 25° is allowed where the same feet stand, more, up to 45°, where that leaves less
    than half of the segments; a segment's own successor always is. A segment may not repeat
    itself or go back to the one before it.

    Of each segment at most the 64 nearest are looked at, by the root mean square of what the
    cost sums; a graph of many clips takes memory in proportion to them.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> transitions(Library.build(dance(strides=1).motion)).costs.min()
    np.float64(0.0)
    """
    own = _among(library, clips)
    starts, ends = _ends(library, own)
    n = len(own)
    goes_on = (np.diff(own) == 1) & (np.diff(library.segments.clip[own]) == 0)
    next_to = np.flatnonzero(goes_on)
    source, to = _near(starts, ends, goes_on)
    if not len(source):
        raise ValueError("no two segments can follow one another but as they were captured")
    costs = _costs(ends, starts, source, to)
    limit = min(_cheap(starts, ends, goes_on), _WIDEST)

    def within(limit: float) -> tuple[IntArray, IntArray, FloatArray]:
        kept = costs <= limit
        froms = np.concatenate([source[kept], next_to])
        tos = np.concatenate([to[kept], next_to + 1])
        price = np.concatenate([costs[kept], np.zeros(len(next_to))])
        order = np.lexsort((tos, froms))
        return froms[order], tos[order], price[order]

    kept = _strongest(n, *within(limit)[:2])
    while len(kept) < _SHARE * n and limit < _WIDEST_OF_ALL:
        limit *= 1.25
        kept = _strongest(n, *within(limit)[:2])
    if len(kept) < _FEWEST:
        raise ValueError(
            f"of {n} segments no {_FEWEST} can follow one another in a circle: the motion never "
            "comes back to a pose like an earlier one; more clips may"
        )
    froms, tos, price = within(limit)
    place = np.full(n, -1)
    place[kept] = np.arange(len(kept))
    inside = (place[froms] >= 0) & (place[tos] >= 0)
    froms, tos, price = froms[inside], tos[inside], price[inside]
    yaws, shifts = _led(ends, starts, froms, tos, goes_on, library.up)
    level = np.arange(3) != library.up
    return Transitions(
        own[kept],
        np.searchsorted(place[froms], np.arange(len(kept) + 1)),
        place[tos],
        price,
        limit,
        (level * (ends.places - starts.places))[kept],
        yaws,
        shifts,
        ends.rests[kept],
    )


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
    if isinstance(duration, bool) or not isinstance(duration, int | float) or not duration > 0:
        raise ValueError(f"duration must be above 0 seconds, got {duration!r}")
    rng = _chance(seed)
    graph = transitions(library) if graph is None else graph
    chances = graph.chances()
    lengths = library.segments.lengths[graph.segments]
    wanted = duration * library.rate
    way = [int(rng.integers(len(graph.segments)))]
    frames = int(lengths[way[0]])
    while frames < wanted:
        near = graph.after(way[-1])
        way.append(_drawn(rng, graph.to[near], chances[near], way))
        frames += int(lengths[way[-1]])
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
        `frames` is no whole number from 2, the seed none from 0, or there is nowhere to walk.

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
    if isinstance(frames, bool) or not isinstance(frames, int | np.integer) or frames < 2:
        raise ValueError(f"frames must be a whole number from 2, got {frames!r}")
    rng = _chance(seed)
    graph = transitions(library) if graph is None else graph
    lengths = library.segments.lengths[graph.segments]
    steps = _Steps.of(graph)
    wanted, most = int(frames) - 1, int(lengths.max())
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
    way, left = [int(rng.choice(len(lengths), p=_shares(ends[wanted])))], wanted
    while left > lengths[way[-1]]:
        left -= int(lengths[way[-1]])
        near = graph.after(way[-1])
        to = graph.to[near]
        way.append(_drawn(rng, to, steps.chances[near] * ends[left, to], way))
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
    way = [int(rng.choice(n, p=_shares(meets[0])))]
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
            way.append(_drawn(rng, to, going, way))
            own_lengths.append(int(lengths[way[-1]]))
        bounds = np.round(np.cumsum([0, *own_lengths]) * (span / done)).astype(np.int64)
        lasting += np.diff(bounds).tolist()
        if beat < len(spans) - 1:
            way.append(_drawn(rng, to, ending, way))
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
    height = body(library.skeleton).height
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


def arranged(library: Library, scenario: Scenario) -> tuple[Motion, Segments]:
    """Return the motion of segments one after the other, on its feet, and where they are in it."""
    own = take(library.segments, scenario.segments)
    stops = np.cumsum(own.lengths if scenario.lengths is None else scenario.lengths)
    cut = Segments(np.concatenate([[0], stops[:-1]]), stops)
    # Each clip is read once: a stored library's are only there while they are asked for.
    clips = {int(index): library.clips[int(index)] for index in np.unique(own.clip)}
    numbers, at = np.unique(own.clip, return_inverse=True)
    own = replace(own, clip=at)
    several = [clips[index] for index in numbers.tolist()]
    first = several[at[0]]
    n_frames = int(stops[-1]) + 1
    bare = replace(
        first,
        rotations=np.repeat(first.rotations[own.start[:1]], n_frames, axis=0),
        positions=np.repeat(first.positions[own.start[:1]], n_frames, axis=0),
        channel_values=None,
        name=f"{first.name}_scenario",
        path=None,
        repairs=(),
    )
    if scenario.place is not None or scenario.turn:
        bare = _moved(bare, scenario, library.root, library.up)
    everything = np.arange(first.n_joints)
    part = transplant(
        bare, cut, own, several, everything, library.config, root=library.root, up=library.up
    )
    motion = recombine(bare, [part], bare.name)
    if library.config.feet != "never" and len(part.seams):
        sources = [scenario.segments] * len(legs(first.skeleton))
        stood, heights = stands(library, cut, sources)
        motion, _ = plant_feet(motion, stood, heights=heights)
    return motion, cut


def stands(
    library: Library, cut: Segments, sources: Sequence[IntArray]
) -> tuple[BoolArray, FloatArray]:
    """Return when feet stand and how high they are, as in the segments that legs come from."""
    n_frames = int(cut.stop[-1]) + 1
    stood = np.empty((n_frames, len(sources), 2), bool)
    heights = np.empty((n_frames, len(sources), 2))
    known: dict[int, tuple[BoolArray, FloatArray]] = {}
    taken = library.segments
    for index, donors in enumerate(sources):
        for place, donor in enumerate(donors.tolist()):
            clip = int(taken.clip[donor])
            if clip not in known:
                own = library.clips[clip]
                known[clip] = contacts(own), foot_heights(own)
            n, m = int(cut.lengths[place]), int(taken.lengths[donor])
            frames = taken.start[donor] + (np.arange(n + 1) * m + n // 2) // n
            rows = slice(int(cut.start[place]), int(cut.stop[place]) + 1)
            stood[rows, index] = known[clip][0][frames, index]
            heights[rows, index] = known[clip][1][frames, index]
    return stood, heights


def _moved(motion: Motion, scenario: Scenario, root: int, up: int) -> Motion:
    """Return a still figure with its root turned about up and put in its place."""
    turned, placed = motion.world()
    spot, above = placed[0, root].copy(), int(motion.skeleton.parents[root])
    if scenario.place is not None:
        height = spot[up]
        spot = scenario.place.copy()
        spot[up] = height
    quat = rotations.multiply(rotations.about(np.eye(3)[up], scenario.turn), turned[0, root])
    if above >= 0:
        back = rotations.inverse(turned[0, above])
        quat = rotations.multiply(back, quat)
        spot = rotations.rotate(back, spot - placed[0, above])
    quats, places = motion.rotations.copy(), motion.positions.copy()
    quats[:, root], places[:, root] = quat, spot
    return replace(motion, rotations=quats, positions=places)


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


@dataclass(frozen=True, eq=False)
class _Ends:
    """One end of segments: the base group's pose there, and how it moves; one row each.

    `steps` (n, 4) is the root's way over the floor and its turn in the frame nearest to the
    end; `shares` is how many frames' worth of the other side's step it takes on at a seam, and
    `faded` (n, 4) what it gives up for that.
    """

    poses: FloatArray
    speeds: FloatArray
    turned: FloatArray
    tilts: FloatArray
    heights: FloatArray
    places: FloatArray
    ways: FloatArray
    turns: FloatArray
    feet: BoolArray
    rests: BoolArray
    steps: FloatArray
    shares: FloatArray
    faded: FloatArray

    def points(self) -> FloatArray:
        """Return points whose distances are the root mean squares of what the cost sums.

        Of small angles: of large ones they are less.
        """
        n, n_joints = self.poses.shape[:2]
        share = max(n_joints, 1) ** -0.5
        # The distance of two rotation matrices is √8 sin(half the angle): blind to q and -q.
        turned = rotations.rotate(self.poses[..., None, :], np.eye(3)) * (share / np.sqrt(2.0))
        tilted = rotations.rotate(self.tilts[:, None], np.eye(3)) * (_TILT / np.sqrt(2.0))
        return np.concatenate(
            [
                turned.reshape(n, -1),
                tilted.reshape(n, -1),
                self.speeds.reshape(n, -1) * (share * _VELOCITY),
                _HEIGHT * self.heights[:, None],
                _HEIGHT * _VELOCITY * self.ways,
                _TILT * _VELOCITY * self.turns,
            ],
            axis=1,
        )


def _among(library: Library, clips: Sequence[str] | str | None) -> IntArray:
    """Return the segments of some clips that may be used, ascending."""
    own = np.flatnonzero(library.is_donor)
    if clips is not None:
        wanted = [clips] if isinstance(clips, str) else list(clips)
        names = [entry.name for entry in library.entries]
        for name in wanted:
            if not any(fnmatchcase(known, name) or known == name for known in names):
                raise ValueError(f"clips must name clips of the library, got {name!r}")
        fits = [
            any(fnmatchcase(known, name) or known == name for name in wanted) for known in names
        ]
        own = own[np.array(fits, bool)[library.segments.clip[own]]]
    if len(own) > _MOST:
        raise ValueError(
            f"a graph may be found of {_MOST} segments, the library has {len(own)}: name the "
            "clips to take them from"
        )
    return own


def _ends(library: Library, own: IntArray) -> tuple[_Ends, _Ends]:
    """Return how segments start and how they end; each clip is read once, and not kept."""
    cut, skeleton, root = library.segments, library.skeleton, library.root
    members = library.joints(library.groups.base)
    joints = np.setdiff1d(feature_joints(skeleton, members), [root])
    carries = bool((members == root).any())
    inside = np.arange(0.5, np.ceil(library.config.seam_blend * library.rate))
    rows: tuple[list[_Ends], list[_Ends]] = ([], [])
    for index in np.unique(cut.clip[own]):
        clip = library.clips[int(index)]
        mine = own[cut.clip[own] == index]
        height = body(clip.skeleton).height
        quats, places = (values[:, root] for values in clip.world())
        speed = np.gradient(places, axis=0) * clip.rate
        stands = np.logical_or(*np.moveaxis(contacts(clip), 2, 0))
        config = library.config
        energy = kinetic_energy(clip, omega=config.omega, inertia=config.inertia)
        energy = gaussian(energy, config.smoothing * clip.rate)
        bounds = np.append(cut.start[cut.clip == index], clip.n_frames - 1)
        later = bounds[np.minimum(np.searchsorted(bounds, cut.stop[mine]) + 1, len(bounds) - 1)]
        yaws = turns(quats[:-1], quats[1:], library.up)
        ways = np.where(np.arange(3) == library.up, 0.0, np.diff(places, axis=0))
        velocities = np.concatenate([ways, yaws[:, None]], axis=1)
        at_rest = energy[cut.stop[mine]] < np.minimum(
            energy[cut.start[mine]], np.where(later > cut.stop[mine], energy[later], np.inf)
        )
        for side, frames, sign in zip(
            rows, (cut.start[mine], cut.stop[mine]), (1, -1), strict=True
        ):
            none = 0 * mine
            inward = frames[:, None] + sign * np.arange(len(inside)) - (sign < 0)
            beside = velocities[inward.clip(0, len(velocities) - 1)]
            lengths = cut.lengths[mine][:, None]
            before, after = fading(inside, lengths, config, library.rate)
            shares = after if sign > 0 else before
            poses, speeds = states(TURNS, [clip.rotations[:, joints]], none, frames)
            _, turning = states(TURNS, [quats[:, None]], none, frames)
            back = rotations.inverse(rotations.twist(quats[frames], library.up))
            moves = float(carries)
            side.append(
                _Ends(
                    poses,
                    speeds * library.rate,
                    quats[frames],
                    rotations.multiply(back, quats[frames])
                    if carries
                    else np.tile(rotations.IDENTITY, (len(mine), 1)),
                    moves * places[frames, library.up] / height,
                    places[frames],
                    moves * rotations.rotate(back, speed[frames]) / height,
                    moves * turning[:, 0] * library.rate,
                    stands[frames],
                    at_rest,
                    moves * beside[:, 0],
                    shares.sum(axis=1),
                    moves * (shares[..., None] * beside).sum(axis=1),
                )
            )
    starts, ends = (
        _Ends(*(np.concatenate([getattr(part, f) for part in side]) for f in _Ends.__annotations__))
        for side in rows
    )
    return starts, ends


def _led(
    ends: _Ends, starts: _Ends, i: IntArray, j: IntArray, goes_on: BoolArray, up: int
) -> tuple[FloatArray, FloatArray]:
    """Return how the root goes on from segments `i` to segments `j`: see `Transitions`."""
    apart = rotations.multiply(ends.turned[i], rotations.inverse(starts.turned[j]))
    heading = rotations.twist(apart, up)
    coming, given = (
        np.concatenate([rotations.rotate(heading, own[j, :3]), own[j, 3:]], axis=1)
        for own in (starts.steps, starts.faded)
    )
    more = ends.shares[i, None] * coming - ends.faded[i]
    more += starts.shares[j, None] * ends.steps[i] - given
    more[(j == i + 1) & np.append(goes_on, False)[i]] = 0.0
    return rotations.log(heading)[:, up] + more[:, 3], more[:, :3]


def _allowed(goes_on: BoolArray, i: IntArray, j: IntArray) -> BoolArray:
    """Tell which segments may be followed by which other than as they were captured."""
    beside = np.append(goes_on, False)
    here, back = (j == i + 1) & beside[i], (j == i - 1) & beside[j]
    allowed: BoolArray = ~(here | back | (i == j))
    return allowed


def _near(starts: _Ends, ends: _Ends, goes_on: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the pairs that are looked at: of each segment the nearest that may follow.

    That is where the same feet stand.
    """
    from_points, to_points = (own.points().astype(np.float32) for own in (ends, starts))
    stand = np.unique(np.concatenate([starts.feet, ends.feet]), axis=0)
    froms, tos = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for feet in stand:
        leave = np.flatnonzero((ends.feet == feet).all(axis=1))
        come = np.flatnonzero((starts.feet == feet).all(axis=1))
        if not len(come):
            continue
        squares = (to_points[come] ** 2).sum(axis=1)
        size = max(_CHUNK // len(come), 1)
        for i in np.split(leave, range(size, len(leave), size)):
            near = squares - 2.0 * (from_points[i] @ to_points[come].T)
            near[~_allowed(goes_on, i[:, None], come[None, :])] = np.inf
            most = min(_FOLLOWERS, len(come))
            column = np.argpartition(near, most - 1, axis=1)[:, :most]
            row, place = np.nonzero(np.isfinite(np.take_along_axis(near, column, axis=1)))
            froms.append(i[row])
            tos.append(come[column[row, place]])
    return np.concatenate(froms), np.concatenate(tos)


def _cheap(starts: _Ends, ends: _Ends, goes_on: BoolArray) -> float:
    """Return what the cheapest tenth of all pairs that are allowed costs at most."""
    n = len(starts.poses)
    if n * n <= _PAIRS:
        i, j = (own.ravel() for own in np.indices((n, n)))
    else:
        i, j = np.random.default_rng(0).integers(n, size=(2, _PAIRS))
    allowed = _allowed(goes_on, i, j) & (ends.feet[i] == starts.feet[j]).all(axis=1)
    costs = _costs(ends, starts, i[allowed], j[allowed])
    return float(np.quantile(costs, _NEAREST)) if len(costs) else 0.0


def _costs(ends: _Ends, starts: _Ends, i: IntArray, j: IntArray) -> FloatArray:
    """Return what it costs to go from segments `i` to segments `j`, in radians."""
    costs = np.zeros(len(i))
    step = max(_CHUNK // (8 * max(ends.poses.shape[1], 1)), 1)
    for first in range(0, len(i), step):
        a, b = i[first : first + step], j[first : first + step]
        own = _TILT * rotations.angle(ends.tilts[a], starts.tilts[b])
        own += _HEIGHT * np.abs(ends.heights[a] - starts.heights[b])
        if ends.poses.shape[1]:
            own += rotations.angle(ends.poses[a], starts.poses[b]).mean(axis=1)
            apart = np.linalg.norm(ends.speeds[a] - starts.speeds[b], axis=-1)
            own += _VELOCITY * apart.mean(axis=1)
        for weight, before, after in (
            (_HEIGHT, ends.ways, starts.ways),
            (_TILT, ends.turns, starts.turns),
        ):
            own += weight * _VELOCITY * np.linalg.norm(before[a] - after[b], axis=-1)
        costs[first : first + step] = own
    return costs


def _chance(seed: int) -> np.random.Generator:
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed must be a whole number from 0, got {seed!r}")
    return np.random.default_rng(seed)


def _shares(weights: npt.NDArray[np.floating]) -> FloatArray:
    whole = weights.astype(np.float64)
    shares: FloatArray = whole / whole.sum()
    return shares


def _drawn(rng: np.random.Generator, to: IntArray, weights: FloatArray, way: list[int]) -> int:
    """Draw the next segment by its weight; one that was just used, only if there is no other."""
    weights = weights * np.exp(-(np.array(way)[:, None] == to).sum(axis=0))
    fresh = np.where(np.isin(to, way[-_APART - 1 :]), 0.0, weights)
    return int(rng.choice(to, p=_shares(fresh if fresh.any() else weights)))


def _paces(span: int) -> tuple[int, int]:
    """Return the least and the most frames that can be stretched to a beat's."""
    return int(np.ceil(span / (1.0 + _WARP))), int(np.floor(span / (1.0 - _WARP)))


def _strongest(n: int, source: IntArray, to: IntArray) -> IntArray:
    """Return the largest set of nodes of which each can be reached from each (Tarjan 1972).

    The edges ascend by their sources.
    """
    bounds = np.searchsorted(source, np.arange(n + 1)).tolist()
    everyone = to.tolist()
    successors = [everyone[low:high] for low, high in pairwise(bounds)]
    order, low = [-1] * n, [0] * n
    waiting: list[int] = []
    is_waiting = [False] * n
    best: list[int] = []
    count = 0
    for first in range(n):
        if order[first] >= 0:
            continue
        stack = [(first, 0)]
        while stack:
            node, place = stack.pop()
            if place == 0:
                order[node] = low[node] = count
                count += 1
                waiting.append(node)
                is_waiting[node] = True
            for index in range(place, len(successors[node])):
                other = successors[node][index]
                if order[other] < 0:
                    stack += [(node, index + 1), (other, 0)]
                    break
                if is_waiting[other]:
                    low[node] = min(low[node], order[other])
            else:
                if low[node] == order[node]:
                    part = [waiting.pop()]
                    while part[-1] != node:
                        part.append(waiting.pop())
                    for member in part:
                        is_waiting[member] = False
                    best = part if len(part) > len(best) else best
                if stack:
                    above = stack[-1][0]
                    low[above] = min(low[above], low[node])
    return np.array(sorted(best), np.int64)
