"""The candidates of a base segment, with costs and the reasons against the refused ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.html_table import notebook_table
from mograft._util.validate import is_integer
from mograft.errors import join_names
from mograft.library.library import Library
from mograft.motion.segments import Segments
from mograft.search.constraints import Constraint
from mograft.search.costs import ConstraintViolations, CostModel, length_fits
from mograft.search.donor_choice import cost_model
from mograft.search.donor_constraints import limit_config
from mograft.search.segment_pool import SegmentPool
from mograft.solve.donor_trellis import candidate_poses, pose_amounts
from mograft.solve.plan import GraftPlan
from mograft.solve.search_problem import used_donors


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


def candidates(
    library: Library, segment: int, group: str, constraints: Sequence[Constraint] = ()
) -> Candidates:
    """Return the donors for a group of a segment, and why other similar segments are refused.

    Parameters
    ----------
    library : Library
        The library that contains the base segment and its donors.
    segment : int
        Index of the base segment.
    group : str
        The group to replace.
    constraints : sequence of Constraint, optional
        Donors that would violate a hard constraint at the segment are refused.

    Returns
    -------
    Candidates
        All members of the base segment's neighbourhood (see `Config.neighbourhood`), with
        costs.

    Raises
    ------
    ValueError
        If the segment or the group does not exist, or the group is the base.
    """
    if not is_integer(segment) or not 0 <= segment < len(library.segments):
        raise ValueError(f"`segment` must be 0 to {len(library.segments) - 1}, got {segment!r}")
    if group == library.groups.base:
        others = [own for own in library.groups.names if own != group]
        raise ValueError(
            f"`group` must be one of {join_names(others)}, not the base group, which is kept; "
            f"got {group!r}"
        )
    pool, config, verdicts = library.pool(group), library.config, None
    if constraints:
        verdicts = _judge_candidates(library, segment, group, constraints)
        config = limit_config(config, constraints)
    return list_candidates(pool, segment, cost_model(config, pool), verdicts)


class _Verdicts(NamedTuple):
    """Constraint costs of the candidates of a base segment, and the constraints they violate."""

    members: IntArray  # neighbourhood of the base segment and donors of `Use`, ascending
    costs: FloatArray  # shape (n_members,)
    reasons: Sequence[Sequence[str]]  # for each member the violated hard constraints
    is_forced: BoolArray  # whether a `Use` requires the member, shape (n_members,)


def _judge_candidates(
    library: Library, segment: int, group: str, constraints: Sequence[Constraint]
) -> _Verdicts:
    """Evaluate constraints for every member of the neighbourhood of a base segment.

    The result has the constraint costs and the violated hard constraints of every member, in
    ascending order of the members. The base motion is the clip of `segment`. If the group contains
    the root, every member is moved to the root transform with which the base segment starts.
    """
    if not isinstance(constraints, Constraint):
        constraints = [
            own
            for own in constraints
            if not isinstance(own, Constraint) or own.applies_to_group(group)
        ]
    clip = int(library.segments.clip[segment])
    problem = GraftPlan.build(library, clip, [group], constraints).problem
    position = int(np.searchsorted(problem.scenario, segment))
    hard = [own for own in problem.constraints if own.is_hard]
    used = used_donors(hard, problem.base_segments, library)[position]
    neighbours = problem.pools[group].neighbours(np.array([segment]), problem.config)[0]
    members = np.union1d(neighbours, used)
    positions = np.full(len(members), position)
    origin = problem.origin_amounts(problem.constraints, group, positions, members)
    poses = candidate_poses(problem, group, positions, members)
    pose = pose_amounts(problem, group, positions, poses, problem.constraints)
    # A constraint is either on the origin of donors or on poses: its other amounts are 0.
    amounts = list(map(np.maximum, origin, pose))
    costs = ConstraintViolations.from_amounts(problem.constraints, amounts, len(members)).costs()
    reasons: list[list[str]] = [[] for _ in range(len(members))]
    for constraint, own in zip(problem.constraints, amounts, strict=True):
        for i in np.flatnonzero(own > 1.0).tolist() if constraint.is_hard else ():
            message = constraint.describe_error(float(own[i]), problem.base_poses.height)
            reasons[i].append(f"{type(constraint).__name__}: {message}")
    return _Verdicts(members, costs, reasons, np.isin(members, used))


def list_candidates(
    pool: SegmentPool,
    segment: int,
    model: CostModel,
    verdicts: _Verdicts | None = None,
    around: tuple[int | None, int | None] | None = None,
) -> Candidates:
    """Return the candidates of a base segment with costs and reasons for refusal.

    The candidates are the segments in its neighbourhood (`Config.neighbourhood`), or those of
    `verdicts`. Gaps and seam costs are those with the segments `around`, by default those before
    and after the base segment in its clip; None stands for no segment. No limit refuses the donors
    that `Use` requires.
    """
    segments, config = pool.segments, model.config
    if verdicts is None:
        members = pool.neighbours(np.array([segment]), config)[0]
        n = len(members)
        verdicts = _Verdicts(members, np.zeros(n), [()] * n, np.zeros(n, bool))
    members = verdicts.members
    length, base = int(segments.lengths[segment]), np.full(len(members), segment)
    fits = length_fits(segments.lengths[base], segments.lengths[members], pool.rate, config)
    is_copy = pool.are_copies(base, members)
    costs, gaps = pool.unary_costs(base, members, model) + verdicts.costs, np.zeros((2, len(base)))
    for side, neighbour in enumerate(around or _neighbours_in_clip(segments, segment)):
        if neighbour is not None:
            near = np.array([neighbour])
            left, right = (members, near) if side else (near, members)
            gaps[side] = pool.seam_angles(left, right).ravel()
            costs = costs + pool.pairwise_costs(left, right, model).ravel()
    distances = np.full(len(members), np.nan)
    if pool.points is not None:
        distances = np.linalg.norm(pool.points[members] - pool.points[segment], axis=1)
    max_stretch = max(config.max_stretch, config.length_slack * pool.rate / length)
    relation = "above" if config.length_slack > 0 else "not below"
    listed: list[Candidate] = []
    for i in np.lexsort((members, distances, members != segment)).tolist():
        member, is_forced = int(members[i]), bool(verdicts.is_forced[i])
        stretch = abs(length - int(segments.lengths[member])) / length
        reasons: list[str] = []
        if member != segment and not is_forced:
            if not pool.is_donor[member]:
                reasons.append("excluded donor: a recording fault overlaps it")
            if is_copy[i]:
                reasons.append("copy: it moves the group as the base segment does")
            if not fits[i]:
                digits = 2 if round(stretch, 2) != round(max_stretch, 2) else 4
                values = (f"{value:.{digits}f}" for value in (stretch, max_stretch))
                reasons.append(f"length: {f' is {relation} '.join(values)}")
            angle, limit = np.degrees([gaps[:, i].max(), config.max_angle]).tolist()
            if angle > limit:
                reasons.append(f"seam: {angle:.1f}° is above {limit:.1f}°")
        listed.append(
            Candidate(
                segment=member,
                clip=int(segments.clip[member]),
                start=int(segments.start[member]),
                stop=int(segments.stop[member]),
                stretch=stretch,
                gap_before=float(gaps[0, i]),
                gap_after=float(gaps[1, i]),
                distance=float(distances[i]),
                refused="; ".join([*reasons, *verdicts.reasons[i]]),
                cost=float(costs[i]),
                is_forced=is_forced,
            )
        )
    return Candidates(
        allowed=tuple(candidate for candidate in listed if not candidate.refused),
        refused=tuple(candidate for candidate in listed if candidate.refused),
        elsewhere=len(segments) - len(members),
    )


def _neighbours_in_clip(segments: Segments, segment: int) -> tuple[int | None, int | None]:
    """Return the segments before and after a segment in its clip."""
    first, last = segments.of_clip(int(segments.clip[segment]))[[0, -1]]
    return segment - 1 if segment > first else None, segment + 1 if segment < last else None


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
