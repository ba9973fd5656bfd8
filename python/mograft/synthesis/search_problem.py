"""Donors for a base motion under constraints: what they cost, and what must change.

A constraint is looked at twice. Before the search every candidate is put in its place, as it
is, and what it misses becomes a cost. After it the motion is put together, seams and all: what
is missed then is taken out and the search runs again about that place, and where that does not
help, the cheapest rows of a few donors are tried one after the other as they are put together.

A group that holds the root carries the body to where its donors lead, one after the other. Its
candidates are therefore looked at where the cheapest row that ends in them brings the root; what
is missed after that is left to `mograft.synthesis.root_tabu_search`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import merge_axes, split_axes
from mograft.analysis.segmentation import Segments
from mograft.blend.recombine import Part, recombine
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.body.anatomy import feature_joints
from mograft.body.world_poses import Poses
from mograft.config import Config
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.resample import resample_segment_positions
from mograft.motion.resample import resample_segments as resampled
from mograft.motion.skeleton import Skeleton
from mograft.search.candidates import INFEASIBLE_PENALTY, Candidates, DonorTrellis, SegmentPool
from mograft.search.constraints import Constraint
from mograft.search.donor_constraints import MaxAngle
from mograft.search.pose_constraints import AvoidSelf
from mograft.search.viterbi import Trellis, k_best, viterbi

__all__ = ["DonorSequences", "SearchProblem", "check_constraints", "driven_joints", "reasons"]

DonorSequences = dict[str, IntArray]
"""For every grafted group the donor at each position."""

_ROUNDS = 8
_NEAR = 3
"""Positions about a missed one that a repair may come to change."""
_TRIALS = 48
_AT_ONCE = 24
"""Of which so many are put together at a time."""
_LONGEST = 8
"""Positions of a stretch whose rows are tried: of longer ones a few rows are no help."""

_CHUNK = 20_000
"""Poses that are looked at at a time: some hundred megabytes."""


def check_constraints(constraints: Sequence[Constraint], poses: Poses) -> None:
    """Look for what constraints name now, not in the search.

    Parameters
    ----------
    constraints : sequence of Constraint
        The constraints.
    poses : Poses
        Of a skeleton that they are for; its first pose is looked at.

    Raises
    ------
    TypeError
        If something is no constraint.
    ValueError
        If a constraint names a joint that is not there.
    """
    if isinstance(constraints, Constraint):
        raise TypeError(f"constraints must be a list of constraints, got {constraints!r}")
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            raise TypeError(f"constraints must be mograft constraints, got {constraint!r}")
        frame = 0 if constraint.frames is None else constraint.frames[0]
        constraint.errors(
            poses.with_poses(np.array([frame]), poses.rotations[:1], poses.positions[:1])
        )


def driven_joints(skeleton: Skeleton, members: Mapping[str, IntArray]) -> dict[str, BoolArray]:
    """Return for groups of joints the joints that each moves and no group below it does."""
    name = [""] * skeleton.n_joints
    own = {int(joint): group for group, joints in members.items() for joint in joints}
    for joint, parent in enumerate(skeleton.parents):
        name[joint] = own.get(joint, name[parent] if parent >= 0 else "")
    return {group: np.array([n == group for n in name]) for group in members}


@dataclass(frozen=True, eq=False)
class SearchProblem:
    """A base motion, its donors and what is demanded. Made by `SearchProblem.build`.

    Attributes
    ----------
    library : Library
        Where the donors come from.
    base : Motion
        The motion whose base group is kept.
    scenario : ndarray of int, shape (n_positions,)
        Its segments in the library.
    cut : Segments
        The same in frames of the base.
    pools : dict of str to SegmentPool
        For every grafted group what the search sees.
    candidates : dict of str to list of ndarray of int
        For every grafted group the donors that pass at each position.
    constraints : tuple of Constraint
        What is demanded.
    config : Config
        The library's, narrowed by the constraints.
    """

    library: Library
    base: Motion
    scenario: IntArray
    base_segments: Segments
    pools: Mapping[str, SegmentPool]
    candidates: Mapping[str, list[IntArray]]
    constraints: tuple[Constraint, ...]
    config: Config

    @classmethod
    def build(
        cls,
        library: Library,
        base: Motion,
        scenario: IntArray,
        cut: Segments,
        groups: Sequence[str],
        constraints: Sequence[Constraint],
    ) -> "SearchProblem":
        """Return the problem, with those donors that pass by cluster, length and origin.

        Parameters
        ----------
        library, base, scenario, cut
            As the attributes.
        groups : sequence of str
            The groups to graft.
        constraints : sequence of Constraint
            What is demanded.

        Returns
        -------
        SearchProblem
            With the groups in the order in which they hang on each other.

        Raises
        ------
        TypeError
            If something is no constraint.
        ValueError
            If a constraint names a joint, a clip or a frame that is not there.
        """
        poses = Poses.from_motion(base)
        check_constraints(constraints, poses)
        for constraint in constraints:
            if constraint.frames is not None and constraint.frames[0] >= base.n_frames:
                raise ValueError(
                    f"frames of {type(constraint).__name__} must be within 0 to "
                    f"{base.n_frames - 1}, got {constraint.frames[0]}"
                )
        angles = [own.limit for own in constraints if isinstance(own, MaxAngle)]
        config = library.config
        config = replace(config, max_angle=min([config.max_angle, *angles]))
        if config.choice == "random":  # which may take any
            config = replace(config, max_candidates=len(library.segments))
        groups = sorted(groups, key=lambda group: int(library.joints(group).min()))
        pools = {group: library.pool(group) for group in groups}
        constraints = [
            replace(own, captured=own.self_collision_depth(poses))
            if isinstance(own, AvoidSelf) and own.captured == 0
            else own
            for own in constraints
        ]
        candidates = {
            group: pool.candidate_lists(scenario, config) for group, pool in pools.items()
        }
        problem = cls(library, base, scenario, cut, pools, candidates, tuple(constraints), config)
        return replace(problem, candidates={group: problem._passing(group)[0] for group in groups})

    @cached_property
    def poses(self) -> Poses:
        """The base motion's own poses."""
        return Poses.from_motion(self.base)

    @cached_property
    def driven_joints(self) -> dict[str, BoolArray]:
        """For every grafted group the joints that it moves and no group below it does."""
        members = {group: self.library.joints(group) for group in self.pools}
        return driven_joints(self.base.skeleton, members)

    @cached_property
    def held(self) -> dict[str, dict[int, str]]:
        """What each group holds of joints that are divided between groups."""
        return self.library.groups.divided_channels(self.library.skeleton)

    @cached_property
    def root_group(self) -> str | None:
        """The grafted group that holds the root, and so carries the body, if one does."""
        for group in self.pools:
            joints = np.setdiff1d(self.library.joints(group), list(self.held[group]))
            if self.library.root in joints:
                return group
        return None

    @cached_property
    def alignment_joints(self) -> IntArray:
        """The joints by which donors' times are aligned: the base group's, but for the root."""
        library = self.library
        joints = feature_joints(library.skeleton, library.joints(library.groups.base))
        return np.setdiff1d(joints, [library.root])

    def narrowed(self, chosen: DonorSequences) -> "SearchProblem":
        """Return the problem with other donors only where a choice misses something, and near."""
        excess = self.excess(chosen)
        candidates = {}
        for group, lists in self.candidates.items():
            near = self._missed(excess[group])
            for _ in range(_NEAR):
                near = _widened(near)
            candidates[group] = [
                mates if free else np.unique([own, donor])
                for mates, free, own, donor in zip(
                    lists, near, self.scenario, chosen[group], strict=True
                )
            ]
        return replace(self, candidates=candidates)

    @property
    def captured_donors(self) -> DonorSequences:
        """Every segment in its own place."""
        return {group: self.scenario.copy() for group in self.pools}

    def _passing(self, group: str) -> tuple[list[IntArray], list[FloatArray]]:
        """Return the candidates that pass by their origin, and what soft limits on it cost."""
        lists = self.candidates[group]
        counts = [len(own) for own in lists]
        at, donors = np.repeat(np.arange(len(lists)), counts), np.concatenate(lists)
        library = self.library
        own, given = (library.segments[of] for of in (self.scenario[at], donors))
        costs, passes = np.zeros(len(donors)), np.ones(len(donors), bool)
        for constraint in self.constraints:
            miss = constraint.donor_errors(own, given, library.entries)
            if constraint.frames is not None:
                first, last = constraint.frames
                holds = (self.base_segments.start[at] <= last) & (
                    self.base_segments.stop[at] >= first
                )
                miss = np.where(holds, miss, 0.0)
            if constraint.weight is None:
                passes &= miss <= 1.0
            else:
                costs += constraint.weight * miss**2
        passes |= donors == self.scenario[at]
        ends = np.cumsum(counts)[:-1]
        kept = np.split(passes, ends)
        return (
            [mates[keep] for mates, keep in zip(lists, kept, strict=True)],
            [price[keep] for price, keep in zip(np.split(costs, ends), kept, strict=True)],
        )

    def misses(
        self, group: str, chosen: DonorSequences
    ) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return what every candidate of a group misses in its place, as it is.

        Parameters
        ----------
        group : str
            The group.
        chosen : dict of str to ndarray of int
            Donors of the groups that are chosen already; the rest is as captured. They say
            where the root has come to.

        Returns
        -------
        hard : list of ndarray
            At each position the greatest error of each candidate, in tolerances, of any hard
            constraint.
        soft : list of ndarray
            What it misses of soft ones, as a cost.
        """
        lists = self.candidates[group]
        hard = [np.zeros(len(own)) for own in lists]
        _, soft = self._passing(group)
        active = np.flatnonzero(self.active).tolist()
        if not active:
            return hard, soft
        rows = [len(lists[p]) * (int(self.base_segments.lengths[p]) + 1) for p in active]
        chunk = np.cumsum(rows) // _CHUNK
        context = self.assembled(chosen) if chosen else self.base
        for _, members in groupby(zip(chunk.tolist(), active, strict=True), lambda own: own[0]):
            positions = np.array([position for _, position in members])
            counts = [len(lists[p]) for p in positions]
            at, donors = np.repeat(positions, counts), np.concatenate([lists[p] for p in positions])
            poses = self.candidate_poses(group, at, donors, context)
            ends = np.cumsum(counts)[:-1]
            found = (np.split(own, ends) for own in self._missed_by(group, at, poses))
            for position, errors, prices in zip(positions.tolist(), *found, strict=True):
                hard[position] = errors
                soft[position] = soft[position] + prices
        return hard, soft

    @property
    def posed(self) -> list[Constraint]:
        """The constraints that look at poses."""
        return [c for c in self.constraints if type(c).errors is not Constraint.errors]

    @cached_property
    def active(self) -> BoolArray:
        """At which positions a constraint looks at poses."""
        looks = np.zeros(len(self.base_segments), bool)
        for constraint in self.posed:
            first, last = constraint.frames or (0, self.base.n_frames)
            looks |= (self.base_segments.start <= last) & (self.base_segments.stop >= first)
        return looks

    @cached_property
    def applies(self) -> BoolArray:
        """In which frames a hard constraint looks at poses."""
        frames = np.arange(self.base.n_frames)
        looks = [own.applies(frames) for own in self.posed if own.is_hard]
        return np.any(looks, axis=0) if looks else np.zeros(len(frames), bool)

    def _missed_by(self, group: str, at: IntArray, poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Return what candidates in some positions miss, as `misses` does."""
        counts = self.base_segments.lengths[at] + 1
        starts = np.cumsum(counts) - counts
        worst, price = np.zeros(len(at)), np.zeros(len(at))
        for constraint in self.posed:
            error, _ = constraint.errors(poses, self.driven_joints[group])
            most = np.maximum.reduceat(error, starts)
            if constraint.weight is None:
                worst = np.maximum(worst, most)
            else:
                price += constraint.weight * most**2
        return worst, price

    def candidate_poses(
        self,
        group: str,
        at: IntArray,
        donors: IntArray,
        context: Motion | None = None,
        come: RootTransforms | None = None,
    ) -> Poses:
        """Return the body with donors' parts in their places, before any seam is closed.

        Parameters
        ----------
        group : str
            The group.
        at, donors : ndarray of int, shape (n,)
            Positions and donors for them.
        context : Motion, optional
            What the other joints do. Default: the base.
        come : RootTransforms, optional
            Where a root that the group holds has come to when each donor begins. Default: as
            in the context.

        Returns
        -------
        Poses
            All frames of the first donor's place, then of the second's, and so on. A donor
            with the root is its clip turned about up and shifted over the floor, so that its
            first frame stands and heads as `come` does.
        """
        library, joints = self.library, self.library.joints(group)
        context = self.base if context is None else context
        taken = library.segments[donors]
        counts = self.base_segments.lengths[at] + 1
        starts = np.cumsum(counts) - counts
        step = np.arange(counts.sum()) - np.repeat(starts, counts)
        frames = np.repeat(self.base_segments.start[at], counts) + step
        local, places = context.rotations[frames], context.positions[frames]
        which = np.repeat(taken.clip, counts)
        held = self.held[group]
        joints = np.setdiff1d(joints, list(held)).astype(np.int64)
        carried = RootTransforms(np.empty((len(frames), 4)), np.empty((len(frames), 3)))
        for clip in np.unique(taken.clip):
            own, motion = taken.clip == clip, library.clips[clip]
            bounds = taken.start[own], taken.stop[own], counts[own]
            rows = which == clip
            track = np.concatenate([motion.rotations[:, joints], split_axes(motion, held)], axis=1)
            turned = resampled(track, *bounds)
            local[np.ix_(rows, joints)] = turned[:, : len(joints)]
            for (joint, axis), angle in merge_axes(turned[:, len(joints) :], held).items():
                order = self.base.skeleton.rotation_order(joint)
                mixed = rotations.to_euler(local[rows, joint], order)
                mixed[:, order.index(axis)] = angle
                local[rows, joint] = rotations.from_euler(mixed, order)
            if group == self.root_group:
                root = RootTransforms.from_motion(motion, library.root)
                carried.rotations[rows] = resampled(root.rotations[:, None], *bounds)[:, 0]
                carried.positions[rows] = resample_segment_positions(
                    root.positions[:, None], *bounds
                )[:, 0]
        if group == self.root_group:
            come = (
                RootTransforms.from_motion(context, library.root)[self.base_segments.start[at]]
                if come is None
                else come
            )
            goes = AlignmentTransform.from_roots(carried[starts], come, library.up)
            root = goes[np.repeat(np.arange(len(at)), counts)].apply(carried)
            root = root.relative_to_parent(context, frames, library.root)
            local[:, library.root], places[:, library.root] = root.rotations, root.positions
        moved = replace(self.base, rotations=local, positions=places, channel_values=None)
        return self.poses.with_poses(frames, *moved.world_transforms())

    def row(self, group: str, others: DonorSequences) -> DonorTrellis:
        """Return what donors of a group cost, constraints included."""
        if group == self.root_group:
            return self._carried_row(group, others)
        hard, soft = self.misses(group, others)
        more = [_dear(error) + price for error, price in zip(hard, soft, strict=True)]
        return DonorTrellis.build(
            self.pools[group], self.scenario, self.candidates[group], self.config, more
        )

    def _carried_row(self, group: str, others: DonorSequences) -> DonorTrellis:
        """Return what donors cost where the cheapest row that ends in each brings the root.

        The cheapest row of all is looked at where it goes itself; others may go elsewhere.
        """
        _, soft = self._passing(group)
        lists = self.candidates[group]
        row = DonorTrellis.build(self.pools[group], self.scenario, lists, self.config, soft)
        if not self.active.any():
            return row
        context = self.assembled(others) if others else self.base
        begin = RootTransforms.from_motion(context, self.library.root)[self.base_segments.start[:1]]
        more: list[FloatArray] = []
        total, ends = np.zeros(1), begin
        for position, donors in enumerate(row.candidates):
            come = begin[np.zeros(len(donors), np.int64)]
            if position:
                through = total[:, None] + row.costs.pairwise[position - 1]
                total, come = through.min(axis=0), ends[through.argmin(axis=0)]
            dearer = np.zeros(len(donors))
            if self.active[position]:
                at = np.full(len(donors), position)
                poses = self.candidate_poses(group, at, donors, context, come)
                hard, price = self._missed_by(group, at, poses)
                dearer = _dear(hard) + price
            more.append(dearer)
            total = total + row.costs.unary[position] + dearer
            ends = self.led(donors, come)
        return replace(row, costs=row.costs.add_unary(more))

    def led(self, donors: IntArray, come: RootTransforms) -> RootTransforms:
        """Return where donors lead a root that has come somewhere."""
        taken = self.library.segments[donors]
        first, last = (
            RootTransforms(np.empty((len(donors), 4)), np.empty((len(donors), 3))) for _ in range(2)
        )
        for clip in np.unique(taken.clip):
            own = taken.clip == clip
            root = RootTransforms.from_motion(self.library.clips[clip], self.library.root)
            for ends, frames in ((first, taken.start[own]), (last, taken.stop[own])):
                ends.rotations[own], ends.positions[own] = (
                    root.rotations[frames],
                    root.positions[frames],
                )
        return AlignmentTransform.from_roots(first, come, self.library.up).apply(last)

    def over(self, poses: Poses) -> FloatArray:
        """Return by how much each pose misses hard constraints, in tolerances beyond 1.

        Of the constraints the most, and of that the sum over groups.
        """
        found = np.zeros(len(poses))
        for joints in self.driven_joints.values():
            found += self._beyond(poses, joints)
        return found

    def _beyond(self, poses: Poses, joints: BoolArray) -> FloatArray:
        most = np.zeros(len(poses))
        for constraint in self.constraints:
            if constraint.is_hard:
                error, _ = constraint.errors(poses, joints)
                most = np.maximum(most, error - 1.0)
        return most

    def passing(self, group: str) -> list[IntArray]:
        """Return the candidates that meet hard constraints, or all where none does.

        All, too, where a group holds the root: where they will be is known only of a row.
        """
        if self.root_group is not None:
            return self.candidates[group]
        hard, _ = self.misses(group, {})
        return [
            own[error <= 1.0] if (error <= 1.0).any() else own
            for own, error in zip(self.candidates[group], hard, strict=True)
        ]

    def _laid(self, several: Sequence[DonorSequences], first: int, stop: int) -> Motion:
        """Return stretches of the motions of several choices, one behind the other."""
        begin, end = int(self.base_segments.start[first]), int(self.base_segments.stop[stop - 1])
        n, turns = end - begin + 1, len(several)
        some = slice(first, stop)
        shift = np.repeat(n * np.arange(turns) - begin, stop - first)
        cut = Segments(
            np.tile(self.base_segments.start[some], turns) + shift,
            np.tile(self.base_segments.stop[some], turns) + shift,
        )
        quats = np.tile(self.base.rotations[begin : end + 1], (turns, 1, 1))
        places = np.tile(self.base.positions[begin : end + 1], (turns, 1, 1))
        base = replace(self.base, rotations=quats, positions=places, channel_values=None)
        parts: list[Part] = []
        for group in self.pools:
            chosen = [own[group][some] for own in several if group in own]
            if not chosen:
                continue
            part = transplant(
                base,
                cut,
                self.library.segments[np.concatenate(chosen)],
                self.library.clips,
                self.grafted_group(group),
                self.library.config,
            )
            parts.append(part)
        return recombine(base, parts, "")

    def grafted_group(self, group: str) -> GraftedGroup:
        """Return a group as `transplant` takes it."""
        library = self.library
        return GraftedGroup(
            joints=library.joints(group),
            root=library.root,
            up=library.up,
            base_joints=self.alignment_joints,
            held=self.held[group],
        )

    def assembled(self, donors: DonorSequences) -> Motion:
        """Return the motion of some donors, its seams closed."""
        return self._laid([donors], 0, len(self.base_segments))

    def excess(
        self, donors: DonorSequences, first: int = 0, stop: int | None = None
    ) -> dict[str, FloatArray]:
        """Return by how much the motion of some donors misses hard constraints.

        Parameters
        ----------
        donors : dict of str to ndarray of int
            The donors.
        first, stop : int
            Positions to look at; the last is not included. Default: all.

        Returns
        -------
        dict of str to ndarray
            For every group the greatest error in each frame from the first position's first
            to the last position's last, in tolerances beyond 1.
        """
        found = self._excesses([donors], first, len(self.base_segments) if stop is None else stop)
        return {group: own[0] for group, own in found.items()}

    def _excesses(
        self, several: Sequence[DonorSequences], first: int, stop: int
    ) -> dict[str, FloatArray]:
        """Return for several choices what `excess` does for one, shape (n, n_frames)."""
        if self.root_group is not None and len(several) > 1:
            each = [self._excesses([own], first, stop) for own in several]
            return {g: np.concatenate([own[g] for own in each]) for g in self.pools}
        low, high = self._beside(first, stop)
        motion = self._laid(several, low, high)
        begin, end = int(self.base_segments.start[low]), int(self.base_segments.stop[high - 1])
        frames = np.tile(np.arange(begin, end + 1), len(several))
        poses = self.poses.with_poses(frames, *motion.world_transforms())
        inner = slice(
            int(self.base_segments.start[first]) - begin,
            int(self.base_segments.stop[stop - 1]) - begin + 1,
        )
        found = {}
        for group in self.pools:
            most = self._beyond(poses, self.driven_joints[group])
            found[group] = most.reshape(len(several), -1)[:, inner]
        return found

    def _beside(self, first: int, stop: int) -> tuple[int, int]:
        """Return a stretch of positions with so many beside it that its seams are whole.

        All where a group holds the root, whose place is known only from the start.
        """
        if self.root_group is not None:
            return 0, len(self.base_segments)
        start, end = self.base_segments.start[first], self.base_segments.stop[stop - 1]
        reach = int(np.ceil(self.config.seam_blend * self.base.rate))
        low = int(np.searchsorted(self.base_segments.start, start - reach, side="right")) - 1
        high = int(np.searchsorted(self.base_segments.stop, end + reach)) + 1
        return max(min(low, first - 2), 0), min(max(high, stop + 2), len(self.base_segments))

    def settled(self, donors: DonorSequences, rows: Mapping[str, DonorTrellis]) -> DonorSequences:
        """Change donors until the motion put together meets the hard constraints, if it can.

        Parameters
        ----------
        donors : dict of str to ndarray of int
            The choice so far.
        rows : mapping of str to DonorTrellis
            What all donors cost.

        Returns
        -------
        dict of str to ndarray of int
            Of all choices that were tried the one that misses least, and of those the first.
            Nothing is changed but where a constraint is missed, and next to it; and nothing of
            a group that holds the root, for which there is `mograft.synthesis.root_tabu_search`.
        """
        if not any(own.is_hard for own in self.constraints):
            return donors
        # What is not looked at any more, of many candidates, gives way to the captured part.
        chosen = {
            group: np.array(
                [
                    donor if donor in mates else own
                    for donor, mates, own in zip(
                        donors[group], row.candidates, self.scenario, strict=True
                    )
                ],
                np.int64,
            )
            for group, row in rows.items()
        }
        local = {group: row for group, row in rows.items() if group != self.root_group}
        if not local:
            return chosen
        dearer = {group: [np.zeros(len(c)) for c in row.candidates] for group, row in local.items()}
        least, kept = np.inf, chosen
        for _ in range(_ROUNDS):
            excess = self.excess(chosen)
            total = sum(float(own.sum()) for own in excess.values())
            if total < least:
                least, kept = total, {group: own.copy() for group, own in chosen.items()}
            if total == 0:
                return kept
            for group, row in local.items():
                missed = self._missed(excess[group])
                if not missed.any():
                    continue
                choices = row.path(chosen[group])
                for position in np.flatnonzero(missed).tolist():
                    frames = slice(
                        self.base_segments.start[position], self.base_segments.stop[position] + 1
                    )
                    dearer[group][position][choices[position]] += INFEASIBLE_PENALTY * (
                        1.0 + float(excess[group][frames].max())
                    )
                chain = row.costs.add_unary(dearer[group])
                for low, high in _runs(_widened(missed)):
                    choices[low:high] = viterbi(_between(chain, choices, low, high))
                chosen[group] = row.donor_sequence(choices)
        return self._tried(kept, local)

    def _missed(self, excess: FloatArray) -> BoolArray:
        """Tell which positions have a frame in which something is missed."""
        count = np.concatenate([[0], np.cumsum(excess > 0)])
        missed: BoolArray = count[self.base_segments.stop + 1] > count[self.base_segments.start]
        return missed

    def _tried(self, donors: DonorSequences, rows: Mapping[str, DonorTrellis]) -> DonorSequences:
        """Try rows of a few donors, as they are put together, where constraints are still missed.

        First those of least cost, then those that miss least as they are and whose seams,
        which pull at the poses, are the narrowest.
        """
        chosen = dict(donors)
        for group, row in rows.items():
            missed = self._missed(self.excess(chosen)[group])
            windows = [own for own in _runs(_widened(missed)) if own[1] - own[0] <= _LONGEST]
            if not windows:
                continue
            hard, _ = self.misses(group, chosen)
            alone = [
                error[np.searchsorted(every, own)]
                for error, every, own in zip(
                    hard, self.candidates[group], row.candidates, strict=True
                )
            ]
            nearest = Trellis(tuple(alone), row.costs.pairwise)
            for low, high in windows:
                choices = row.path(chosen[group])
                within = Trellis(nearest.unary[low:high], nearest.pairwise[low : high - 1])
                trials = [choices]
                for few in [
                    *k_best(_between(row.costs, choices, low, high), _TRIALS),
                    *k_best(within, 4 * _TRIALS),
                ]:
                    trials.append(choices.copy())
                    trials[-1][low:high] = few
                several = [{**chosen, group: row.donor_sequence(trial)} for trial in trials]
                chosen = self._least(
                    several, max(low - 1, 0), min(high + 1, len(self.base_segments))
                )
        return chosen

    def _least(self, several: Sequence[DonorSequences], first: int, stop: int) -> DonorSequences:
        """Return that of several choices which misses least in a stretch, of equals the first."""
        least, kept = np.inf, several[0]
        for at in range(0, len(several), _AT_ONCE):
            some = several[at : at + _AT_ONCE]
            found = self._excesses(some, first, stop).values()
            totals = np.sum([own.sum(axis=1) for own in found], axis=0)
            if totals.min() < least:
                least, kept = float(totals.min()), some[int(totals.argmin())]
            if least == 0:
                break
        return kept


def _dear(error: FloatArray) -> FloatArray:
    """Return a cost of missing hard constraints: dearer than any seam, and by how much."""
    return np.where(error > 1.0, INFEASIBLE_PENALTY * (1.0 + error), 0.0)


def _widened(missed: BoolArray) -> BoolArray:
    """Return also the neighbours."""
    wide = missed.copy()
    wide[1:] |= missed[:-1]
    wide[:-1] |= missed[1:]
    return wide


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return where runs of true start and stop, the stop not included."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)
    return [(int(low), int(high)) for low, high in edges]


def _between(chain: Trellis, choices: IntArray, low: int, high: int) -> Trellis:
    """Return a stretch of the chain; all beyond it is as chosen."""
    alone = list(chain.unary[low:high])
    if low > 0:
        alone[0] = alone[0] + chain.pairwise[low - 1][choices[low - 1]]
    if high < len(chain):
        alone[-1] = alone[-1] + chain.pairwise[high - 1][:, choices[high]]
    return Trellis(tuple(alone), chain.pairwise[low : high - 1])


def reasons(
    library: Library,
    segment: int,
    group: str,
    judged: Candidates,
    constraints: Sequence[Constraint],
) -> Candidates:
    """Refuse those candidates too that miss hard constraints in a segment's place.

    Parameters
    ----------
    library : Library
        The segments.
    segment : int
        The base segment.
    group : str
        The group to graft.
    judged : Candidates
        What the library's limits leave and refuse.
    constraints : sequence of Constraint
        What a motion on the segment's clip must do.

    Returns
    -------
    Candidates
        With what each refused one misses, and by how much; the base segment's own part too.
    """
    clip = int(library.segments.clip[segment])
    scenario = library.segments.of_clip(clip)
    base, cut = library.clips[clip], library.segments[scenario]
    problem = SearchProblem.build(library, base, scenario, cut, [group], constraints)
    position = int(np.searchsorted(scenario, segment))
    everyone = [*judged.allowed, *judged.refused]
    donors = np.array([c.segment for c in everyone], np.int64)
    at = np.full(len(donors), position)
    told: list[list[str]] = [[c.refused] if c.refused else [] for c in everyone]
    own, given = (library.segments[of] for of in (scenario[at], donors))
    poses = problem.candidate_poses(group, at, donors)
    counts = np.full(len(donors), int(cut.lengths[position]) + 1)
    starts = np.cumsum(counts) - counts
    for constraint in problem.constraints:
        if not constraint.is_hard:
            continue
        error, _ = constraint.errors(poses, problem.driven_joints[group])
        worst = np.maximum.reduceat(error, starts)
        span = constraint.frames
        if span is None or (cut.start[position] <= span[1] and cut.stop[position] >= span[0]):
            worst = np.maximum(worst, constraint.donor_errors(own, given, library.entries))
        for index in np.flatnonzero(worst > 1.0).tolist():
            name = type(constraint).__name__
            said = constraint.describe_error(float(worst[index]), problem.poses.height)
            told[index].append(f"{name}: {said}")
    final = [
        replace(candidate, refused="; ".join(why))
        for candidate, why in zip(everyone, told, strict=True)
    ]
    return Candidates(
        tuple(c for c in final if not c.refused),
        tuple(c for c in final if c.refused),
        judged.elsewhere,
    )
