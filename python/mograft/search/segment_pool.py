"""The segments of a library for one joint group: possible donors, and their costs and gaps."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, make_read_only, split_by_counts
from mograft._util.containers import SizedCache
from mograft.analysis.embedding import Samples
from mograft.analysis.zero_moment import added_imbalances, zero_moment_operators
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.segments import Segments
from mograft.search.boundary_states import (
    BoundaryStates,
    pose_gaps,
    pose_gaps_along,
    velocity_gaps_along,
)
from mograft.search.copies import SegmentParts
from mograft.search.costs import PRESELECTION, CostModel, length_fits
from mograft.search.neighbourhoods import FEWEST_DONORS, NEIGHBOURHOODS, point_distances

_SEGMENTS_PER_BATCH = 1 << 12  # base segments whose support margins are in memory
_MAX_KNOWN_LISTS, _MAX_KNOWN_PAIRS = 4, 1 << 20  # bases whose candidates are kept; of each
POSITIONS_PER_BATCH = 1024  # base segments whose candidates are evaluated together
_NEIGHBOURS_PER_BATCH = 1 << 19  # base segments and neighbours that are compared together
_N_TYPICAL_SEAMS = 512  # seams from which the typical gaps are measured
# Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018: 1/g and 1/g² of the
# root g of g³ = g + 1. Their multiples modulo 1 fill the square evenly.
_QUASI_RANDOM_STEPS = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True, eq=False)
class SegmentBalance:
    """The effect of donors on the balance of base segments, computed from two functions.

    Both functions take indices of segments, shape (n,). They return the results for these segments
    of the functions of `mograft.analysis.zero_moment` that have the same names.
    """

    mass_offsets: Callable[[IntArray], FloatArray]  # of the grafted group
    support_margins: Callable[[IntArray], FloatArray]  # of the whole body

    def added_imbalances(self, base: IntArray, donors: IntArray, seconds: FloatArray) -> FloatArray:
        """Return by how much donors raise the imbalance of base segments, shape (n,).

        See `mograft.analysis.zero_moment.added_imbalances`. `base` and `donors` have shape (n,).
        `seconds` has the durations of all segments.
        """
        added = np.zeros(len(base))
        others = np.flatnonzero(donors != base)
        starts = np.flatnonzero(np.diff(base[others], prepend=-1))
        for first in range(0, len(starts), _SEGMENTS_PER_BATCH):
            bounds = np.append(starts, len(others))[first : first + _SEGMENTS_PER_BATCH + 1]
            batch = others[bounds[0] : bounds[-1]]
            bases, own = base[others[bounds[:-1]]], donors[batch]
            is_needed = np.zeros(len(seconds), bool)
            is_needed[bases] = is_needed[own] = True
            rows = np.cumsum(is_needed) - 1
            offsets = self.mass_offsets(np.flatnonzero(is_needed))
            operators = zero_moment_operators(offsets.shape[1], seconds[bases])
            known = rows[bases], operators, self.support_margins(bases)
            added[batch] = added_imbalances(offsets, known, rows[own], np.diff(bounds))
        return added


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
    # The last results of `candidate_lists`, by the arguments: edits of a graft use the same ones.
    _known_lists: SizedCache[Any, tuple[IntArray, ...]] = field(
        init=False, default_factory=lambda: SizedCache(_MAX_KNOWN_LISTS)
    )

    def neighbours(self, base: IntArray, config: Config) -> list[IntArray]:
        """Return the indices of the segments in the neighbourhood of each base segment.

        The indices are ascending and include that of the base segment. If a ball has fewer than
        `FEWEST_DONORS` possible donors, the nearest possible donors up to that number are added,
        at distances of at most `Neighbourhood.reach` radii.
        """
        return self._search(base, config)[0]

    def _search(self, base: IntArray, config: Config) -> tuple[list[IntArray], list[IntArray]]:
        """Return the `neighbours`, and those of them that can be donors, and the base segment."""
        neighbourhood = NEIGHBOURHOODS[config.neighbourhood]
        found = neighbourhood.find_members(self.labels, self.points, self.sigma, base)
        fitting = self._keep_fitting(base, found, config)
        if neighbourhood.reach == 1.0:
            return found, fitting
        counts = np.array([len(own) - 1 for own in fitting])
        lacking = np.flatnonzero(counts < FEWEST_DONORS)
        radius, wanting = neighbourhood.reach * self.sigma, base[lacking]
        reached = neighbourhood.find_members(self.labels, self.points, radius, wanting)
        further = self._keep_fitting(wanting, reached, config)
        for index, segment, donors in zip(lacking.tolist(), wanting, further, strict=True):
            others = donors[donors != segment]
            distances = self.distances(np.full(len(others), segment), others)
            nearest = others[np.argsort(distances, kind="stable")[:FEWEST_DONORS]]
            found[index], fitting[index] = (
                np.union1d(own[index], nearest) for own in (found, fitting)
            )
        return found, fitting

    def candidate_lists(
        self, scenario: IntArray, config: Config, model: CostModel | None = None
    ) -> list[IntArray]:
        """Return the candidates of each base segment: similar donors whose length fits.

        `scenario` holds the base segments, in any order. The result has one ascending list of
        segments per position. A list always contains the base segment. With `model`, a list has at
        most `PRESELECTION` times `max_candidates` segments: those of the lowest
        `preselection_costs`.
        """
        key = (hashlib.sha256(np.ascontiguousarray(scenario).data).digest(), config, model)
        known = self._known_lists.get(key)
        if known is not None:
            return list(known)
        lists: list[IntArray] = []
        for start in range(0, len(scenario), POSITIONS_PER_BATCH):
            positions = scenario[start : start + POSITIONS_PER_BATCH]
            fitting = self._search(positions, config)[1]
            if model is not None:
                for few in _batches(fitting):
                    pairs = list_pairs(positions[few], fitting[few])
                    costs = self.preselection_costs(*pairs, model)
                    fitting[few], _ = model.keep_cheapest_of_each(
                        positions[few], fitting[few], costs, PRESELECTION
                    )
            lists += fitting
        for own in lists:
            make_read_only(own)
        if sum(map(len, lists)) <= _MAX_KNOWN_PAIRS:
            self._known_lists.put(key, tuple(lists), 1)
        return lists

    def _keep_fitting(
        self, positions: IntArray, members: Sequence[IntArray], config: Config
    ) -> list[IntArray]:
        """Return the neighbours of each base segment that can be its donors, and itself.

        `positions` are the base segments, `members` the neighbours of each.
        """
        found: list[IntArray] = []
        lengths = self.segments.lengths
        for own in _batches(members):
            base, donors = list_pairs(positions[own], members[own])
            fits = length_fits(lengths[base], lengths[donors], self.rate, config)
            fits &= self.is_donor[donors]
            fits[fits] = ~self.are_copies(base[fits], donors[fits])
            fits |= donors == base
            ends = np.append(0, np.cumsum(fits))[np.cumsum(list(map(len, members[own])))]
            found += split_by_counts(donors[fits], np.diff(ends, prepend=0))
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
        return point_distances(self.points, donors, base) / self.sigma

    def added_imbalances(self, base: IntArray, donors: IntArray) -> FloatArray:
        """Return by how much donors raise the imbalance of base segments, shape (n,).

        See `mograft.analysis.zero_moment.added_imbalances`. The arguments have shape (n,).
        """
        if self.balance is None:
            return np.zeros(len(base))
        return self.balance.added_imbalances(base, donors, self.segments.lengths / self.rate)

    def pose_differences(self, first: IntArray, second: IntArray) -> FloatArray:
        """Return how much the poses of the group differ in pairs of segments, in radians, (n,).

        The difference is the mean joint angle, over the first and the last frame; the heading of a
        root is not compared. Both arguments have shape (n,).
        """
        # The kernel compares neighbouring lists: each first segment, then the second ones of its
        # run, then an empty list.
        starts = np.flatnonzero(np.diff(first, prepend=-1))
        lengths = np.diff(np.append(starts, len(first)))
        counts = np.stack([np.ones_like(lengths), lengths, np.zeros_like(lengths)], axis=1).ravel()
        along = np.insert(second, starts, first[starts]), counts
        ends = (self.boundary.first, self.boundary.last) if self.parts is None else self.parts.ends
        angles = [pose_gaps_along(own, own, *along) for own in ends]
        return (angles[0] + angles[1]) / 2.0

    def pose_differences_to_last(self, boundary: BoundaryStates) -> FloatArray:
        """Return the `pose_differences` of n segments to the last of them, shape (n,).

        The segments, which need not be in the library, are given by their boundary states.
        """
        ends = (boundary.first, boundary.last)
        ends = ends if self.parts is None else self.parts.select_ends(boundary)
        angles = [pose_gaps(own[-1:], own)[0] for own in ends]
        return (angles[0] + angles[1]) / 2.0

    def unary_costs(self, base: IntArray, donors: IntArray, model: CostModel) -> FloatArray:
        """Return the unary cost of each donor for its base segment, shape (n,).

        Costs of seams and constraints are not included.
        """
        further = self.further_costs(base, donors, model)
        return self.preselection_costs(base, donors, model) + further

    def preselection_costs(self, base: IntArray, donors: IntArray, model: CostModel) -> FloatArray:
        """Return the `unary_costs` without the `further_costs`."""
        lengths, distances = self.segments.lengths, self.distances(base, donors)
        return model.unary(lengths[base], lengths[donors], distances, donors == base)

    def further_costs(self, base: IntArray, donors: IntArray, model: CostModel) -> FloatArray:
        """Return the `unary_costs` of balance and similar poses, which take longest to compute."""
        costs = model.similarity(self.pose_differences(base, donors))
        costs[base == donors] = 0.0
        if model.config.balance_weight > 0:
            costs = costs + model.balance(self.added_imbalances(base, donors))
        return costs

    def pairwise_costs(self, left: IntArray, right: IntArray, model: CostModel) -> FloatArray:
        """Return the seam costs from each left to each right segment, shape (n_left, n_right)."""
        return model.seam_costs(self.boundary[left], self.boundary[right])

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
            found += map(np.ndarray.reshape, matrices, pairwise(counts.tolist()))
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


def _batches(lists: Sequence[IntArray]) -> list[slice]:
    """Return runs of positions with at most about `_NEIGHBOURS_PER_BATCH` segments in their lists.

    Neighbourhoods grow with the library: fewer positions at a time keep the memory constant.
    """
    sums = np.cumsum([len(own) for own in lists])
    cuts = (np.flatnonzero(np.diff(sums // _NEIGHBOURS_PER_BATCH)) + 1).tolist()
    return [slice(low, high) for low, high in pairwise([0, *cuts, len(lists)]) if low < high]


def list_pairs(positions: IntArray, lists: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
    """Return the base segment and the donor of each item of the lists, one list after the other."""
    return np.repeat(positions, list(map(len, lists))), np.concatenate(lists)
