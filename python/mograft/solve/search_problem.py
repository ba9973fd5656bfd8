"""The search problem: a base motion, the candidate donors, and the constraints on the result."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.transplant import GraftedGroup
from mograft.blend.trunk_lean import TrunkLean
from mograft.body.anatomy import feature_joints
from mograft.body.capsules import Poses
from mograft.body.contacts import find_legs
from mograft.body.groups import suggest_groups
from mograft.body.loops import is_loop
from mograft.body.size import resize
from mograft.config import Config
from mograft.errors import join_names, suggest_frames, suggest_name
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton
from mograft.scenario.scenario import joints_of_donors
from mograft.search.constraints import Constraint, Span, overlaps
from mograft.search.costs import ConstraintViolations, CostModel, origin_violations
from mograft.search.donor_choice import DONOR_CHOICES, cost_model
from mograft.search.donor_constraints import Ban, DonorReference, Use, limit_config
from mograft.search.pose_constraints import with_captured_depth
from mograft.search.segment_pool import SegmentPool
from mograft.search.trellis import DonorSequences


def check_constraints(constraints: Sequence[Constraint], poses: Poses) -> None:
    """Check the types of constraints and the joint names in them.

    `poses` has at least one pose of the skeleton to which the constraints apply. An item that is
    not a constraint raises TypeError; a joint name that the skeleton lacks raises ValueError.
    """
    if not isinstance(constraints, Collection):
        raise TypeError(f"`constraints` must be a list of constraints, got {constraints!r}")
    for constraint in constraints:
        if not isinstance(constraint, Constraint):
            raise TypeError(f"`constraints` must contain only constraints, got {constraint!r}")
        frame = 0 if constraint.frames is None else constraint.frames[0]
        # Evaluating a pose looks up every joint that the constraint names.
        first = poses.with_poses(np.array([frame]), poses.rotations[:1], poses.positions[:1])
        constraint.errors(first)


def check_frames(constraints: Sequence[Constraint], base: Motion) -> None:
    """Raise ValueError if the frames of a constraint end after the last frame of a base motion."""
    for constraint in constraints:
        if constraint.frames is not None and constraint.frames[1] >= base.n_frames:
            raise ValueError(
                f"frames of `{type(constraint).__name__}` must be within 0 to {base.n_frames - 1} "
                f"({base.duration:.6g} s), {suggest_frames(constraint.frames, base.n_frames - 1)}"
            )


def resolve_segments(
    constraints: Sequence[Constraint],
    groups: Sequence[str],
    base_segments: Segments,
    library: Library,
) -> list[Constraint]:
    """Replace the segment numbers in `Use` and `Ban` constraints by frames.

    `groups` are the exchanged groups. Raise ValueError for a group, a segment or a clip that does
    not exist.
    """
    for constraint in constraints:
        group = getattr(constraint, "group", None)
        if group is not None and group not in groups:
            raise ValueError(
                f"`group` of {type(constraint).__name__} must be an exchanged group, one of "
                f"{join_names(groups)}; got {group!r}{suggest_groups(group, groups)}"
            )
    return [
        _resolve(constraint, base_segments, library)
        if isinstance(constraint, Use | Ban)
        else constraint
        for constraint in constraints
    ]


def _resolve(constraint: Use | Ban, base_segments: Segments, library: Library) -> Use | Ban:
    """Resolve the segment and the donor of a constraint; one error reports both if invalid."""
    try:
        frames = _base_frames(constraint, base_segments)
    except ValueError as error:
        try:
            _donor_frames(constraint, library)
        except ValueError as other:
            raise ValueError(f"{error} {other}") from None
        raise
    donor = _donor_frames(constraint, library)
    return replace(constraint, segment=None, frames=frames, donor=donor)


def used_donors(
    constraints: Sequence[Constraint], base_segments: Segments, library: Library
) -> list[IntArray]:
    """Return for each position the donors that `Use` constraints name, ascending.

    The constraints are results of `resolve_segments`.
    """
    lists = [np.zeros(0, np.int64)] * len(base_segments)
    for constraint in constraints:
        if isinstance(constraint, Use):
            errors = constraint.donor_errors(library.segments, library.segments, library.entries)
            for position in np.flatnonzero(overlaps(base_segments, constraint.frames)).tolist():
                lists[position] = np.union1d(lists[position], np.flatnonzero(errors == 0.0))
    return lists


def _base_frames(constraint: Use | Ban, segments: Segments) -> Span:
    """Return the first and last frame of the base segments to which a constraint applies."""
    name, number = type(constraint).__name__, constraint.segment
    if number is not None:
        if number >= len(segments):
            raise ValueError(
                f"`segment` of {name} must be 0 to {len(segments) - 1}, got {number}; "
                f"{_describe_segment(segments, (number, number), is_number=True)}"
            )
        return int(segments.start[number]), int(segments.stop[number])
    assert constraint.frames is not None
    if isinstance(constraint, Use):
        _check_segment(f"`frames` of {name}", "the base", constraint.frames, segments)
    return constraint.frames


def _donor_frames(constraint: Use | Ban, library: Library) -> DonorReference | None:
    """Return the donor as clip, first and last frame; a clip name alone or None is unchanged."""
    name, donor, segments = type(constraint).__name__, constraint.donor, library.segments
    clips = library.names
    if donor is None:
        return None
    if isinstance(donor, int):
        if donor >= len(segments):
            raise ValueError(f"`donor` of {name} must be 0 to {len(segments) - 1}, got {donor}")
        clip = clips[segments.clip[donor]]
        return clip, int(segments.start[donor]), int(segments.stop[donor])
    clip = donor if isinstance(donor, str) else donor[0]
    if clip not in clips:
        raise ValueError(
            f"`donor` of {name} must be from a clip among {join_names(clips)}; "
            f"got {clip!r}{suggest_name(clip, clips)}"
        )
    if isinstance(donor, tuple):
        own = segments[segments.of_clip(clips.index(clip))]
        span = donor[1:]
        if isinstance(constraint, Use) or not overlaps(own, span).any():
            _check_segment(f"`donor` of {name}", clip, span, own)
    return donor


def _check_segment(subject: str, clip: str, frames: Span, segments: Segments) -> None:
    """Raise ValueError unless `frames` are the first and last frame of one of `segments`."""
    if not ((segments.start == frames[0]) & (segments.stop == frames[1])).any():
        raise ValueError(
            f"{subject} must be a segment of {clip}, got {frames[0]}-{frames[1]}; "
            f"{_describe_segment(segments, frames)}"
        )


def _describe_segment(segments: Segments, frames: Span, *, is_number: bool = False) -> str:
    """Return which of `segments` has most of `frames`, as a message ends.

    The message suggests the number of the segment if `is_number`, otherwise its frames.
    """
    first, last = frames
    # The frame that two segments share belongs to the later one.
    shared = np.minimum(segments.stop - 1, last) - np.maximum(segments.start, first)
    index, n_frames = int(np.argmax(shared)), int(segments.stop[-1])
    span = f"{segments.start[index]}-{segments.stop[index]}"
    which = f"frame {first} is in" if first == last else f"most of frames {first}-{last} is in"
    if first > n_frames:
        which = f"the last frame is {n_frames}, in"
    elif last - first > 2 * (segments.stop[index] - segments.start[index]):
        which = "these are several segments, with most frames in"
    return f"{which} segment {index}, frames {span}; did you mean {index if is_number else span}?"


def driven_joints(skeleton: Skeleton, members: Mapping[str, IntArray]) -> dict[str, BoolArray]:
    """Return for each joint group a mask of the joints that it moves, shape (n_joints,).

    A joint that is in no group is moved by the group of its nearest ancestor that is in one.
    """
    group_of = [""] * skeleton.n_joints
    member_of = {int(joint): group for group, joints in members.items() for joint in joints}
    for joint, parent in enumerate(skeleton.parents):
        inherited = group_of[parent] if parent >= 0 else ""
        group_of[joint] = member_of.get(joint, inherited)
    return {group: np.array([name == group for name in group_of]) for group in members}


@dataclass(frozen=True, eq=False)
class SearchProblem:
    """A base motion, its candidate donors and the constraints. Made by `SearchProblem.build`."""

    library: Library
    base: Motion
    scenario: IntArray  # base segments as indices into the library, shape (n_positions,)
    base_segments: Segments  # the same segments in frames of the base motion
    pools: Mapping[str, SegmentPool]  # by grafted group, in hierarchical order of the groups
    candidates: Mapping[str, Sequence[IntArray]]  # by grafted group, for each position
    constraints: tuple[Constraint, ...]
    config: Config  # of the library, limited by the constraints

    @classmethod
    def build(
        cls,
        library: Library,
        base: Motion,
        scenario: IntArray,
        base_segments: Segments,
        groups: Sequence[str],
        constraints: Sequence[Constraint],
    ) -> "SearchProblem":
        """Find the candidates that satisfy limits on cluster and length, and donor constraints.

        `groups` are in hierarchical order. If `AvoidSelf.captured` is 0, it is set to the largest
        depth of self-collision in the base motion. An item that is not a constraint raises
        TypeError; a constraint with an unknown joint, clip or frame raises ValueError.
        """
        if not isinstance(constraints, Collection) or len(constraints):
            poses = Poses.from_motion(base)
            check_constraints(constraints, poses)
            check_frames(constraints, base)
            constraints = with_captured_depth(constraints, poses)
        config = limit_config(library.config, constraints)
        if not DONOR_CHOICES[config.choice].depends_on_costs:
            config = replace(config, max_candidates=len(library.segments))
        constraints = resolve_segments(constraints, groups, base_segments, library)
        pools = {group: library.pool(group) for group in groups}
        lists = {}
        for group, pool in pools.items():
            # A constraint can require any donor, so lists are limited only without constraints.
            model = None if constraints else cost_model(config, pool)
            found = pool.candidate_lists(scenario, config, model)
            own = [constraint for constraint in constraints if constraint.applies_to_group(group)]
            used = used_donors(own, base_segments, library)
            pairs = zip(found, used, strict=True)
            lists[group] = [np.union1d(*pair) if len(pair[1]) else pair[0] for pair in pairs]
        problem = cls(
            library=library,
            base=base,
            scenario=scenario,
            base_segments=base_segments,
            pools=pools,
            candidates=lists,
            constraints=tuple(constraints),
            config=config,
        )
        allowed = {group: problem._allowed_by_origin(group) for group in groups}
        return replace(problem, candidates=allowed)

    @cached_property
    def base_poses(self) -> Poses:
        """The world poses of the base motion."""
        return Poses.from_motion(self.base)

    def poses_of(self, motion: Motion) -> Poses:
        """Return the world poses of all frames of a motion of the same skeleton."""
        return self.base_poses.with_poses(np.arange(motion.n_frames), *motion.world_transforms())

    def sized_clip(self, clip: int) -> Motion:
        """Return a clip of the library in the size of the base; see `resize`."""
        return resize(self.library.clips[clip], self.base.skeleton)

    @cached_property
    def cost_models(self) -> dict[str, CostModel]:
        """The cost model of each grafted group."""
        return {group: cost_model(self.config, pool) for group, pool in self.pools.items()}

    @cached_property
    def driven_joints(self) -> dict[str, BoolArray]:
        """For each grafted group, a mask of the joints that it moves; see `driven_joints`."""
        members = {group: self.library.joints(group) for group in self.pools}
        return driven_joints(self.base.skeleton, members)

    @cached_property
    def movable_legs(self) -> list[bool]:
        """For each leg of `find_legs`, whether the grafted groups contain hip, knee and ankle."""
        joints = {joint for own in self.group_specs.values() for joint in own.whole_joints.tolist()}
        legs = find_legs(self.base.skeleton)
        return [{leg.hip, leg.knee, leg.ankle} <= joints for leg in legs]

    @cached_property
    def base_joints(self) -> IntArray:
        """The joints of the base group, without the root, whose poses are compared."""
        compared = feature_joints(self.base.skeleton, self.library.joints(self.library.groups.base))
        return np.setdiff1d(compared, [self.library.root])

    @cached_property
    def root_group(self) -> str | None:
        """The grafted group that contains the root and whose donors drive it, or None."""
        root, specs = self.library.root, self.group_specs
        return next((group for group, own in specs.items() if root in own.whole_joints), None)

    @cached_property
    def is_loop(self) -> bool:
        """Whether the last frame of the result meets its first; see `Config.loop`."""
        loop = self.config.loop
        if loop == "off" or self.root_group is not None or self.base.n_frames < 3:
            return False
        return loop == "on" or is_loop(self.base)

    @cached_property
    def group_specs(self) -> dict[str, GraftedGroup]:
        """For each grafted group, its description as an argument of `transplant`."""
        library = self.library
        held = library.groups.divided_channels(library.skeleton)
        return {
            group: GraftedGroup(
                joints=joints_of_donors(library, library.joints(group)),
                root=library.root,
                up=library.up,
                held=held[group],
            )
            for group in self.pools
        }

    @cached_property
    def trunk_leans(self) -> dict[str, TrunkLean]:
        """The trunk joints of each grafted group that keep their lean, and the lean of the base."""
        return {
            group: TrunkLean.from_config(self.base, spec.whole_joints, spec.up, self.config)
            for group, spec in self.group_specs.items()
        }

    @property
    def captured_donors(self) -> DonorSequences:
        """The donor sequences without substitutions: every base segment is its own donor."""
        return {group: self.scenario.copy() for group in self.pools}

    @property
    def pose_constraints(self) -> list[Constraint]:
        """The constraints that depend on poses."""
        return [own for own in self.constraints if own.is_on_poses]

    @cached_property
    def is_constrained_position(self) -> BoolArray:
        """Whether a pose constraint applies at each position, shape (n_positions,)."""
        return self.positions_with(self._find_frames_of(self.pose_constraints))

    @cached_property
    def is_constrained_frame(self) -> BoolArray:
        """Whether a hard pose constraint applies in each frame, shape (n_frames,)."""
        return self._find_frames_of([own for own in self.pose_constraints if own.is_hard])

    def _find_frames_of(self, constraints: Sequence[Constraint]) -> BoolArray:
        """Return whether one of the constraints applies in each frame, shape (n_frames,)."""
        frames = np.arange(self.base.n_frames)
        return np.logical_or.reduce([frames < 0, *(own.applies(frames) for own in constraints)])

    def count_alternatives(self, group: str) -> IntArray:
        """Return how many candidates other than the base segment each position has."""
        pairs = zip(self.candidates[group], self.scenario, strict=True)
        return np.array([np.count_nonzero(own != base) for own, base in pairs], np.int64)

    def positions_with(self, excess: FloatArray | BoolArray) -> BoolArray:
        """Return whether each position has a frame in which `excess` is above 0.

        `excess` is a result of `donor_excess`, shape (n_frames,).
        """
        return self.greatest_at_positions(excess) > 0

    def greatest_at_positions(self, excess: FloatArray | BoolArray) -> FloatArray:
        """Return the greatest `excess` in the frames of each position, first and last included."""
        inside = np.maximum.reduceat(excess, self.base_segments.start)
        return np.maximum(inside, excess[self.base_segments.stop])

    def origin_costs(self, group: str) -> list[FloatArray]:
        """Return for each position the costs of soft constraints on clips and lengths."""
        return [own.soft for own in self._origin_violations(group)]

    def _allowed_by_origin(self, group: str) -> Sequence[IntArray]:
        """Return for each position the candidates that satisfy all hard constraints on donors.

        At a position where none does, the base segment is the only candidate.
        """
        if not self.constraints:
            return self.candidates[group]
        candidates, violations = self.candidates[group], self._origin_violations(group)
        return [
            segments[own.is_feasible if own.is_feasible.any() else segments == base]
            for segments, own, base in zip(candidates, violations, self.scenario, strict=True)
        ]

    def _origin_violations(self, group: str) -> list[ConstraintViolations]:
        """Return for each position how far candidates violate constraints on clips and lengths."""
        lists = self.candidates[group]
        counts = [len(own) for own in lists]
        positions, donors = np.repeat(np.arange(len(lists)), counts), np.concatenate(lists)
        amounts = self.origin_amounts(self.constraints, group, positions, donors)
        found = ConstraintViolations.from_amounts(self.constraints, amounts, len(donors))
        return found.split(counts)

    def origin_amounts(
        self,
        constraints: Sequence[Constraint],
        group: str,
        positions: IntArray | slice,
        donors: IntArray,
    ) -> list[FloatArray]:
        """Return the `origin_violations` of donors of a group, one at each of `positions`."""
        segments = self.library.segments
        base = segments[self.scenario[positions]], segments[donors], self.base_segments[positions]
        return origin_violations(constraints, group, *base, self.library.entries)
