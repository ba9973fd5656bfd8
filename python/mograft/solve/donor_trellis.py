"""Trellises of donors with constraint costs: every candidate is evaluated in its position.

Candidates of most groups are evaluated as they are, before seam treatment. A group that holds
the root drives it with its donors, one after the other: each of its candidates is evaluated at
the root transform to which the cheapest path that ends in the candidate leads.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import merge_axes, split_axes
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms, joint_track
from mograft.body.capsules import Capsules, Poses
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.resample import resample_segment_positions, resample_segments
from mograft.motion.segments import Segments
from mograft.search.constraints import Constraint
from mograft.search.costs import ConstraintViolations
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Sphere
from mograft.search.pose_constraints import Avoid, KeepOut
from mograft.search.trellis import DonorSequences, DonorTrellis
from mograft.solve.assembly import assemble
from mograft.solve.search_problem import SearchProblem

_POSES_PER_CHUNK = 20_000  # poses that are evaluated at a time: some hundred megabytes
_OBSTACLES = (Box, Capsule, Character, HalfSpace, Sphere)

# Quaternions may have norms of 1 ± 1e-6, box distances errors of 1e-7, and positions are rounded.
_RELATIVE_SLACK = 1.001
_POSITION_SLACK = 1e-9


def build_trellis(problem: SearchProblem, group: str, chosen: DonorSequences) -> DonorTrellis:
    """Return the candidates of a group with their costs, constraint costs included.

    `chosen` has the donor sequences of groups whose donors are chosen already. Groups without one
    move as in the base.
    """
    if group == problem.root_group:
        return _build_root_trellis(problem, group, chosen)
    costs = None
    if problem.constraints:
        costs = [own.costs() for own in candidate_violations(problem, group, chosen)]
    return group_trellis(problem, group, problem.candidates[group], costs)


def candidate_violations(
    problem: SearchProblem, group: str, chosen: DonorSequences
) -> list[ConstraintViolations]:
    """Return for each position how far the candidates of a group violate constraints.

    `chosen` is as for `build_trellis`. All candidates satisfy the hard constraints on clips and
    lengths of donors, so `hard` contains violations of pose constraints only.
    """
    lists = problem.candidates[group]
    violations = [
        ConstraintViolations(np.zeros(len(costs)), costs) for costs in problem.origin_costs(group)
    ]
    if not problem.is_constrained_position.any():
        return violations
    context = assemble(problem, chosen) if chosen else problem.base
    active = np.flatnonzero(find_evaluated_positions(problem, group, context))
    intervals = problem.base_segments.lengths[active]
    n_poses = np.array([len(lists[p]) for p in active.tolist()]) * (intervals + 1)
    for positions in split_by_count(active, n_poses):
        counts = [len(lists[p]) for p in positions.tolist()]
        repeated = np.repeat(positions, counts)
        donors = np.concatenate([lists[p] for p in positions.tolist()])
        poses = candidate_poses(problem, group, repeated, donors, context)
        found = candidate_pose_violations(problem, group, repeated, poses)
        for position, own in zip(positions.tolist(), found.split(counts), strict=True):
            origin = violations[position].soft
            violations[position] = ConstraintViolations(own.hard, origin + own.soft)
    return violations


def candidate_pose_violations(
    problem: SearchProblem, group: str, positions: IntArray, poses: Poses
) -> ConstraintViolations:
    """Return how far candidates violate pose constraints; arguments as for `pose_amounts`."""
    constraints = problem.pose_constraints
    amounts = pose_amounts(problem, group, positions, poses, constraints)
    return ConstraintViolations.from_amounts(constraints, amounts, len(positions))


def pose_amounts(
    problem: SearchProblem,
    group: str,
    positions: IntArray,
    poses: Poses,
    constraints: Sequence[Constraint],
) -> list[FloatArray]:
    """Return for each constraint the greatest error of every candidate of a group, in tolerances.

    `positions` has the position of each candidate; `poses` is the result of `candidate_poses`.
    """
    counts = problem.base_segments.lengths[positions] + 1
    starts, joints = np.cumsum(counts) - counts, problem.driven_joints[group]
    return [np.maximum.reduceat(own.errors(poses, joints)[0], starts) for own in constraints]


def _build_root_trellis(problem: SearchProblem, group: str, chosen: DonorSequences) -> DonorTrellis:
    """Return the trellis of the group that contains the root.

    Each candidate is evaluated at the root transform to which the cheapest path before it leads.
    """
    costs = problem.origin_costs(group)
    trellis = group_trellis(problem, group, problem.candidates[group], costs)
    if not problem.is_constrained_position.any():
        return trellis
    context = assemble(problem, chosen) if chosen else problem.base
    roots = RootTransforms.from_motion(context, problem.library.root)
    start = roots[problem.base_segments.start[:1]]
    constraint_costs: list[FloatArray] = []
    total, ends = np.zeros(1), start
    for position, donors in enumerate(trellis.candidates):
        root_start = start[np.zeros(len(donors), np.int64)]
        if position:
            through = total[:, None] + trellis.costs.pairwise[position - 1]
            total, root_start = through.min(axis=0), ends[through.argmin(axis=0)]
        own = np.zeros(len(donors))
        if problem.is_constrained_position[position]:
            positions = np.full(len(donors), position)
            poses = candidate_poses(problem, group, positions, donors, context, root_start)
            own = candidate_pose_violations(problem, group, positions, poses).costs()
        constraint_costs.append(own)
        total = total + trellis.costs.unary[position] + own
        ends = advance_root(problem, donors, root_start)
    return replace(trellis, costs=trellis.costs.add_unary(constraint_costs))


def group_trellis(
    problem: SearchProblem,
    group: str,
    candidates: Sequence[IntArray],
    costs: Sequence[FloatArray] | None = None,
) -> DonorTrellis:
    """Return the trellis of some candidates of a group; `costs` are those of constraints."""
    pool, model = problem.pools[group], problem.cost_models[group]
    trellis = DonorTrellis.build(pool, problem.scenario, candidates, model, costs)
    if not problem.is_loop:
        return trellis
    ends = trellis.candidates[-1], trellis.candidates[0]
    return replace(trellis, join=pool.pairwise_costs(*ends, model))


def split_by_count(items: IntArray, counts: IntArray) -> list[IntArray]:
    """Split items into consecutive chunks of about 20,000 poses each.

    `counts` has the number of poses of each item. Without items the result is empty.
    """
    chunk = np.cumsum(counts) // _POSES_PER_CHUNK
    return np.split(items, np.flatnonzero(np.diff(chunk)) + 1) if len(items) else []


def candidate_poses(
    problem: SearchProblem,
    group: str,
    positions: IntArray,
    donors: IntArray,
    context: Motion | None = None,
    root_start: RootTransforms | None = None,
) -> Poses:
    """Return the world poses of the body if donors replace base segments in one group.

    Each of `donors` replaces the base segment at the same entry of `positions`; both have shape
    (n,). Seams are not treated. The result has all frames of the first position, then of the
    second, and so on. Other joints move as in `context`, by default the base. If the group contains
    the root, each donor is rotated about the up axis and translated over the floor: its
    first frame then has the position and heading of its entry of `root_start`. By default
    `root_start` has the root transforms of the context.
    """
    context = problem.base if context is None else context
    segments = problem.base_segments
    counts = segments.lengths[positions] + 1
    starts = np.cumsum(counts) - counts
    step = np.arange(counts.sum()) - np.repeat(starts, counts)
    frames = np.repeat(segments.start[positions], counts) + step
    local, offsets = context.rotations[frames], context.positions[frames]
    taken = problem.library.segments[donors]
    _insert_rotations(problem, group, taken, counts, frames, local)
    if group == problem.root_group:
        root = problem.library.root
        donor_roots = _resample_roots(problem, taken, counts)
        if root_start is None:
            root_start = RootTransforms.from_motion(context, root)[segments.start[positions]]
        begins, up = donor_roots[starts], problem.library.up
        transform = AlignmentTransform.from_roots(begins, root_start, up)
        moved = transform[np.repeat(np.arange(len(positions)), counts)].apply(donor_roots)
        moved = moved.relative_to_parent(context, frames, root)
        local[:, root], offsets[:, root] = moved.rotations, moved.positions
    motion = replace(problem.base, rotations=local, positions=offsets, channel_values=None)
    return problem.base_poses.with_poses(frames, *motion.world_transforms())


def advance_root(
    problem: SearchProblem, donors: IntArray, root_start: RootTransforms
) -> RootTransforms:
    """Return the root transforms at the ends of n donors, given those at their starts."""
    ends = _resample_roots(problem, problem.library.segments[donors], np.full(len(donors), 2))
    at = 2 * np.arange(len(donors))
    moves = AlignmentTransform.from_roots(ends[at], root_start, problem.library.up)
    return moves.apply(ends[at + 1])


def _insert_rotations(
    problem: SearchProblem,
    group: str,
    taken: Segments,
    counts: IntArray,
    frames: IntArray,
    local: FloatArray,
) -> None:
    """Write the resampled rotations of donors to the group's joints in `local`, in place.

    `taken` are the donors and `counts` their numbers of frames after resampling. `frames` has the
    frame of the base for each row of `local`.
    """
    library = problem.library
    axes, joints = problem.group_specs[group].held, problem.group_specs[group].whole_joints
    lean = problem.trunk_leans[group]
    clip_of_row = np.repeat(taken.clip, counts)
    for clip in np.unique(taken.clip):
        in_clip, rows, motion = taken.clip == clip, clip_of_row == clip, library.clips[clip]
        needed = _captured_frames(taken[in_clip])
        tracks = lean.upright_tracks(motion)[needed], split_axes(motion, axes)[needed]
        resampled = resample_segments(
            np.concatenate(tracks, axis=1),
            np.searchsorted(needed, taken.start[in_clip]),
            np.searchsorted(needed, taken.stop[in_clip]),
            counts[in_clip],
        )
        local[np.ix_(rows, joints)] = resampled[:, : len(joints)]
        for (joint, axis), angle in merge_axes(resampled[:, len(joints) :], axes).items():
            order = problem.base.skeleton.rotation_order(joint)
            euler = rotations.to_euler(local[rows, joint], order)
            euler[:, order.index(axis)] = angle
            local[rows, joint] = rotations.from_euler(euler, order)
    if lean.columns:
        trunk = joints[list(lean.columns)]
        inverse = rotations.inverse(lean.base_leans[frames])
        local[:, trunk] = rotations.multiply(inverse, local[:, trunk])


def _captured_frames(donors: Segments) -> IntArray:
    """Return the frames of a clip that are in any of the donors, which are all of this clip.

    A clip has many times as many frames as a chunk of donors, so that copying and checking all of
    them for each chunk would take time that grows with the square of its length.
    """
    counts = donors.lengths + 1
    offsets = donors.start - (np.cumsum(counts) - counts)
    return np.unique(np.repeat(offsets, counts) + np.arange(counts.sum()))


def _resample_roots(problem: SearchProblem, taken: Segments, counts: IntArray) -> RootTransforms:
    """Return the root transforms of donors in their clips, resampled to `counts` frames each."""
    library = problem.library
    found = RootTransforms(np.empty((counts.sum(), 4)), np.empty((counts.sum(), 3)))
    clip_of_row = np.repeat(taken.clip, counts)
    for clip in np.unique(taken.clip):
        in_clip, rows = taken.clip == clip, clip_of_row == clip
        root = RootTransforms.from_motion(problem.sized_clip(clip), library.root)
        bounds = taken.start[in_clip], taken.stop[in_clip], counts[in_clip]
        turns = resample_segments(root.rotations[:, None], *bounds)
        places = resample_segment_positions(root.positions[:, None], *bounds)
        found.rotations[rows], found.positions[rows] = turns[:, 0], places[:, 0]
    return found


def find_evaluated_positions(problem: SearchProblem, group: str, context: Motion) -> BoolArray:
    """Return whether a candidate of a group may have a pose error, shape (n_positions,).

    The errors of all candidates are 0 at the other positions. Joints that the group does not move
    move as in `context`. The group must not drive the root.
    """
    balls = reachable_balls(problem, group, context)
    bound = np.zeros(problem.base.n_frames)
    for constraint in problem.pose_constraints:
        bound = np.maximum(bound, _error_bound(constraint, balls))
    return problem.is_constrained_position & problem.positions_with(bound)


def reachable_balls(problem: SearchProblem, group: str, context: Motion) -> Poses:
    """Return balls that contain the joints and capsules of a group for every donor.

    The balls are the capsules of the result, which has a pose for each frame of the base. There is
    one ball for each uppermost joint that the group moves. Its radius is the greatest length of a
    chain of bones below the joint, the capsule at the end included.
    """
    skeleton, body = problem.base.skeleton, problem.base_poses.capsules
    extents = dict.fromkeys(range(skeleton.n_joints), 0.0)
    capsule_extents = np.linalg.norm(body.bones, axis=1) + body.radii
    extents.update(zip(body.joints.tolist(), capsule_extents.tolist(), strict=True))
    spec = problem.group_specs[group]
    moved = {*spec.whole_joints.tolist(), *spec.held}
    lengths = [float(np.linalg.norm(own, axis=1).max()) for own in context.positions.swapaxes(0, 1)]
    radii: dict[int, float] = {}
    for joint in np.flatnonzero(problem.driven_joints[group]).tolist():
        chain = [joint, *skeleton.ancestors(joint)]
        # The position of the uppermost moved joint is that of the context.
        depth = max((i for i, own in enumerate(chain) if own in moved), default=0)
        reach = (sum(lengths[own] for own in chain[:depth]) + extents[joint]) * _RELATIVE_SLACK
        radii[chain[depth]] = max(radii.get(chain[depth], 0.0), reach)
    n = len(radii)
    centers = np.empty((context.n_frames, n, 3))
    for column, joint in enumerate(radii):
        centers[:, column] = joint_track(context, joint)[1]
    slack = _POSITION_SLACK * np.abs(centers).max(initial=0.0)
    names, bones, sizes = ("",) * n, np.zeros((n, 3)), np.array(list(radii.values())) + slack
    shape = Capsules(joints=np.arange(n), parts=names, sides=names, bones=bones, radii=sizes)
    quats = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*centers.shape[:2], 4))
    balls = problem.base_poses.with_poses(np.arange(context.n_frames), quats, centers)
    return replace(balls, capsules=shape)


def _error_bound(constraint: Constraint, balls: Poses) -> FloatArray:
    """Return an upper bound of the error of the poses within balls, shape (n_frames,).

    It is infinite for constraints other than the library's own on obstacles: subclasses and other
    obstacles may measure anything.
    """
    if type(constraint) is KeepOut and not constraint.inside:
        constraint = Avoid(constraint.region, frames=constraint.frames)
    if type(constraint) is Avoid and type(constraint.obstacle) in _OBSTACLES:
        return constraint.errors(balls)[0]
    return np.where(constraint.applies(balls.frames), np.inf, 0.0)
