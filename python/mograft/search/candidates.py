"""Which segments may take whose place, and which of them do (paper, 4.4)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.config import Config
from mograft.motion import rotations
from mograft.search.viterbi import Trellis

__all__ = [
    "INFEASIBLE_PENALTY",
    "Candidate",
    "Candidates",
    "DonorTrellis",
    "SegmentPool",
    "cheapest",
    "choose",
    "count_combinations",
    "donor_costs",
    "length_fits",
    "pose_gaps",
    "reachable",
    "seam_costs",
    "velocity_gaps",
]

INFEASIBLE_PENALTY = 1e3
"""Cost of missing a limit: more than any row of donors within the limits costs at a seam."""

_PAIRS = 512
"""Seams that are looked at to see what is typical."""


def length_fits(base: IntArray, donor: IntArray, rate: float, config: Config) -> BoolArray:
    """Tell where a donor's length is near enough to a base segment's (eq. 19).

    Parameters
    ----------
    base, donor : ndarray of int
        Lengths in intervals; the shapes broadcast.
    rate : float
        Frames per second.
    config : Config
        Gives `max_stretch` and `length_slack`.

    Returns
    -------
    ndarray of bool
        |base - donor| < max_stretch · base, strictly, as printed; with a slack,
        ≤ max(max_stretch · base, slack). The base's length is the measure, so that a may
        take b's place where b may not take a's.
    """
    gap = np.abs(base - donor)
    limit = config.max_stretch * base
    tiny = 1e-9 * base
    fits: BoolArray = gap < limit - tiny
    if config.length_slack > 0:
        fits = gap <= np.maximum(limit, config.length_slack * rate) + tiny
    return fits


def pose_gaps(ends: FloatArray, starts: FloatArray) -> FloatArray:
    """Return the mean joint angle between every end pose and every start pose.

    Parameters
    ----------
    ends : ndarray, shape (n_ends, n_joints, 4)
        Local rotations in the last frames of some segments.
    starts : ndarray, shape (n_starts, n_joints, 4)
        Local rotations in the first frames of others.

    Returns
    -------
    ndarray, shape (n_ends, n_starts)
        Angles in radians, 0 to π.
    """
    return _core.pose_gaps(np.ascontiguousarray(ends), np.ascontiguousarray(starts))


def velocity_gaps(ends: FloatArray, starts: FloatArray) -> FloatArray:
    """Return the mean difference of joint velocities between every end and every start.

    Parameters
    ----------
    ends : ndarray, shape (n_ends, n_joints, 3)
        Angular velocities, in each joint's own frame, where some segments end.
    starts : ndarray, shape (n_starts, n_joints, 3)
        Those where others start.

    Returns
    -------
    ndarray, shape (n_ends, n_starts)
        In the velocities' unit.
    """
    return _core.velocity_gaps(np.ascontiguousarray(ends), np.ascontiguousarray(starts))


def donor_costs(
    own: IntArray, donors: IntArray, apart: FloatArray, is_own: BoolArray, config: Config
) -> FloatArray:
    """Return what donors cost by themselves, seams apart; see `DonorTrellis.build`.

    Parameters
    ----------
    own, donors : ndarray of int, shape (n,)
        Lengths of base segments and of donors for them, in intervals.
    apart : ndarray, shape (n,)
        How far their base parts are apart, in greatest distances within a cluster.
    is_own : ndarray of bool, shape (n,)
        Whether a donor is the base segment itself.
    config : Config
        Gives the weights.

    Returns
    -------
    ndarray, shape (n,)
        The costs.
    """
    if config.choice == "nearest":
        return np.where(is_own, INFEASIBLE_PENALTY, apart)
    ratio = np.minimum(own, donors) / np.maximum(own, donors)
    costs = config.length_weight * (1.0 - ratio) + config.distance_weight * apart
    return costs - np.where(is_own, 0.0, config.novelty)


def seam_costs(angles: FloatArray, speeds: FloatArray, config: Config) -> FloatArray:
    """Return what seams cost; see `DonorTrellis.build`.

    Parameters
    ----------
    angles : ndarray
        Mean joint angles, in radians.
    speeds : ndarray, shape of `angles`
        Mean differences of joint velocities, in radians per second.
    config : Config
        Gives the scales and the limit.

    Returns
    -------
    ndarray, shape of `angles`
        The costs.
    """
    costs = np.where(angles > config.max_angle, INFEASIBLE_PENALTY, 0.0)
    if config.choice != "nearest":
        costs += (angles / config.angle_scale) ** 2 + (speeds / config.velocity_scale) ** 2
    return costs


def cheapest(costs: FloatArray, is_own: BoolArray, config: Config) -> IntArray:
    """Return which `max_candidates` donors are looked at, ascending; of equals the first.

    The base segment itself stays whatever it costs: with it no seam need be beyond the limit.
    """
    order = np.lexsort((costs, ~is_own))[: config.max_candidates]
    order.sort()
    return order


@dataclass(frozen=True)
class Candidate:
    """A member of a base segment's cluster, and what it costs to use it.

    Attributes
    ----------
    segment : int
        Its index.
    clip, start, stop : int
        Its clip, first and last frame.
    stretch : float
        By which part of the base segment's length its own differs.
    gap_before, gap_after : float
        Mean joint angle, in radians, at its seams with the base segment's own neighbours; 0
        where there is none.
    distance : float
        Between the two base parts, as the clustering sees them; NaN where nothing was
        compared.
    refused : str
        Why it may not be used, with the limit and by how much it is missed; empty where it may.
    cost : float
        What it costs beside the base segment's own neighbours, by itself and at both seams;
        NaN where nothing was said of costs.
    """

    segment: int
    clip: int
    start: int
    stop: int
    stretch: float
    gap_before: float
    gap_after: float
    distance: float
    refused: str
    cost: float = float("nan")


@dataclass(frozen=True)
class Candidates:
    """What may take one segment's place, and why the rest may not.

    Attributes
    ----------
    allowed : tuple of Candidate
        The donors that pass, nearest first; the segment itself is the first of them.
    refused : tuple of Candidate
        Members of its cluster that do not pass.
    elsewhere : int
        How many segments are of another cluster.
    """

    allowed: tuple[Candidate, ...]
    refused: tuple[Candidate, ...]
    elsewhere: int

    def __len__(self) -> int:
        return len(self.allowed)

    def __repr__(self) -> str:
        numbers = f"{len(self.allowed)} allowed, {len(self.refused)} refused"
        return f"Candidates({numbers}, {self.elsewhere} of other clusters)"


@dataclass(frozen=True, eq=False)
class SegmentPool:
    """All segments that are at hand, as the search sees them for one grafted group.

    Attributes
    ----------
    segments : Segments
        The segments.
    labels : ndarray of int, shape (n_segments,)
        Clusters of their base parts.
    is_donor : ndarray of bool, shape (n_segments,)
        Whether a segment may be used in another's place.
    first, last : ndarray, shape (n_segments, n_joints, 4)
        The grafted group's pose in the first and in the last frame of each.
    rate : float
        Frames per second.
    first_velocity, last_velocity : ndarray, shape (n_segments, n_joints, 3), optional
        The group's angular velocities there, in radians per second. Without them the seams
        are judged by their poses alone.
    points : ndarray, shape (n_segments, n_components), optional
        The base parts as the clustering sees them. Without them all are alike.
    sigma : float
        Greatest distance of two points of one cluster.
    """

    segments: Segments
    labels: IntArray
    is_donor: BoolArray
    first: FloatArray
    last: FloatArray
    rate: float
    first_velocity: FloatArray | None = None
    last_velocity: FloatArray | None = None
    points: FloatArray | None = None
    sigma: float = 0.0

    def candidates(self, segment: int, config: Config) -> IntArray:
        """Return the segments that may take one's place by cluster and length, itself included.

        Parameters
        ----------
        segment : int
            The base segment.
        config : Config
            Gives the length rule.

        Returns
        -------
        ndarray of int
            Ascending.
        """
        return self.candidate_lists(np.array([segment]), config)[0]

    def candidate_lists(self, scenario: IntArray, config: Config) -> list[IntArray]:
        """Return for each of several segments what `candidates` returns for one.

        Parameters
        ----------
        scenario : ndarray of int, shape (n_positions,)
            The base segments, in any order.
        config : Config
            Gives the length rule.

        Returns
        -------
        list of ndarray of int
            One per position, each ascending.
        """
        lengths, labels = self.segments.lengths, self.labels
        members = np.argsort(labels, kind="stable")
        wanted = np.argsort(labels[scenario], kind="stable")
        present, starts = np.unique(labels[scenario][wanted], return_index=True)
        first = np.searchsorted(labels[members], present, side="left")
        last = np.searchsorted(labels[members], present, side="right")
        lists: list[IntArray] = [np.zeros(0, np.int64)] * len(scenario)
        for low, high, places in zip(
            first.tolist(), last.tolist(), np.split(wanted, starts[1:]), strict=True
        ):
            mates = members[low:high]
            own = scenario[places]
            fits = length_fits(lengths[own][:, None], lengths[mates], self.rate, config)
            fits = (fits & self.is_donor[mates]) | (mates == own[:, None])
            for place, row in zip(places.tolist(), fits, strict=True):
                lists[place] = mates[row]
        return lists

    def seam_angles(self, left: IntArray, right: IntArray) -> FloatArray:
        """Return the mean joint angle at the seams between segments, in radians.

        Parameters
        ----------
        left, right : ndarray of int
            Segments that end at the seam and segments that start at it.

        Returns
        -------
        ndarray, shape (len(left), len(right))
            0 where the right one follows the left one in its clip.
        """
        return pose_gaps(self.last[left], self.first[right])

    def seam_velocity_gaps(self, left: IntArray, right: IntArray) -> FloatArray:
        """Return the mean difference of joint velocities at seams, in radians per second.

        Parameters
        ----------
        left, right : ndarray of int
            As for `gaps`.

        Returns
        -------
        ndarray, shape (len(left), len(right))
            0 where the right one follows the left one in its clip, or nothing is known.
        """
        if self.first_velocity is None or self.last_velocity is None:
            return np.zeros((len(left), len(right)))
        return velocity_gaps(self.last_velocity[left], self.first_velocity[right])

    def seam_angles_along(self, donors: IntArray) -> FloatArray:
        """Return the mean joint angle at each seam of a row of donors, shape (n - 1,)."""
        pairs = [
            self.seam_angles(donors[at : at + 1], donors[at + 1 : at + 2])
            for at in range(len(donors) - 1)
        ]
        return np.concatenate([gap.ravel() for gap in pairs]) if pairs else np.zeros(0)

    def distances(self, own: IntArray, donors: IntArray) -> FloatArray:
        """Return how far base parts are apart, in greatest distances within a cluster.

        Parameters
        ----------
        own, donors : ndarray of int, shape (n,)
            Base segments and donors, one for each.

        Returns
        -------
        ndarray, shape (n,)
            0 where nothing was compared.
        """
        if self.points is None or not self.sigma > 0:
            return np.zeros(len(own))
        apart: FloatArray = np.linalg.norm(self.points[donors] - self.points[own], axis=1)
        return apart / self.sigma

    @cached_property
    def typical_gaps(self) -> tuple[float, float]:
        """Mean gaps, in pose and velocity, at seams between members of neighbours' clusters.

        Infinite where no cluster has two members. Of some hundred donors, evenly spread.
        """
        members = np.flatnonzero(self.is_donor)
        order = members[np.argsort(self.labels[members], kind="stable")]
        starts = np.flatnonzero(np.diff(self.labels[order], prepend=-1))
        following = np.arange(1, len(order) + 1)
        following[np.append(starts[1:], len(order))[: len(starts)] - 1] = starts
        mate = np.full(len(self.labels), -1)
        mate[order] = order[following]
        clip = self.segments.clip
        left = np.flatnonzero((clip[1:] == clip[:-1]) & (mate[1:] >= 0) & (mate[:-1] >= 0))
        left = left[(mate[left] != left) | (mate[left + 1] != left + 1)]
        if not len(left):
            return np.inf, np.inf
        some = np.linspace(0, len(left) - 1, min(_PAIRS, len(left))).round().astype(np.int64)
        ending, starting = mate[left[some]], mate[left[some] + 1]
        turned = rotations.multiply(rotations.inverse(self.last[ending]), self.first[starting])
        angle = float(np.linalg.norm(rotations.log(turned), axis=-1).mean())
        if self.first_velocity is None or self.last_velocity is None:
            return angle, np.inf
        speeds = self.last_velocity[ending] - self.first_velocity[starting]
        return angle, float(np.linalg.norm(speeds, axis=-1).mean())

    def scale_config(self, config: Config) -> Config:
        """Return the configuration with the scales of seams that these segments have.

        In motions that hardly move a degree is much: a seam costs 1 at twice what is typical,
        where that is less than `angle_scale` and `velocity_scale`.
        """
        angle, speed = (2.0 * gap if gap > 0 else np.inf for gap in self.typical_gaps)
        return replace(
            config,
            angle_scale=min(config.angle_scale, angle),
            velocity_scale=min(config.velocity_scale, speed),
        )

    def costs(self, own: IntArray, donors: IntArray, config: Config) -> FloatArray:
        """Return what donors cost by themselves, seams apart; see `DonorTrellis.build`.

        Parameters
        ----------
        own, donors : ndarray of int, shape (n,)
            Base segments and donors, one for each.
        config : Config
            Gives the weights.

        Returns
        -------
        ndarray, shape (n,)
            The costs.
        """
        lengths = self.segments.lengths
        apart = self.distances(own, donors)
        return donor_costs(lengths[own], lengths[donors], apart, donors == own, config)

    def judge(self, segment: int, points: FloatArray | None, config: Config) -> Candidates:
        """Return all members of a segment's cluster with their costs and refusals.

        Parameters
        ----------
        segment : int
            The base segment.
        points : ndarray, shape (n_segments, n_components), optional
            The embedding of the base parts.
        config : Config
            Gives the limits.

        Returns
        -------
        Candidates
            Seams are judged against the segment's own neighbours.
        """
        cut = self.segments
        mates = np.flatnonzero(self.labels == self.labels[segment])
        length = int(cut.lengths[segment])
        fits = length_fits(cut.lengths[segment], cut.lengths[mates], self.rate, config)
        still = np.zeros(len(mates))
        has_before = segment > 0 and cut.clip[segment - 1] == cut.clip[segment]
        has_after = segment + 1 < len(cut) and cut.clip[segment + 1] == cut.clip[segment]
        before = self.seam_angles(np.array([segment - 1]), mates)[0] if has_before else still
        after = self.seam_angles(mates, np.array([segment + 1]))[:, 0] if has_after else still
        apart = (
            np.full(len(mates), np.nan)
            if points is None
            else np.linalg.norm(points[mates] - points[segment], axis=1)
        )
        costs = self.costs(np.full(len(mates), segment), mates, config)
        left, right = np.array([segment - 1]), np.array([segment + 1])
        speed_before = self.seam_velocity_gaps(left, mates)[0] if has_before else still
        speed_after = self.seam_velocity_gaps(mates, right)[:, 0] if has_after else still
        scaled = self.scale_config(config)
        for seam, speed in ((before, speed_before), (after, speed_after)):
            costs += (seam / scaled.angle_scale) ** 2 + (speed / scaled.velocity_scale) ** 2
        allowed: list[Candidate] = []
        refused: list[Candidate] = []
        for at in np.lexsort((mates, apart, mates != segment)).tolist():
            mate = int(mates[at])
            stretch = abs(length - int(cut.lengths[mate])) / length
            widest = np.degrees(max(before[at], after[at]))
            reasons = []
            if not self.is_donor[mate]:
                reasons.append("a fault was found in it")
            if not fits[at]:
                longest = max(config.max_stretch, config.length_slack * self.rate / length)
                way = "above" if longest > config.max_stretch else "not below"
                reasons.append(f"length: {stretch:.2f} is {way} {longest:.2f}")
            if widest > np.degrees(config.max_angle):
                reasons.append(f"seam: {widest:.1f}° is above {np.degrees(config.max_angle):.1f}°")
            candidate = Candidate(
                mate,
                int(cut.clip[mate]),
                int(cut.start[mate]),
                int(cut.stop[mate]),
                stretch,
                float(before[at]),
                float(after[at]),
                float(apart[at]),
                "" if mate == segment else "; ".join(reasons),
                float(costs[at]),
            )
            (refused if candidate.refused else allowed).append(candidate)
        return Candidates(tuple(allowed), tuple(refused), len(cut) - len(mates))


@dataclass(frozen=True, eq=False)
class DonorTrellis:
    """What may be at each position of a scenario, and what it costs.

    Made by `DonorTrellis.build`.

    Attributes
    ----------
    scenario : ndarray of int, shape (n_positions,)
        The base segments.
    candidates : tuple of ndarray of int
        At each position the segments that are looked at, ascending, the base segment itself
        among them.
    costs : Trellis
        The costs of these.
    """

    scenario: IntArray
    candidates: tuple[IntArray, ...]
    costs: Trellis

    @classmethod
    def build(
        cls,
        pool: SegmentPool,
        scenario: IntArray,
        candidates: Sequence[IntArray],
        config: Config,
        more: Sequence[FloatArray] | None = None,
    ) -> "DonorTrellis":
        """Return what donors cost at every position of a scenario.

        Parameters
        ----------
        pool : SegmentPool
            The segments.
        scenario : ndarray of int, shape (n_positions,)
            The base segments.
        candidates : sequence of ndarray of int
            At each position the segments that pass, ascending, the base segment among them.
        config : Config
            Gives the weights, and how many candidates are looked at.
        more : sequence of ndarray, optional
            Further costs of each candidate.

        Returns
        -------
        DonorTrellis
            With the cheapest `max_candidates` at each position; of equally cheap ones those
            of lowest index.

        Notes
        -----
        A donor k of segment i costs ``length_weight · (1 - shorter / longer)
        + distance_weight · d(i, k) / sigma``, and `novelty` less if k is not i. A seam
        costs ``(angle / angle_scale)² + (velocity / velocity_scale)²``, plus
        `INFEASIBLE_PENALTY` if the angle exceeds `max_angle`. With ``choice="nearest"`` a
        donor costs d(i, k) / sigma, the base segment itself `INFEASIBLE_PENALTY`, and a seam
        within the limit 0. The scales are those of `SegmentPool.scale_config`.
        """
        config = pool.scale_config(config)
        counts = [len(own) for own in candidates]
        costs = pool.costs(np.repeat(scenario, counts), np.concatenate(candidates), config)
        if more is not None:
            costs = costs + np.concatenate(more)
        ends = np.cumsum(counts)[:-1]
        kept: list[IntArray] = []
        alone: list[FloatArray] = []
        for segment, mates, prices in zip(
            scenario.tolist(), candidates, np.split(costs, ends), strict=True
        ):
            order = cheapest(prices, mates == segment, config)
            kept.append(mates[order])
            alone.append(prices[order])
        after = [_seam_costs(pool, left, right, config) for left, right in pairwise(kept)]
        return cls(scenario, tuple(kept), Trellis(tuple(alone), tuple(after)))

    def donor_sequence(self, choices: IntArray) -> IntArray:
        """Return the segments that choices of the chain stand for."""
        pairs = zip(self.candidates, choices.tolist(), strict=True)
        return np.array([own[at] for own, at in pairs], np.int64)

    def path(self, donors: IntArray) -> IntArray:
        """Return which choices of the chain segments are; each must be among its candidates."""
        pairs = zip(self.candidates, donors.tolist(), strict=True)
        return np.array([np.searchsorted(own, donor) for own, donor in pairs], np.int64)


def _seam_costs(pool: SegmentPool, left: IntArray, right: IntArray, config: Config) -> FloatArray:
    """Return what it costs that one of `right` follows one of `left`."""
    return seam_costs(pool.seam_angles(left, right), pool.seam_velocity_gaps(left, right), config)


def reachable(
    pool: SegmentPool, positions: Sequence[IntArray], config: Config
) -> tuple[list[IntArray], list[FloatArray]]:
    """Leave those candidates from which the end can be reached within the transition limit.

    Parameters
    ----------
    pool : SegmentPool
        The segments.
    positions : sequence of ndarray of int
        The candidates at each position of the scenario, its base segment among them.
    config : Config
        Gives `max_angle`.

    Returns
    -------
    alive : list of ndarray of int
        For each position the candidates with at least one successor that is alive, and a
        seam to it of at most `max_angle`. All of them where no candidate has one.
    gaps : list of ndarray
        For each position but the last the seams' angles between what is alive there and at
        the next.
    """
    alive = [positions[-1]] if len(positions) else []
    gaps: list[FloatArray] = []
    for own in reversed(positions[:-1]):
        angles = pool.seam_angles(own, alive[-1])
        passes = np.flatnonzero((angles <= config.max_angle).any(axis=1))
        if not len(passes):
            passes = np.arange(len(own))
        alive.append(own[passes])
        gaps.append(angles[passes])
    return alive[::-1], gaps[::-1]


def choose(
    alive: Sequence[IntArray],
    gaps: Sequence[FloatArray],
    config: Config,
    rng: np.random.Generator,
) -> IntArray:
    """Choose a donor at every position, at random among those that pass.

    Parameters
    ----------
    alive, gaps
        As `reachable` returns them.
    config : Config
        Gives `max_angle`.
    rng : numpy.random.Generator
        Where the chance comes from.

    Returns
    -------
    ndarray of int, shape (n_positions,)
        Each uniformly one of those whose seam with the one before is within the limit; the
        nearest where none is.
    """
    chosen = []
    at = 0
    for position, own in enumerate(alive):
        if position == 0:
            at = int(rng.integers(len(own)))
        else:
            angles = gaps[position - 1][at]
            passing = np.flatnonzero(angles <= config.max_angle)
            at = int(rng.choice(passing)) if len(passing) else int(np.argmin(angles))
        chosen.append(own[at])
    return np.array(chosen, np.int64)


def count_combinations(labels: IntArray, n_groups: int) -> int:
    """Count the segments that can be made when nothing but the clusters limits the choice.

    Parameters
    ----------
    labels : ndarray of int
        Clusters of the base parts.
    n_groups : int
        Number of joint groups, the base among them.

    Returns
    -------
    int
        Σ |c|^K over the clusters c, the captured segments included (paper, tables 1 and 2).

    Examples
    --------
    >>> count_combinations(np.array([0, 0, 1]), 3)
    9
    """
    return sum(int(size) ** n_groups for size in np.unique(labels, return_counts=True)[1])
