"""Candidate donors: their generation by neighbourhood and length, and their listing with costs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray, split_by_counts
from mograft._util.html_table import notebook_table
from mograft.analysis.embedding import Samples
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.segments import Segments
from mograft.search.balance import SegmentBalance
from mograft.search.boundary_states import (
    BoundaryStates,
    pose_gaps,
    pose_gaps_along,
    velocity_gaps,
    velocity_gaps_along,
)
from mograft.search.copies import SegmentParts
from mograft.search.costs import PRESELECTION, CostModel, SeamScales, length_fits
from mograft.search.neighbourhoods import NEIGHBOURHOODS

POSITIONS_PER_BATCH = 1024  # base segments whose candidates are evaluated together
_NEIGHBOURS_PER_BATCH = 1 << 19  # base segments and neighbours that are compared together
_N_TYPICAL_SEAMS = 512  # seams from which the typical gaps are measured
# Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018: 1/g and 1/g² of the
# root g of g³ = g + 1. Their multiples modulo 1 fill the square evenly.
_QUASI_RANDOM_STEPS = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True)
class Candidate:
    """A segment in the neighbourhood of a base segment, and its cost as the donor.

    Attributes
    ----------
    segment, clip, start, stop : int
        Index of the segment, index of its clip, and its first and last frame in the clip.
    stretch : float
        Absolute difference of the lengths, as a fraction of the base segment's length.
    gap_before, gap_after : float
        Mean joint angle, in radians, at the seams with the base segment's neighbours; 0 if
        there is no neighbour.
    distance : float
        Distance from the base segment in the embedding of the base group, in the unit of the
        embedding; NaN if there is no embedding.
    refused : str
        Reasons why the segment cannot be the donor, with value and limit; empty if it can.
    cost : float
        The cost if only this base segment is replaced: the unary cost, the costs of the seams
        with both neighbours and the constraint costs. See `Config` for the terms.
    is_forced : bool
        Whether a `Use` constraint requires the segment, from any neighbourhood and of any length.
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
    is_forced: bool = False


@dataclass(frozen=True)
class Candidates:
    """The candidate donors for one base segment.

    Attributes
    ----------
    allowed : tuple of Candidate
        The donors within all limits, nearest first; the base segment itself comes first unless
        it violates a constraint.
    refused : tuple of Candidate
        The other segments in the neighbourhood of the base segment, nearest first.
    elsewhere : int
        Number of segments outside the neighbourhood of the base segment.
    """

    allowed: tuple[Candidate, ...]
    refused: tuple[Candidate, ...]
    elsewhere: int

    def __len__(self) -> int:
        return len(self.allowed)

    def __repr__(self) -> str:
        numbers = f"{len(self.allowed)} allowed, {len(self.refused)} refused"
        return f"Candidates({numbers}, {self.elsewhere} outside the neighbourhood)"

    def _repr_html_(self) -> str:
        listed = (*self.allowed, *self.refused)
        rows = (
            (
                *(c.segment, c.clip, f"{c.start}-{c.stop}", c.cost, c.distance, c.stretch),
                *(*np.degrees([c.gap_before, c.gap_after]).tolist(), c.refused),
            )
            for c in listed
        )
        columns = ("segment", "clip", "frames", "cost", "distance", "stretch")
        seams = ("seam before (°)", "seam after (°)", "refused because")
        return notebook_table(repr(self), columns + seams, rows, len(listed))


@dataclass(frozen=True, eq=False)
class SegmentPool:
    """All segments of a library, with the data for the search for donors of one joint group."""

    segments: Segments
    labels: IntArray  # clusters of the base parts, shape (n_segments,)
    is_donor: BoolArray  # whether a segment can replace others
    boundary: BoundaryStates  # of the grafted group
    rate: float  # frames per second
    points: FloatArray | None = None  # embedding of the base parts; None: all distances are 0
    sigma: float = 0.0  # cluster diameter threshold, in the unit of `points`
    balance: SegmentBalance | None = None  # None: all donors keep the balance
    parts: SegmentParts | None = None  # None: no donor is compared with the base part

    def neighbours(self, base: IntArray, config: Config) -> list[IntArray]:
        """Return the indices of the segments in the neighbourhood of each base segment.

        The indices are ascending and include that of the base segment.
        """
        neighbourhood = NEIGHBOURHOODS[config.neighbourhood]
        return neighbourhood.find_members(self.labels, self.points, self.sigma, base)

    def candidate_lists(
        self, scenario: IntArray, config: Config, model: CostModel | None = None
    ) -> list[IntArray]:
        """Return the candidates of each base segment: similar donors whose length fits.

        `scenario` holds the base segments, in any order. The result has one ascending list of
        segments per position. A list always contains the base segment. With `model`, a list has at
        most `PRESELECTION` times `max_candidates` segments: those of the lowest unary cost, not
        counting the cost of balance.
        """
        lists: list[IntArray] = []
        for start in range(0, len(scenario), POSITIONS_PER_BATCH):
            positions = scenario[start : start + POSITIONS_PER_BATCH]
            members = self.neighbours(positions, config)
            stops = np.cumsum([len(own) for own in members])
            # Clusters grow with the library: fewer positions at a time keep the memory constant.
            cuts = np.flatnonzero(np.diff(stops // _NEIGHBOURS_PER_BATCH)) + 1
            for own in np.split(np.arange(len(positions)), cuts):
                batch = slice(own[0], own[-1] + 1)
                lists += self._fitting(positions[batch], members[batch], config, model)
        return lists

    def _fitting(
        self,
        positions: IntArray,
        members: Sequence[IntArray],
        config: Config,
        model: CostModel | None,
    ) -> list[IntArray]:
        """Return the neighbours of each base segment that can be its donors.

        `positions` are the base segments, `members` the neighbours of each.
        """
        lengths = self.segments.lengths
        counts = np.array([len(own) for own in members])
        base, donors = np.repeat(positions, counts), np.concatenate(members)
        fits = length_fits(lengths[base], lengths[donors], self.rate, config)
        fits &= self.is_donor[donors]
        fits[fits] = ~self.are_copies(base[fits], donors[fits])
        fits |= donors == base
        ends = np.append(0, np.cumsum(fits))[np.cumsum(counts)]
        donors = donors[fits]
        found = split_by_counts(donors, np.diff(ends, prepend=0))
        if model is not None:
            costs = self.costs_without_balance(base[fits], donors, model)
            found, _ = model.keep_cheapest_of_each(positions, found, costs, PRESELECTION)
        return found

    def are_copies(self, base: IntArray, donors: IntArray) -> BoolArray:
        """Return whether donors have the part of their base segments; see `SegmentParts`."""
        if self.parts is None:
            return np.zeros(len(base), bool)
        return self.parts.are_copies(base, donors)

    def find_copies(self, base: Samples, donors: IntArray) -> BoolArray:
        """Return which donors have the part of a segment that is not in the library."""
        if self.parts is None:
            return np.zeros(len(donors), bool)
        return self.parts.find_copies(base, donors)

    def seam_angles(self, left: IntArray, right: IntArray) -> FloatArray:
        """Return the mean joint angle, in radians, at the seam between each left and right segment.

        The result has shape (len(left), len(right)). At the seam, the last frame of the left
        segment meets the first frame of the right segment. The angle is 0 if the right segment
        follows the left one in its clip. The mean is over the joints of `boundary`, which are the
        `feature_joints` of the group. Limits, costs, listings and reports all use this angle.
        """
        return pose_gaps(self.boundary.last[left], self.boundary.first[right])

    def seam_angles_along(self, donors: IntArray) -> FloatArray:
        """Return the mean joint angle, in radians, at each seam of n donors, shape (n - 1,)."""
        boundary = self.boundary
        return pose_gaps_along(boundary.last, boundary.first, donors, np.ones_like(donors))

    def distances(self, base: IntArray, donors: IntArray) -> FloatArray:
        """Return the distance of each donor from its base segment in the base group's embedding.

        Both arguments and the result have shape (n,). Distances are in units of `sigma`; they are 0
        if there is no embedding.
        """
        if self.points is None or not self.sigma > 0:
            return np.zeros(len(base))
        return _core.distances(np.ascontiguousarray(self.points), donors, base) / self.sigma

    def added_imbalances(self, base: IntArray, donors: IntArray) -> FloatArray:
        """Return by how much donors raise the imbalance of base segments, shape (n,).

        See `mograft.analysis.zero_moment.added_imbalances`. The arguments have shape (n,).
        """
        if self.balance is None:
            return np.zeros(len(base))
        return self.balance.added_imbalances(base, donors, self.segments.lengths / self.rate)

    def unary_costs(self, base: IntArray, donors: IntArray, model: CostModel) -> FloatArray:
        """Return the unary cost of each donor for its base segment, shape (n,).

        Costs of seams and constraints are not included.
        """
        without = self.costs_without_balance(base, donors, model)
        return without + self.balance_costs(base, donors, model)

    def costs_without_balance(
        self, base: IntArray, donors: IntArray, model: CostModel
    ) -> FloatArray:
        """Return the `unary_costs` without those of balance, which take longest to compute."""
        lengths, distances = self.segments.lengths, self.distances(base, donors)
        return model.unary(lengths[base], lengths[donors], distances, donors == base)

    def balance_costs(self, base: IntArray, donors: IntArray, model: CostModel) -> FloatArray:
        """Return the part of the `unary_costs` that is due to balance."""
        if not model.config.balance_weight > 0:
            return np.zeros(len(base))
        return model.balance(self.added_imbalances(base, donors))

    def pairwise_costs(self, left: IntArray, right: IntArray, model: CostModel) -> FloatArray:
        """Return the seam costs from each left to each right segment, shape (n_left, n_right)."""
        ends, starts = self.boundary.last_velocity[left], self.boundary.first_velocity[right]
        return model.pairwise(self.seam_angles(left, right), velocity_gaps(ends, starts))

    def pairwise_costs_along(
        self, candidates: Sequence[IntArray], model: CostModel
    ) -> list[FloatArray]:
        """Return the `pairwise_costs` from the candidates of each position to those of the next."""
        found: list[FloatArray] = []
        for start in range(0, len(candidates) - 1, POSITIONS_PER_BATCH):
            lists = candidates[start : start + POSITIONS_PER_BATCH + 1]
            counts, boundary = np.array([len(own) for own in lists]), self.boundary
            along = np.concatenate(lists), counts
            angles = pose_gaps_along(boundary.last, boundary.first, *along)
            ends, starts = boundary.last_velocity, boundary.first_velocity
            costs = model.pairwise(angles, velocity_gaps_along(ends, starts, *along))
            matrices = split_by_counts(costs, counts[:-1] * counts[1:])
            shapes = pairwise(counts.tolist())
            found += [own.reshape(shape) for own, shape in zip(matrices, shapes, strict=True)]
        return found

    @cached_property
    def typical_gaps(self) -> tuple[float, float]:
        """Mean pose gap, in radians, and velocity gap, in radians/s, over the `typical_seams`.

        Both are infinite if there are no such seams.
        """
        left, right = self.typical_seams()
        if not len(left):
            return np.inf, np.inf
        boundary = self.boundary
        turns = rotations.multiply(rotations.inverse(boundary.last[left]), boundary.first[right])
        angle = float(np.linalg.norm(rotations.log(turns), axis=-1).mean())
        velocities = boundary.last_velocity[left] - boundary.first_velocity[right]
        return angle, float(np.linalg.norm(velocities, axis=-1).mean())

    def typical_seams(self) -> tuple[IntArray, IntArray]:
        """Return the left and the right segments of 512 seams that are typical of grafts.

        The seams are made from evenly spaced boundaries between segments of a clip. On each side,
        the segment is replaced by another donor of its cluster if there is one. The two segments of
        a seam are never consecutive in a clip. Both arrays are empty if no segment can be replaced
        in this way.
        """
        donors = np.flatnonzero(self.is_donor)
        order = donors[np.argsort(self.labels[donors], kind="stable")]
        labels = self.labels[order]
        sizes = np.zeros(len(self.labels), np.int64)
        firsts, ranks = np.zeros_like(sizes), np.zeros_like(sizes)
        counts = np.bincount(labels)
        firsts[order] = (np.cumsum(counts) - counts)[labels]
        sizes[order] = counts[labels]
        ranks[order] = np.arange(len(order)) - firsts[order]

        def shift(members: IntArray, steps: IntArray) -> IntArray:
            return order[firsts[members] + (ranks[members] + steps) % sizes[members]]

        is_seam = (sizes[:-1] > 0) & (sizes[1:] > 0) & (sizes[:-1] + sizes[1:] > 2)
        seams = np.flatnonzero(is_seam & (np.diff(self.segments.clip) == 0))
        if not len(seams):
            return seams, seams
        seams = seams[np.arange(_N_TYPICAL_SEAMS) * len(seams) // _N_TYPICAL_SEAMS]
        # Quasi-random numbers in [0, 1) choose the other donors.
        fractions = np.outer(_QUASI_RANDOM_STEPS, np.arange(1, _N_TYPICAL_SEAMS + 1)) % 1.0
        left, right = (
            shift(side, np.minimum(sizes[side] - 1, 1 + ((sizes[side] - 1) * own).astype(np.int64)))
            for side, own in zip((seams, seams + 1), fractions, strict=True)
        )
        is_captured = (right == left + 1) & (self.segments.clip[left] == self.segments.clip[right])
        # Such a right segment has another donor in its cluster: beside a segment that has none,
        # the left segment was replaced, so the two are not consecutive.
        return left, np.where(is_captured, shift(right, np.ones_like(right)), right)

    def seam_scales(self, config: Config) -> SeamScales:
        """Return the gaps of a seam that cost 1: see `SeamScales.from_typical_gaps`."""
        return SeamScales.from_typical_gaps(*self.typical_gaps, config)


@dataclass(frozen=True, eq=False)
class ConstraintVerdicts:
    """Constraint costs of the candidates of a base segment, and the constraints they violate."""

    members: IntArray  # neighbourhood of the base segment and donors of `Use`, ascending
    costs: FloatArray  # shape (n_members,)
    reasons: Sequence[Sequence[str]]  # for each member the violated hard constraints
    is_forced: BoolArray  # whether a `Use` requires the member, shape (n_members,)


def list_candidates(
    pool: SegmentPool, segment: int, model: CostModel, verdicts: ConstraintVerdicts | None = None
) -> Candidates:
    """Return the candidates of a base segment with costs and reasons for refusal.

    The candidates are the segments in its neighbourhood (`Config.neighbourhood`), or those of
    `verdicts`. Gaps and seam costs are those with the segments before and after the base segment in
    its clip. No limit refuses the donors that `Use` requires.
    """
    segments, config = pool.segments, model.config
    members = pool.neighbours(np.array([segment]), config)[0]
    if verdicts is not None:
        members = verdicts.members
    length = int(segments.lengths[segment])
    fits = length_fits(segments.lengths[segment], segments.lengths[members], pool.rate, config)
    is_copy = pool.are_copies(np.full(len(members), segment), members)
    costs = pool.unary_costs(np.full(len(members), segment), members, model)
    if verdicts is not None:
        costs = costs + verdicts.costs
    before, after = np.zeros(len(members)), np.zeros(len(members))
    if segment > 0 and segments.clip[segment - 1] == segments.clip[segment]:
        neighbour = np.array([segment - 1])
        before = pool.seam_angles(neighbour, members)[0]
        costs = costs + pool.pairwise_costs(neighbour, members, model)[0]
    if segment + 1 < len(segments) and segments.clip[segment + 1] == segments.clip[segment]:
        neighbour = np.array([segment + 1])
        after = pool.seam_angles(members, neighbour)[:, 0]
        costs = costs + pool.pairwise_costs(members, neighbour, model)[:, 0]
    distances = np.full(len(members), np.nan)
    if pool.points is not None:
        distances = np.linalg.norm(pool.points[members] - pool.points[segment], axis=1)
    listed: list[Candidate] = []
    for i in np.lexsort((members, distances, members != segment)).tolist():
        member = int(members[i])
        stretch = abs(length - int(segments.lengths[member])) / length
        reasons: list[str] = []
        is_forced = verdicts is not None and bool(verdicts.is_forced[i])
        if member != segment and not is_forced:
            if not pool.is_donor[member]:
                reasons.append("excluded donor: a recording fault overlaps it")
            if is_copy[i]:
                reasons.append("copy: it moves the group as the base segment does")
            slack = config.length_slack * pool.rate / length
            reasons += [] if fits[i] else [_describe_length(stretch, slack, config)]
            angle = max(float(before[i]), float(after[i]))
            if angle > config.max_angle:
                limit = np.degrees(config.max_angle)
                reasons.append(f"seam: {np.degrees(angle):.1f}° is above {limit:.1f}°")
        if verdicts is not None:
            reasons += verdicts.reasons[i]
        listed.append(
            Candidate(
                segment=member,
                clip=int(segments.clip[member]),
                start=int(segments.start[member]),
                stop=int(segments.stop[member]),
                stretch=stretch,
                gap_before=float(before[i]),
                gap_after=float(after[i]),
                distance=float(distances[i]),
                refused="; ".join(reasons),
                cost=float(costs[i]),
                is_forced=is_forced,
            )
        )
    return Candidates(
        allowed=tuple(candidate for candidate in listed if not candidate.refused),
        refused=tuple(candidate for candidate in listed if candidate.refused),
        elsewhere=len(segments) - len(members),
    )


def _describe_length(stretch: float, slack: float, config: Config) -> str:
    """Return why a length does not fit; `slack` is `Config.length_slack`, relative as `stretch`."""
    limit, relation = (
        max(config.max_stretch, slack),
        "above" if config.length_slack > 0 else "not below",
    )
    return f"length: {stretch:.2f} is {relation} {limit:.2f}"


def count_combinations(labels: IntArray, n_groups: int) -> int:
    """Count the segments that grafting can make if only clusters limit the choice of donors.

    The count is Σ |c|^n_groups over the clusters c of the base group, given by `labels`. It
    includes the captured segments, and `n_groups` includes the base group (paper, tables 1 and 2).

    Examples
    --------
    >>> count_combinations(np.array([0, 0, 1]), 3)
    9
    """
    return sum(int(size) ** n_groups for size in np.unique(labels, return_counts=True)[1])
