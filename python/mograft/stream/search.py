"""The donor search of a stream: candidates of pending segments, and the choice for the first.

In the segment that is committed next, pose constraints are evaluated after seam treatment. In
later segments, whose seams are not known yet, they are evaluated on the resampled donors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import Samples, features
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.body.anatomy import feature_joints
from mograft.body.capsules import Poses
from mograft.library.ingest import boundary_states, sample_segments
from mograft.library.library import Library
from mograft.motion.motion import Motion, forward_kinematics
from mograft.motion.segments import Segments
from mograft.search.boundary_states import BoundaryStates, pose_gaps
from mograft.search.constraints import Clip, Constraint
from mograft.search.costs import (
    INFEASIBLE_PENALTY,
    PRESELECTION,
    ConstraintViolations,
    CostModel,
    length_fits,
    origin_violations,
)
from mograft.search.donor_choice import DONOR_CHOICES, cost_model
from mograft.search.donor_constraints import limit_config
from mograft.search.neighbourhoods import FEWEST_DONORS, NEIGHBOURHOODS, ClusterMembers
from mograft.search.pose_constraints import AvoidSelf, with_captured_depth
from mograft.search.trellis import Trellis
from mograft.solve.search_problem import driven_joints
from mograft.stream.base_buffer import BaseBuffer
from mograft.stream.placed_donors import PlacedDonor, SampledDonors, frames_with_neighbours

_MAX_CACHED_DONORS = 4096


@dataclass(eq=False)
class GroupCandidates:
    """The candidates of one group for a base segment that is not committed yet."""

    boundary: BoundaryStates
    unary_costs: FloatArray  # shape (n_candidates,); without seams and constraints
    origin_costs: FloatArray  # with soft constraints on clip and length, and for copies of the base
    costs: FloatArray  # with pose constraints as well
    sampled: SampledDonors | None = None  # all candidates; None if no pose constraint applies
    _seam_costs: FloatArray | None = field(default=None, init=False, repr=False)

    def seam_costs_to(self, following: "GroupCandidates", model: CostModel) -> FloatArray:
        """Return the seam costs to the candidates of the next segment; later calls reuse them."""
        if self._seam_costs is None:
            self._seam_costs = model.seam_costs(self.boundary, following.boundary)
        return self._seam_costs


@dataclass(eq=False, kw_only=True)
class PendingSegment:
    """A base segment of a stream whose donors are not committed yet, and its candidates."""

    body: Poses  # any pose of the base motion
    base: Motion  # the segment's frames with a margin, from `BaseBuffer.motion_with_margin`
    offset: int  # index in `base` of the segment's first frame
    start: int  # first frame
    stop: int  # last frame
    donors: IntArray  # shape (n_candidates,); the last is -1, the base segment itself
    groups: dict[str, GroupCandidates] = field(default_factory=dict)  # by grafted group
    pose_constraints: Sequence[Constraint] = ()  # those that apply in the segment

    @property
    def length(self) -> int:
        """Length in intervals."""
        return self.stop - self.start

    @property
    def rows(self) -> slice:
        """The segment's frames as rows of `base`."""
        return slice(self.offset, self.offset + self.length + 1)

    def poses(self, rotations: FloatArray) -> Poses:
        """Return the world poses of several candidates, with the translations of the segment.

        `rotations` are local, of all joints in the segment's frames, one candidate after the other:
        shape (n_candidates * n_frames, n_joints, 4).
        """
        frames = np.arange(self.start, self.stop + 1)
        n = len(rotations) // len(frames)
        offsets = np.tile(self.base.positions[self.rows], (n, 1, 1))
        transforms = forward_kinematics(self.base.skeleton.parents, rotations, offsets)
        return self.body.with_poses(np.tile(frames, n), *transforms)


@dataclass(frozen=True, eq=False)
class ChosenDonor:
    """The donor of one group for a committed segment."""

    index: int  # of the candidate
    placed: PlacedDonor
    boundary: BoundaryStates  # of the donor before seam treatment, for seam costs
    gap: float  # mean joint angle to the donor before it, in radians; 0 in the first segment


class StreamSearch:
    """The search for donors in a stream, and its state: pending segments and committed donors."""

    def __init__(self, library: Library, groups: Sequence[str]) -> None:
        base, skeleton = library.groups.base, library.skeleton
        self._library, self._lengths = library, library.segments.lengths
        # The base motion follows the clips of the library.
        own_clip = library.entries[0]._replace(name="the base", tags=())
        self.clips: Sequence[Clip] = (*library.entries, own_clip)
        # Joints of each grafted group, parents before children, and those compared at seams.
        self.joints = {group: library.joints(group) for group in groups}
        self._compared = {
            group: feature_joints(skeleton, own) for group, own in self.joints.items()
        }
        self._driven_joints = driven_joints(skeleton, self.joints)
        self._pools = {group: library.pool(group) for group in groups}
        self._read_rotations = lru_cache(_MAX_CACHED_DONORS)(partial(_read_rotations, library))
        self._embedding, self._sigma = library.embedding[base], library.sigma[base]
        if self._embedding is not None:
            points = self._embedding.points
            self._members = ClusterMembers.from_labels(library.labels[base], points)
        self._committed: Mapping[str, ChosenDonor] = {}  # in the last committed segment
        self.set_constraints(())

    def set_constraints(self, constraints: Sequence[Constraint]) -> None:
        """Replace the constraints; the pending segments have to be added again."""
        self.constraints = tuple(constraints)
        self.config = limit_config(self._library.config, constraints)
        self._models = {group: cost_model(self.config, own) for group, own in self._pools.items()}
        self.pending: list[PendingSegment] = []
        self._following: Mapping[str, int] = {}  # donors of the next segment, chosen in advance

    def add_segment(self, base: BaseBuffer, start: int, stop: int) -> None:
        """Append the base segment with the first frame `start` and the last frame `stop`.

        Its candidates satisfy the limits on cluster and length and the hard constraints on clips
        and lengths; a donor that moves a group as the base segment does has a penalty in it.
        """
        library = self._library
        motion, offset = base.motion_with_margin(start, stop)
        excerpt = _single_segment(offset, offset + stop - start, 0)
        segment = _single_segment(start, stop, len(library.entries))
        samples = sample_segments(motion, excerpt, library.spec, library.config)
        members, distances = self._find_donors(samples, segment)
        origin = self._origin_violations(segment, members)
        members, distances = members[origin.is_feasible], distances[origin.is_feasible]
        # The base segment is the last candidate: distance 0, no origin costs, always feasible.
        lengths = np.append(self._lengths[members], segment.lengths)
        origin_costs = np.append(origin.soft[origin.is_feasible], 0.0)
        is_base = np.arange(len(lengths)) == len(members)
        # Unary costs do not depend on seam scales, the only difference between the groups' models.
        model = next(iter(self._models.values()))
        unary_costs = model.unary(segment.lengths, lengths, np.append(distances, 0.0), is_base)
        kept = model.keep_cheapest(unary_costs + origin_costs, is_base, PRESELECTION)
        donors, is_base = np.append(members, -1)[kept], is_base[kept]
        unary_costs, origin_costs = unary_costs[kept], origin_costs[kept]
        ends = boundary_states(motion, excerpt)
        boundary = {group: self._boundary(group, donors, ends) for group in self._pools}
        of_groups = {
            group: unary_costs
            + np.where(
                is_base, 0.0, model.similarity(pool.pose_differences_to_last(boundary[group]))
            )
            for group, pool in self._pools.items()
        }
        # All groups have the same candidates: the cheapest on average.
        costs = sum(of_groups.values()) / len(of_groups) + origin_costs
        kept = model.keep_cheapest(costs, is_base)
        donors, origin_costs = donors[kept], origin_costs[kept]
        pending = PendingSegment(
            body=base.body, base=motion, offset=offset, start=start, stop=stop, donors=donors
        )
        pending.pose_constraints = self._pose_constraints(pending)
        for group, pool in self._pools.items():
            is_copy = np.append(pool.find_copies(samples, donors[:-1]), False)
            copy_costs = np.where(is_copy, INFEASIBLE_PENALTY, 0.0)
            unary_costs = of_groups[group][kept]
            costs = unary_costs + origin_costs + copy_costs
            candidates = GroupCandidates(boundary[group][kept], unary_costs, costs, costs)
            if pending.pose_constraints:
                candidates.sampled = self._sample(pending, group, donors)
                rotations, context = candidates.sampled.frames, motion.rotations[pending.rows]
                candidates.costs = costs + self.pose_costs(pending, group, rotations, context)
            pending.groups[group] = candidates
        self.pending.append(pending)

    def _find_donors(self, samples: Samples, segment: Segments) -> tuple[IntArray, FloatArray]:
        """Return the donors of a base segment by neighbourhood and length, and their distances.

        As in `SegmentPool.neighbours`, the nearest are added if there are too few. Distances are in
        radii. Copies of all groups of the base segment are no donors.
        """
        library, embedding, sigma = self._library, self._embedding, self._sigma
        if embedding is None:
            return np.zeros(0, np.int64), np.zeros(0)
        (point,) = embedding.project(
            features(samples, embedding.joints, embedding.reference, has_root=embedding.has_root)
        )
        neighbourhood = NEIGHBOURHOODS[self.config.neighbourhood]
        for reach in (1.0, neighbourhood.reach):
            members, distances = neighbourhood.find_near(self._members, point, reach * sigma)
            lengths = self._lengths[members]
            fits = length_fits(segment.lengths, lengths, library.rate, self.config)
            fits &= library.is_donor[members]
            members, distances = members[fits], distances[fits] / (sigma or 1.0)
            copied = [pool.find_copies(samples, members) for pool in self._pools.values()]
            is_new = ~np.all(copied, axis=0)
            members, distances = members[is_new], distances[is_new]
            if len(members) >= FEWEST_DONORS:
                break
        if reach > 1.0:
            nearest = np.sort(np.argsort(distances, kind="stable")[:FEWEST_DONORS])
            members, distances = members[nearest], distances[nearest]
        return members, distances

    def commit_first(self, rng: np.random.Generator) -> tuple[dict[str, ChosenDonor], Poses | None]:
        """Choose donors for the pending segments; commit those of the first, and remove it.

        The results are the donor of each group, and the poses with all of them; None if no pose
        constraint applies. Groups are chosen one after the other: pose constraints on a group are
        evaluated with the donors of the groups before it.
        """
        segment, config = self.pending[0], self.config
        uses_next = SEAM_TREATMENTS[config.seam].uses_next_donor and len(self.pending) > 1
        chosen: dict[str, ChosenDonor] = {}
        following: dict[str, int] = {}
        context = segment.base.rotations[segment.rows].copy()
        for group, joints in self.joints.items():
            candidates, previous = segment.groups[group], self._committed.get(group)
            end = None if previous is None else previous.placed
            costs, all_placed = candidates.origin_costs, None
            if candidates.sampled is not None:
                all_placed = candidates.sampled.place(end, config)
                costs = costs + self.pose_costs(segment, group, all_placed[:, :-2], context)
            trellis = self._trellis(group, costs)
            if all_placed is None and group in self._following:
                is_known = segment.donors == self._following[group]
                trellis = trellis.fix(0, int(is_known.argmax()))
            path = DONOR_CHOICES[config.choice].choose_path(trellis, config, rng)
            index = int(path[0])
            if candidates.sampled is not None and all_placed is not None:
                placed = candidates.sampled.select(all_placed, index)
            else:
                sampled = self._sample(segment, group, segment.donors[[index]])
                if uses_next:
                    following[group] = int(self.pending[1].donors[path[1]])
                    donors = np.array([following[group]])
                    next_sampled = self._sample(self.pending[1], group, donors)
                    placed = sampled.smooth_with(next_sampled, end, config)
                else:
                    placed = sampled.select(sampled.place(end, config), 0)
            boundary, gap = candidates.boundary[index : index + 1], 0.0
            if previous is not None:
                gap = float(pose_gaps(previous.boundary.last, boundary.first)[0, 0])
            chosen[group] = ChosenDonor(index, placed, boundary, gap)
            context[:, joints] = placed.frames
        self._following, self._committed = following, chosen
        del self.pending[0]
        poses = segment.poses(context) if segment.pose_constraints else None
        return chosen, poses

    def pose_costs(
        self, segment: PendingSegment, group: str, rotations: FloatArray, context: FloatArray
    ) -> FloatArray:
        """Return the costs of pose constraints for candidates of a group, shape (n_candidates,).

        `rotations` are those of the group's joints, of shape
        (n_candidates, n_frames, n_group_joints, 4); `context` has those of all joints, of shape
        (n_frames, n_joints, 4). If a segment is committed, the first frame is committed with it and
        does not count.
        """
        n, first = len(rotations), 1 if self._committed else 0
        local = np.tile(context, (n, 1, 1))
        local[:, self.joints[group]] = rotations.reshape(-1, *rotations.shape[2:])
        poses, joints = segment.poses(local), self._driven_joints[group]
        errors = [constraint.errors(poses, joints)[0] for constraint in segment.pose_constraints]
        amounts = [own.reshape(n, -1)[:, first:].max(axis=1) for own in errors]
        return ConstraintViolations.from_amounts(segment.pose_constraints, amounts, n).costs()

    def _origin_violations(self, segment: Segments, members: IntArray) -> ConstraintViolations:
        repeated = segment[np.zeros(len(members), np.int64)]
        donors = self._library.segments[members]
        amounts = origin_violations(self.constraints, "", repeated, donors, repeated, self.clips)
        return ConstraintViolations.from_amounts(self.constraints, amounts, len(members))

    def _pose_constraints(self, segment: PendingSegment) -> list[Constraint]:
        """Return the pose constraints that apply in a segment.

        Each `AvoidSelf` allows body parts to penetrate each other as deeply as they do in the
        captured poses of the segment.
        """
        frames = np.arange(segment.start, segment.stop + 1)
        constraints = [
            own for own in self.constraints if own.is_on_poses and own.applies(frames).any()
        ]
        if any(isinstance(own, AvoidSelf) for own in constraints):
            captured = segment.poses(segment.base.rotations[segment.rows])
            constraints = with_captured_depth(constraints, captured)
        return constraints

    def _boundary(
        self, group: str, donors: IntArray, ends: Mapping[str, FloatArray]
    ) -> BoundaryStates:
        """Return the boundary states of donors; `ends` are those of the base, the last of them."""
        joints = self._compared[group]
        base = BoundaryStates(**{name: states[:, joints] for name, states in ends.items()})
        return BoundaryStates.concatenate([self._pools[group].boundary[donors[:-1]], base])

    def _sample(self, segment: PendingSegment, group: str, donors: IntArray) -> SampledDonors:
        first, last = segment.offset, segment.offset + segment.length
        own = frames_with_neighbours(segment.base.rotations, first, last)
        tracks = [own if donor < 0 else self._read_rotations(donor) for donor in donors.tolist()]
        return SampledDonors.of(tracks, self.joints[group], segment.length, self._library.rate)

    def _trellis(self, group: str, first_costs: FloatArray) -> Trellis:
        """Return the trellis of one group over the pending segments.

        `first_costs` are the costs of the candidates in the first segment, without those of its
        seam to the committed segment.
        """
        candidates, model = [segment.groups[group] for segment in self.pending], self._models[group]
        if group in self._committed:
            boundary = self._committed[group].boundary
            first_costs = first_costs + model.seam_costs(boundary, candidates[0].boundary)[0]
        return Trellis(
            (first_costs, *(following.costs for following in candidates[1:])),
            tuple(before.seam_costs_to(after, model) for before, after in pairwise(candidates)),
        )


def _read_rotations(library: Library, segment: int) -> FloatArray:
    """Return the rotations of a donor, as from `frames_with_neighbours`."""
    segments = library.segments
    clip = library.clips[segments.clip[segment]]
    start, stop = int(segments.start[segment]), int(segments.stop[segment])
    return frames_with_neighbours(clip.rotations, start, stop)


def _single_segment(start: int, stop: int, clip: int) -> Segments:
    return Segments(np.array([start]), np.array([stop]), np.array([clip]))
