"""The cost model of the search: every cost and limit that a donor can incur.

A donor sequence costs the sum of one unary cost per position, one pairwise cost per seam, and the
constraint costs of each position. Violation amounts are in tolerances of the constraint: at most 1
if it is satisfied.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft import _core
from mograft._util.arrays import BoolArray, FloatArray, IntArray, split_by_counts
from mograft.config import Config
from mograft.motion.segments import Segments
from mograft.search.boundary_states import BoundaryStates, pose_gaps, velocity_gaps
from mograft.search.constraints import Clip, Constraint, overlaps

_ROUNDED_GAP = 1e-9  # radians or radians per second, of equal poses or velocities
INFEASIBLE_PENALTY = 1e5
"""Cost of a violated limit; `is_infeasible` recognises costs that contain it."""

_MAX_SEAM_COST = INFEASIBLE_PENALTY / 8  # two such costs are not infeasible
NOVEL_ANGLE = np.radians(5.0)
"""Pose difference from the base part from which a donor has the whole of `Config.novelty`.

A donor with the same poses has half of it.
"""

DIVERSE_ANGLE = np.radians(20.0)
"""Pose difference from a donor of an earlier motion from which `Config.diversity` costs nothing."""

ANGLE_FACTOR, VELOCITY_FACTOR = 0.5, 2.0  # largest seam scales, as multiples of the typical gaps
# Of the candidates of a position, this multiple of `max_candidates` is compared by all costs; which
# ones is decided without balance and poses, so that time is linear in the number of positions.
PRESELECTION = 16


def length_fits(base: IntArray, donor: IntArray, rate: float, config: Config) -> BoolArray:
    """Return whether the lengths of donors are close enough to those of base segments (eq. 19).

    Lengths are in intervals between frames, `rate` in frames per second; the shapes broadcast. The
    rule is ``|base - donor| < max_stretch · base``, as in the paper. If `length_slack` is above 0,
    it is ``|base - donor| <= max(max_stretch · base, length_slack · rate)``. The rule is relative
    to the base segment, so it is not symmetric.
    """
    gap, limit, tolerance = np.abs(base - donor), float(config.max_stretch) * base, 1e-9 * base
    if config.length_slack > 0:
        return gap <= np.maximum(limit, config.length_slack * rate) + tolerance
    return gap < limit - tolerance


@dataclass(frozen=True)
class SeamScales:
    """The angle at a seam that costs 1, and the velocity difference that costs 1."""

    angle: float  # mean joint angle in radians
    velocity: float  # mean difference of joint velocities in radians per second

    @classmethod
    def from_typical_gaps(cls, angle: float, velocity: float, config: Config) -> "SeamScales":
        """Return the scales of the configuration, limited by the typical gaps of the library.

        `angle` is the typical pose gap in radians, `velocity` the typical velocity gap in radians
        per second. The scale of the angle is at most half, that of the velocity at most twice the
        typical gap. A library with small movements has small typical gaps and therefore small
        scales. For a typical gap that is infinite, or 0 up to rounding, the scale of the
        configuration is returned.
        """
        max_angle, max_velocity = (
            factor * gap if gap > _ROUNDED_GAP else np.inf
            for factor, gap in ((ANGLE_FACTOR, angle), (VELOCITY_FACTOR, velocity))
        )
        return cls(min(config.angle_scale, max_angle), min(config.velocity_scale, max_velocity))


@dataclass(frozen=True)
class CostModel:
    """Unary and pairwise costs: the weighted sum of all terms.

    A donor k of segment i costs ``length_weight · (1 - shorter / longer) + distance_weight · d(i,
    k) / sigma + balance_weight · u``, minus ``novelty · (1 + min(1, a / NOVEL_ANGLE)) / 2``. Here
    shorter and longer are the lengths of the two segments, d is their distance in the embedding of
    the base group, sigma the cluster diameter threshold, u the result of `added_imbalances` and a
    that of `pose_differences`. Segment i itself costs `base_cost`. A seam costs `seam_weight` times
    ``(angle / scales.angle)² + (velocity / scales.velocity)²``, which is at most an eighth of
    `INFEASIBLE_PENALTY`, plus that penalty if the angle exceeds `max_angle`.
    """

    config: Config
    scales: SeamScales
    base_cost: float = 0.0  # of the base segment
    seam_weight: float = 1.0

    def unary(
        self, base: IntArray, donors: IntArray, distances: FloatArray, is_base: BoolArray
    ) -> FloatArray:
        """Return the unary costs of donors of new poses, without those of seams and constraints.

        All arrays have shape (n,). `base` and `donors` are lengths in intervals between frames.
        `distances` are those of donor and base segment in the embedding of the base group, divided
        by the cluster diameter threshold. `is_base` is true where the donor is the base segment.
        """
        ratio = np.minimum(base, donors) / np.maximum(base, donors)
        costs = self.config.length_weight * (1.0 - ratio)
        costs = costs + self.config.distance_weight * distances
        return np.where(is_base, self.base_cost, costs - self.config.novelty)

    def similarity(self, differences: FloatArray) -> FloatArray:
        """Return by how much less novel donors are, given their `pose_differences` to the base."""
        return self.config.novelty / 2.0 * np.maximum(1.0 - differences / NOVEL_ANGLE, 0.0)

    def diversity(self, differences: FloatArray) -> FloatArray:
        """Return the costs of donors, given their `pose_differences` to one of another motion."""
        return self.config.diversity * np.maximum(1.0 - differences / DIVERSE_ANGLE, 0.0)

    def balance(self, imbalances: FloatArray) -> FloatArray:
        """Return the unary costs of the results of `added_imbalances`."""
        return self.config.balance_weight * imbalances

    def pairwise(self, angles: FloatArray, velocities: FloatArray) -> FloatArray:
        """Return the costs of seams, in the shape of `angles`.

        `angles` are mean joint angles in radians, `velocities` mean differences of joint velocities
        in radians per second.
        """
        gaps = (angles / self.scales.angle) ** 2 + (velocities / self.scales.velocity) ** 2
        penalties = np.where(angles > self.config.max_angle, INFEASIBLE_PENALTY, 0.0)
        return penalties + self.seam_weight * np.minimum(gaps, _MAX_SEAM_COST)

    def seam_costs(self, left: BoundaryStates, right: BoundaryStates) -> FloatArray:
        """Return the seam costs from each left to each right segment, shape (n_left, n_right)."""
        velocities = velocity_gaps(left.last_velocity, right.first_velocity)
        return self.pairwise(pose_gaps(left.last, right.first), velocities)

    def keep_cheapest(self, costs: FloatArray, is_base: BoolArray, factor: int = 1) -> IntArray:
        """Return the indices of the ``factor · max_candidates`` cheapest donors, ascending.

        The base segment is always kept, so that the sequence of base segments, which has no seams,
        remains possible. Ties go to the lowest index.
        """
        limit = factor * self.config.max_candidates
        return _core.keep_cheapest(np.array([len(costs)]), costs, is_base, limit)[0]

    def keep_cheapest_of_each(
        self, scenario: IntArray, candidates: Sequence[IntArray], costs: FloatArray, factor: int = 1
    ) -> tuple[list[IntArray], list[FloatArray]]:
        """Return the candidates of each position that `keep_cheapest` keeps, and their costs.

        `costs` are those of all candidates, position after position. The results are views of two
        new arrays.
        """
        counts = np.array([len(own) for own in candidates], np.int64)
        segments, limit = np.concatenate(candidates), factor * self.config.max_candidates
        is_base = segments == np.repeat(scenario, counts)
        kept, kept_counts = _core.keep_cheapest(counts, costs, is_base, limit)
        of_kept = split_by_counts(segments[kept], kept_counts)
        return of_kept, split_by_counts(costs[kept], kept_counts)


def is_infeasible(costs: FloatArray) -> BoolArray:
    """Return which costs contain an `INFEASIBLE_PENALTY`, from which novelty may be subtracted."""
    return costs >= INFEASIBLE_PENALTY / 2


def excess(amounts: FloatArray) -> FloatArray:
    """Return by how many tolerances violation amounts exceed 1; 0 if they do not."""
    return np.maximum(amounts - 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class ConstraintViolations:
    """Violation amounts of n candidates, combined over the hard and over the soft constraints."""

    hard: FloatArray  # greatest violation amount of a hard constraint; at most 1 if all hold
    soft: FloatArray  # sum of weight · amount² over the soft constraints

    @classmethod
    def from_amounts(
        cls, constraints: Sequence[Constraint], amounts: Sequence[FloatArray], n: int
    ) -> "ConstraintViolations":
        """Combine the violation amounts of n candidates, one array of shape (n,) per constraint."""
        hard, soft = np.zeros(n), np.zeros(n)
        for constraint, amount in zip(constraints, amounts, strict=True):
            if constraint.weight is None:
                hard = np.maximum(hard, amount)
            else:
                soft += constraint.weight * amount**2
        return cls(hard, soft)

    def split(self, counts: Sequence[int]) -> "list[ConstraintViolations]":
        """Return the violations of consecutive sets of candidates; `counts` holds their sizes."""
        hard, soft = (split_by_counts(own, np.array(counts)) for own in (self.hard, self.soft))
        return list(map(ConstraintViolations, hard, soft))

    @property
    def is_feasible(self) -> BoolArray:
        """Whether each candidate satisfies all hard constraints, shape (n,)."""
        return self.hard <= 1.0

    def costs(self) -> FloatArray:
        """Return the sum of all constraint costs of each candidate, shape (n,).

        The greatest violation of a hard constraint costs ``INFEASIBLE_PENALTY · (1 + amount)`` if
        its amount is above 1; NaN is not.
        """
        penalties = INFEASIBLE_PENALTY * (1.0 + self.hard)
        return np.where(self.hard > 1.0, penalties, 0.0) + self.soft


def origin_violations(
    constraints: Sequence[Constraint],
    group: str,
    base: Segments,
    donors: Segments,
    frames: Segments,
    clips: Sequence[Clip],
) -> list[FloatArray]:
    """Return how far donors of a group violate each constraint on clips, frames and lengths.

    `base` and `donors` are n base segments and one donor for each, in frames of the clips that
    `clips` lists; `frames` are the same base segments in frames of the base motion. There is one
    array of n violation amounts per constraint; amounts are 0 outside the constraint's frames, and
    if it does not apply to the group.
    """
    return [
        np.where(overlaps(frames, own.frames), own.donor_errors(base, donors, clips), 0.0)
        if own.applies_to_group(group)
        else np.zeros(len(donors))
        for own in constraints
    ]
