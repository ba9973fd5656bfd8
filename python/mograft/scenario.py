"""Which base segments, in which order: new base motion from captured pieces (paper, 4.4)."""

from dataclasses import dataclass

import numpy as np

from mograft import rotations
from mograft._arrays import BoolArray, FloatArray, IntArray
from mograft.anatomy import feature_joints
from mograft.body import body
from mograft.footskate import contacts
from mograft.library import Library
from mograft.seams import TURNS
from mograft.substitution import pose_gaps
from mograft.transplant import states

__all__ = ["Transitions", "transitions", "walk"]

_TILT, _HEIGHT, _VELOCITY = 1.0, 2.0, 0.1
"""Radians per radian of the root's tilt, per skeleton height, and per radian a second."""
_NEAREST = 0.1
_WIDEST = np.radians(25.0)
_SHARE = 0.1
"""Share of all segments that must be left; else wider transitions are allowed, up to this."""
_WIDEST_OF_ALL = np.radians(45.0)
_CHOOSY = np.radians(5.0)
_APART = 2
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class Transitions:
    """Which base segments may follow which; made by `transitions`.

    Attributes
    ----------
    segments : ndarray of int
        The segments, ascending: from each of them all others can be reached.
    costs : ndarray, shape (n, n)
        What it costs to go from one to another, in radians; infinite where it is not allowed,
        0 to a segment's own successor in its clip.
    limit : float
        The greatest cost that was allowed.
    """

    segments: IntArray
    costs: FloatArray
    limit: float

    def __repr__(self) -> str:
        edges = int(np.isfinite(self.costs).sum())
        return f"Transitions({len(self.segments)} segments, {edges} transitions)"


def transitions(library: Library) -> Transitions:
    """Find which base segments may follow which.

    Parameters
    ----------
    library : Library
        Where the segments come from.

    Returns
    -------
    Transitions
        The largest set of segments of which each can be reached from each.

    Raises
    ------
    ValueError
        If no four segments can follow one another in a circle.

    Notes
    -----
    The cost is the mean joint angle between the last pose of the one and the first of the
    other, plus the root's tilt between them and twice its height (in skeleton heights), plus
    0.1 s times how these change: the mean difference of the joints' angular velocities, that of
    the root's, and twice that of the root's velocity seen from where it faces. The cheapest
    tenth up to 25° is allowed where the same feet stand, more, up to 45°, where that leaves less
    than a tenth of the segments; a segment's own successor always is. A segment may not repeat
    itself or go back to the one before it.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> transitions(Library.build(dance(strides=1).motion)).costs.min()
    np.float64(0.0)
    """
    costs = _costs(library)
    cut = library.segments
    n = len(cut)
    follows = np.zeros((n, n), bool)
    at = np.arange(n - 1)
    goes_on = cut.clip[1:] == cut.clip[:-1]
    follows[at[goes_on], at[goes_on] + 1] = True
    allowed = library.is_donor[None, :] & library.is_donor[:, None] & ~follows
    allowed &= _same_feet(library)
    allowed[np.arange(n), np.arange(n)] = False
    allowed[at[goes_on] + 1, at[goes_on]] = False
    if not allowed.any():
        raise ValueError("no two segments can follow one another but as they were captured")
    follows &= library.is_donor[None, :] & library.is_donor[:, None]
    limit = min(float(np.quantile(costs[allowed], _NEAREST)), _WIDEST)
    kept = _strongest(follows | (allowed & (costs <= limit)))
    while len(kept) < _SHARE * n and limit < _WIDEST_OF_ALL:
        limit *= 1.25
        kept = _strongest(follows | (allowed & (costs <= limit)))
    costs = np.where(allowed & (costs <= limit), costs, np.inf)
    costs[follows] = 0.0
    if len(kept) < _FEWEST:
        raise ValueError(
            f"of {n} segments no {_FEWEST} can follow one another in a circle: the motion never "
            "comes back to a pose like an earlier one; more clips may"
        )
    return Transitions(kept, costs[np.ix_(kept, kept)], limit)


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
    The cheaper a transition the likelier, as exp(-cost / 5°). A segment comes back after two
    others at the earliest, where there is a choice.

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
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed must be a whole number from 0, got {seed!r}")
    graph = transitions(library) if graph is None else graph
    rng = np.random.default_rng(seed)
    lengths = library.segments.lengths[graph.segments]
    wanted = duration * library.rate
    at = int(rng.integers(len(graph.segments)))
    way = [at]
    frames = int(lengths[at])
    while frames < wanted:
        weights = np.exp(-graph.costs[at] / _CHOOSY)
        fresh = weights.copy()
        fresh[way[-_APART - 1 :]] = 0.0
        weights = fresh if fresh.any() else weights
        at = int(rng.choice(len(weights), p=weights / weights.sum()))
        way.append(at)
        frames += int(lengths[at])
    return graph.segments[way]


def _costs(library: Library) -> FloatArray:
    """Return what it costs to go from each segment to each other, in radians."""
    cut = library.segments
    skeleton = library.skeleton
    members = library.joints(library.groups.base)
    joints = np.setdiff1d(feature_joints(skeleton, members), [library.root])
    tracks = [clip.rotations[:, joints] for clip in library.clips]
    ends, leaving = states(TURNS, tracks, cut.clip, cut.stop)
    starts, arriving = states(TURNS, tracks, cut.clip, cut.start)
    costs = pose_gaps(ends, starts) if len(joints) else np.zeros((len(cut), len(cut)))
    if len(joints):
        for index, velocity in enumerate(leaving):
            apart = np.linalg.norm(arriving - velocity, axis=-1).mean(axis=-1)
            costs[index] += _VELOCITY * library.rate * apart
    if library.root in members:
        tilts, heights, ways, turns = [], [], [], []
        for frames in (cut.stop, cut.start):
            turned = np.empty((len(cut), 1, 4))
            height = np.empty(len(cut))
            way, turn = np.empty((len(cut), 3)), np.empty((len(cut), 3))
            for index, clip in enumerate(library.clips):
                own = cut.of_clip(index)
                quats, places = (values[:, library.root] for values in clip.world())
                speed = np.gradient(places, axis=0)[frames[own]] * clip.rate
                turn[own] = states(TURNS, [quats[:, None]], 0 * own, frames[own])[1][:, 0]
                quats, places = quats[frames[own]], places[frames[own]]
                back = rotations.inverse(rotations.twist(quats, library.up))
                turned[own, 0] = rotations.multiply(back, quats)
                way[own] = rotations.rotate(back, speed) / body(clip.skeleton).height
                height[own] = places[:, library.up] / body(clip.skeleton).height
            tilts.append(turned)
            heights.append(height)
            ways.append(way)
            turns.append(turn * library.rate)
        costs = costs + _TILT * pose_gaps(*tilts)
        costs += _HEIGHT * np.abs(heights[0][:, None] - heights[1][None, :])
        for weight, velocity in ((_HEIGHT, ways), (_TILT, turns)):
            apart = np.linalg.norm(velocity[0][:, None] - velocity[1][None, :], axis=-1)
            costs += weight * _VELOCITY * apart
    return costs


def _same_feet(library: Library) -> BoolArray:
    """Tell between which ends and starts the same feet stand."""
    cut = library.segments
    stands = [contacts(clip).any(axis=2) for clip in library.clips]
    ends = np.stack([stands[c][f] for c, f in zip(cut.clip, cut.stop, strict=True)])
    starts = np.stack([stands[c][f] for c, f in zip(cut.clip, cut.start, strict=True)])
    same: BoolArray = (ends[:, None] == starts[None, :]).all(axis=2)
    return same


def _strongest(edges: BoolArray) -> IntArray:
    """Return the largest set of nodes of which each can be reached from each (Tarjan 1972)."""
    n = len(edges)
    successors = [np.flatnonzero(row).tolist() for row in edges]
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
                    part = waiting[waiting.index(node) :]
                    del waiting[len(waiting) - len(part) :]
                    for member in part:
                        is_waiting[member] = False
                    best = part if len(part) > len(best) else best
                if stack:
                    above = stack[-1][0]
                    low[above] = min(low[above], low[node])
    return np.array(sorted(best), np.int64)
