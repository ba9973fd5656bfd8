"""What may follow what: transitions between base segments that look like one motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import gaussian, kinetic_energy
from mograft.blend.donor_timeline import sample_states
from mograft.blend.root_motion import root_velocity_weights, yaw_rates
from mograft.blend.value_spaces import ROTATIONS
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import detect_contacts
from mograft.body.mass import mass_model
from mograft.library.library import Library
from mograft.motion import rotations

__all__ = ["Transitions", "transitions"]

_TILT, _HEIGHT, _VELOCITY = 1.0, 2.0, 0.1
"""Radians per radian of the root's tilt, per skeleton height, and per radian a second."""
_NEAREST = 0.1
_WIDEST = np.radians(25.0)
_SHARE = 0.5
"""Share of all segments that must be left; else wider transitions are allowed, up to this."""
_WIDEST_OF_ALL = np.radians(45.0)
_CHOOSY = np.radians(5.0)
_FEWEST = 4
_FOLLOWERS = 64
"""Segments that are looked at after each, at most: the nearest. Their number, not that of all
pairs, is what a graph takes in memory."""
_MOST = 100_000
"""Segments that a graph may be found of: every pair is looked at once, if only coarsely."""
_PAIRS = 200_000
"""Pairs that the cheapest tenth is told from."""
_CHUNK = 1 << 22


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
        height = mass_model(clip.skeleton).height
        quats, places = (values[:, root] for values in clip.world_transforms())
        speed = np.gradient(places, axis=0) * clip.rate
        stands = np.logical_or(*np.moveaxis(detect_contacts(clip), 2, 0))
        config = library.config
        energy = kinetic_energy(clip, omega=config.omega, inertia=config.inertia)
        energy = gaussian(energy, config.smoothing * clip.rate)
        bounds = np.append(cut.start[cut.clip == index], clip.n_frames - 1)
        later = bounds[np.minimum(np.searchsorted(bounds, cut.stop[mine]) + 1, len(bounds) - 1)]
        yaws = yaw_rates(quats, library.up)
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
            before, after = root_velocity_weights(inside, lengths, config, library.rate)
            shares = after if sign > 0 else before
            poses, speeds = sample_states(ROTATIONS, [clip.rotations[:, joints]], none, frames)
            _, turning = sample_states(ROTATIONS, [quats[:, None]], none, frames)
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
