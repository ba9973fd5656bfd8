"""Positions at which no donor of a group can violate a constraint, found without their poses.

Each chain of joints that a group moves stays within a ball around its uppermost joint, whatever the
donor. A ball that is clear of an obstacle proves that the errors of all candidates are 0.
"""

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.blend.rigid_alignment import joint_track
from mograft.body.capsules import Capsules
from mograft.body.world_poses import Poses
from mograft.motion.motion import Motion
from mograft.search.constraints import Constraint
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Sphere
from mograft.search.pose_constraints import Avoid, KeepOut
from mograft.solve.search_problem import SearchProblem

_OBSTACLES = (Box, Capsule, Character, HalfSpace, Sphere)

# Quaternions may have norms of 1 ± 1e-6, box distances errors of 1e-7, and positions are rounded.
_RELATIVE_SLACK = 1.001
_POSITION_SLACK = 1e-9


def find_evaluated_positions(problem: SearchProblem, group: str, context: Motion) -> BoolArray:
    """Return whether a candidate of a group may have a pose error, shape (n_positions,).

    The errors of all candidates are 0 at the other positions. Joints that the group does not move
    move as in `context`. The group must not drive the root.
    """
    if not problem.is_constrained_position.any():
        return problem.is_constrained_position
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
    moved = {*problem.group_specs[group].whole_joints.tolist(), *problem.divided_channels[group]}
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
    shape = Capsules(
        joints=np.arange(n),
        parts=("",) * n,
        sides=("",) * n,
        bones=np.zeros((n, 3)),
        radii=np.array(list(radii.values())) + slack,
    )
    rotations = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*centers.shape[:2], 4))
    return Poses(
        skeleton=skeleton,
        frames=np.arange(context.n_frames),
        rotations=rotations,
        positions=centers,
        frame_time=problem.base_poses.frame_time,
        capsules=shape,
        height=problem.base_poses.height,
        up=problem.base_poses.up,
    )


def _error_bound(constraint: Constraint, balls: Poses) -> FloatArray:
    """Return an upper bound of the error of the poses within balls, shape (n_frames,).

    It is infinite for constraints other than the library's own on obstacles: subclasses and other
    obstacles may measure anything.
    """
    if type(constraint) is Avoid and type(constraint.obstacle) in _OBSTACLES:
        return constraint.errors(balls)[0]
    if (
        type(constraint) is KeepOut
        and not constraint.inside
        and type(constraint.region) in _OBSTACLES
    ):
        return Avoid(constraint.region, frames=constraint.frames).errors(balls)[0]
    return np.where(constraint.applies(balls.frames), np.inf, 0.0)
