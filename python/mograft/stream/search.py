"""The donor search of a stream: candidates of pending segments, and the choice for the first.

In the segment that is committed next, pose constraints are evaluated after seam treatment. In
later segments, whose seams are not known yet, they are evaluated on the resampled donors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Samples
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.body.mass import mass_model
from mograft.body.world_poses import Poses
from mograft.config import Config
from mograft.library.ingest import boundary_states
from mograft.motion.motion import Motion, world_transforms
from mograft.motion.segments import Segments
from mograft.search.boundary_states import BoundaryStates
from mograft.search.constraints import Constraint
from mograft.search.costs import (
    PRESELECTION,
    ConstraintViolations,
    CostModel,
    length_fits,
    origin_violations,
)
from mograft.search.donor_choice import DONOR_CHOICES
from mograft.search.neighbourhoods import FEWEST_DONORS, NEIGHBOURHOODS
from mograft.search.pose_constraints import AvoidSelf, with_captured_depth
from mograft.search.trellis import Trellis
from mograft.solve.search_problem import driven_joints
from mograft.stream.base_buffer import BaseBuffer
from mograft.stream.base_clusters import BaseClusters
from mograft.stream.donors import StreamDonors, StreamRules
from mograft.stream.pending_segment import GroupCandidates, PendingSegment
from mograft.stream.placed_donors import (
    CommittedEnd,
    PlacedDonors,
    SampledDonors,
    frames_with_neighbours,
    place_donors,
    sample_donors,
)
from mograft.stream.smoothing import SmoothedDonor, smooth_with_following


@dataclass(frozen=True, eq=False)
class ChosenDonors:
    """The choice for one segment."""

    candidates: dict[str, int]  # index of the chosen candidate of each grafted group
    placed: dict[str, PlacedDonors | SmoothedDonor]  # the chosen donors after seam treatment
    poses: Poses | None  # with all chosen donors; None if no pose constraint applies
    following: dict[str, int]  # donors of the next segment that are chosen in advance, by group


class StreamSearch:
    """The search for donors in a stream; `frame` is any frame of the base motion."""

    def __init__(self, donors: StreamDonors, frame: Motion) -> None:
        library = donors.library
        self._donors, self._library = donors, library
        self._lengths = library.segments.lengths
        self._frame = frame
        self._driven_joints = driven_joints(frame.skeleton, donors.joints)
        self._clusters = BaseClusters(library, mass_model(frame.skeleton).height)

    def list_candidates(
        self, base: BaseBuffer, start: int, stop: int, rules: StreamRules, *, has_previous: bool
    ) -> PendingSegment:
        """Return a base segment with its candidates.

        Candidates satisfy the limits on cluster and length and the hard constraints on clips and
        lengths; a donor that moves a group as the base segment does has a penalty in that group.
        `start` and `stop` are the segment's first and last frame. `has_previous` is true if a
        segment before it is committed; the first frame is then committed too.
        """
        motion, offset = base.motion_with_margin(start, stop)
        excerpt = _single_segment(offset, offset + stop - start, 0)
        segment = _single_segment(start, stop, len(self._library.entries))
        samples = self._clusters.sample(motion, excerpt)
        members, distances = self._find_donors(samples, segment, rules.config)
        origin = self._origin_violations(segment, members, rules)
        members, distances = members[origin.is_feasible], distances[origin.is_feasible]
        # The base segment is the last candidate: distance 0, no origin costs, always feasible.
        lengths = np.append(self._lengths[members], segment.lengths)
        origin_costs = np.append(origin.soft[origin.is_feasible], 0.0)
        is_base = np.arange(len(lengths)) == len(members)
        # Unary costs do not depend on seam scales, the only difference between the groups' models.
        model = next(iter(rules.models.values()))
        unary_costs = model.unary(segment.lengths, lengths, np.append(distances, 0.0), is_base)
        kept = model.keep_cheapest(unary_costs + origin_costs, is_base, PRESELECTION)
        donors, is_base = np.append(members, -1)[kept], is_base[kept]
        unary_costs, origin_costs = unary_costs[kept], origin_costs[kept]
        ends = boundary_states(motion, excerpt)
        boundary = {group: self._boundary(group, donors, ends) for group in self._donors.pools}
        of_groups = {
            group: unary_costs
            + np.where(
                is_base, 0.0, model.similarity(pool.pose_differences_to_last(boundary[group]))
            )
            for group, pool in self._donors.pools.items()
        }
        # All groups have the same candidates: the cheapest on average.
        costs = sum(of_groups.values()) / len(of_groups) + origin_costs
        kept = model.keep_cheapest(costs, is_base)
        donors = donors[kept]
        pending = PendingSegment(
            base=motion,
            offset=offset,
            segment=segment,
            donors=donors,
            unary_costs={group: own[kept] for group, own in of_groups.items()},
            origin_costs=origin_costs[kept],
            is_copy={
                group: np.append(pool.find_copies(samples, donors[:-1]), False)
                for group, pool in self._donors.pools.items()
            },
        )
        pending = replace(pending, pose_constraints=self._pose_constraints(pending, rules))
        for group, states in boundary.items():
            candidates = self._group_candidates(
                pending, group, states[kept], has_previous=has_previous
            )
            pending.groups[group] = candidates
        return pending

    def _find_donors(
        self, samples: Samples, segment: Segments, config: Config
    ) -> tuple[IntArray, FloatArray]:
        """Return the donors of a base segment by neighbourhood and length, and their distances.

        As in `SegmentPool.neighbours`, the nearest are added if there are too few.
        """
        members, distances = self._find_fitting(samples, segment, config, 1.0)
        reach = NEIGHBOURHOODS[config.neighbourhood].reach
        if reach == 1.0 or len(members) >= FEWEST_DONORS:
            return members, distances
        further, their_distances = self._find_fitting(samples, segment, config, reach)
        nearest = np.argsort(their_distances, kind="stable")[:FEWEST_DONORS]
        nearest.sort()
        return further[nearest], their_distances[nearest]

    def _find_fitting(
        self, samples: Samples, segment: Segments, config: Config, reach: float
    ) -> tuple[IntArray, FloatArray]:
        """Return the possible donors within some radii that fit, and their distances.

        Copies of all groups of the base segment are none.
        """
        members, distances = self._clusters.find_members(samples, reach)
        fits = self._library.is_donor[members] & length_fits(
            segment.lengths, self._lengths[members], self._library.rate, config
        )
        pools, fitting = self._donors.pools.values(), np.flatnonzero(fits)
        copied = [pool.find_copies(samples, members[fitting]) for pool in pools]
        fitting = fitting[~np.all(copied, axis=0)]
        return members[fitting], distances[fitting]

    def choose_donors(
        self,
        segments: Sequence[PendingSegment],
        ends: Mapping[str, CommittedEnd],
        rules: StreamRules,
        rng: np.random.Generator,
        fixed: Mapping[str, int],
    ) -> ChosenDonors:
        """Choose donors for one or more successive segments; return those of the first segment.

        `fixed` has donors of the first segment that were chosen in advance, by group; they do not
        apply if the segment has pose constraints.

        `ends` has the end of the committed motion of every grafted group; it is empty before the
        first segment is committed. Groups are chosen one after the other: pose constraints on a
        group are evaluated with the donors of the groups before it.
        """
        segment, rate = segments[0], self._library.rate
        choice = DONOR_CHOICES[rules.config.choice]
        candidates: dict[str, int] = {}
        placed: dict[str, PlacedDonors | SmoothedDonor] = {}
        following: dict[str, int] = {}
        context = segment.rotations.copy()
        for group, joints in self._donors.joints.items():
            end, sampled = ends.get(group), segment.groups[group].sampled
            costs, all_placed = segment.costs(group), None
            if sampled is not None:
                all_placed = place_donors(sampled, end, rate, rules.config)
                costs = costs + self.pose_costs(
                    segment, group, all_placed.frames, context, has_previous=end is not None
                )
            trellis = _trellis(segments, group, costs, end, rules.models[group])
            kept = np.arange(len(segment.donors))
            if all_placed is None and group in fixed:
                kept = np.flatnonzero(segment.donors == fixed[group])
                trellis = trellis.restrict_first(kept)
            path = choice.choose_path(trellis, rules.config, rng)
            index = int(kept[path[0]])
            if all_placed is not None:
                placed[group] = all_placed.select(index)
            else:
                donors = segment.donors[index : index + 1]
                sampled = self._sample(segment, group, donors)
                treatment = SEAM_TREATMENTS[rules.config.seam]
                if treatment.uses_next_donor and len(segments) > 1:
                    donors = segments[1].donors[path[1] : path[1] + 1]
                    following[group] = int(donors[0])
                    next_sampled = self._sample(segments[1], group, donors)
                    placed[group] = smooth_with_following(
                        sampled, next_sampled, end, rate, rules.config
                    )
                else:
                    placed[group] = place_donors(sampled, end, rate, rules.config)
            candidates[group] = index
            context[:, joints] = placed[group].frames[0]
        poses = self._poses(segment, context) if segment.pose_constraints else None
        return ChosenDonors(candidates, placed, poses, following)

    def pose_costs(
        self,
        segment: PendingSegment,
        group: str,
        rotations: FloatArray,
        context: FloatArray,
        *,
        has_previous: bool,
    ) -> FloatArray:
        """Return the costs of pose constraints for candidates of a group, shape (n_candidates,).

        `rotations` are those of the group's joints, of shape
        (n_candidates, n_frames, n_group_joints, 4); `context` has those of all joints, of shape
        (n_frames, n_joints, 4). With `has_previous`, the first frame is committed already and does
        not count.
        """
        n, first = len(rotations), 1 if has_previous else 0
        local = np.tile(context, (n, 1, 1))
        local[:, self._donors.joints[group]] = rotations.reshape(-1, *rotations.shape[2:])
        poses, joints = self._poses(segment, local), self._driven_joints[group]
        errors = [constraint.errors(poses, joints)[0] for constraint in segment.pose_constraints]
        amounts = [own.reshape(n, -1)[:, first:].max(axis=1) for own in errors]
        return ConstraintViolations.from_amounts(segment.pose_constraints, amounts, n).costs()

    @cached_property
    def _body(self) -> Poses:
        """World poses of one frame of the base motion, from which other poses are made."""
        return replace(Poses.from_motion(self._frame), up=self._library.up)

    def _poses(self, segment: PendingSegment, rotations: FloatArray) -> Poses:
        """Return the world poses of several candidates, with the translations of a segment.

        `rotations` are local, of all joints in the segment's frames, one candidate after the other:
        shape (n_candidates * n_frames, n_joints, 4).
        """
        n_candidates = len(rotations) // (segment.length + 1)
        offsets = np.tile(segment.base.positions[segment.rows], (n_candidates, 1, 1))
        transforms = world_transforms(self._frame.skeleton, rotations, offsets)
        return self._body.with_poses(np.tile(segment.frames, n_candidates), *transforms)

    def _origin_violations(
        self, segment: Segments, members: IntArray, rules: StreamRules
    ) -> ConstraintViolations:
        repeated = segment[np.zeros(len(members), np.int64)]
        donors = self._library.segments[members]
        amounts = origin_violations(
            rules.constraints, "", repeated, donors, repeated, self._donors.clips
        )
        return ConstraintViolations.from_amounts(rules.constraints, amounts, len(members))

    def _pose_constraints(
        self, segment: PendingSegment, rules: StreamRules
    ) -> tuple[Constraint, ...]:
        """Return the pose constraints that apply in a segment.

        Each `AvoidSelf` allows body parts to penetrate each other as deeply as they do in the
        captured poses of the segment.
        """
        constraints = [
            constraint
            for constraint in rules.constraints
            if constraint.is_on_poses and constraint.applies(segment.frames).any()
        ]
        if any(isinstance(constraint, AvoidSelf) for constraint in constraints):
            captured = self._poses(segment, segment.rotations)
            constraints = with_captured_depth(constraints, captured)
        return tuple(constraints)

    def _boundary(
        self, group: str, donors: IntArray, ends: Mapping[str, FloatArray]
    ) -> BoundaryStates:
        """Return the boundary states of donors; `ends` are those of the base, the last of them."""
        joints = self._donors.compared_joints[group]
        base = BoundaryStates(**{name: states[:, joints] for name, states in ends.items()})
        return BoundaryStates.concatenate([self._donors.pools[group].boundary[donors[:-1]], base])

    def _group_candidates(
        self, segment: PendingSegment, group: str, boundary: BoundaryStates, *, has_previous: bool
    ) -> GroupCandidates:
        """Return the candidates of a group, given their boundary states."""
        if not segment.pose_constraints:
            return GroupCandidates(boundary, segment.costs(group))
        sampled = self._sample(segment, group, segment.donors)
        pose_costs = self.pose_costs(
            segment, group, sampled.frames, segment.rotations, has_previous=has_previous
        )
        return GroupCandidates(boundary, segment.costs(group) + pose_costs, sampled)

    def _sample(self, segment: PendingSegment, group: str, donors: IntArray) -> SampledDonors:
        first, last = segment.offset, segment.offset + segment.length
        own = frames_with_neighbours(segment.base.rotations, first, last)
        tracks = [
            own if donor < 0 else self._donors.read_rotations(donor) for donor in donors.tolist()
        ]
        joints = self._donors.joints[group]
        return sample_donors(tracks, joints, segment.length, self._library.rate)


def _trellis(
    segments: Sequence[PendingSegment],
    group: str,
    first_costs: FloatArray,
    end: CommittedEnd | None,
    model: CostModel,
) -> Trellis:
    """Return the trellis of one group over successive segments.

    `first_costs` are the costs of the candidates in the first segment, without those of its seam to
    `end`.
    """
    candidates = [segment.groups[group] for segment in segments]
    if end is not None:
        first_costs = first_costs + model.seam_costs(end.boundary, candidates[0].boundary)[0]
    pairs = pairwise(candidates)
    return Trellis(
        (first_costs, *(following.costs for following in candidates[1:])),
        tuple(before.seam_costs_to(after, model) for before, after in pairs),
    )


def _single_segment(start: int, stop: int, clip: int) -> Segments:
    return Segments(np.array([start]), np.array([stop]), np.array([clip]))
