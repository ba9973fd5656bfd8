"""Properties of the poses of donors in their positions, and of the costs that they incur."""

import numpy as np
from hypothesis import given, settings

import mograft as mg
from mograft.blend.rigid_alignment import RootTransforms
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.trellis import DonorTrellis, viterbi
from mograft.solve.donor_trellis import advance_root, build_trellis, candidate_poses
from tests.strategies import SEEDS


def test_candidate_poses_of_base_segments_are_the_base(root_library, make_problem):
    problem = make_problem(root_library)
    positions = np.arange(len(problem.base_segments))
    poses = candidate_poses(problem, "lower", positions, problem.scenario)
    rotations, places = root_library.clips[0].world_transforms()
    np.testing.assert_array_equal(poses.rotations, rotations[poses.frames])
    np.testing.assert_array_equal(poses.positions, places[poses.frames])


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_candidate_poses_with_root_are_the_clip_moved_rigidly_to_the_root_start(
    root_library, make_problem, seed
):
    """The donor has the length of the position, so that no frame is resampled."""
    rng = np.random.default_rng(seed)
    problem, segments = make_problem(root_library), root_library.segments
    position = int(rng.integers(len(problem.base_segments)))
    same_length = np.flatnonzero(segments.lengths == problem.base_segments.lengths[position])
    donor = int(rng.choice(same_length))
    quat = rng.normal(size=(1, 4))
    start = RootTransforms(quat / np.linalg.norm(quat), rng.normal(size=(1, 3)) * 300)
    pair, base = (np.array([position]), np.array([donor])), root_library.clips[0]
    poses = candidate_poses(problem, "lower", *pair, base, start)
    clip = root_library.clips[segments.clip[donor]]
    frames = slice(segments.start[donor], segments.stop[donor] + 1)
    joints = root_library.joints("lower")
    captured, moved = clip.world_positions()[frames][:, joints], poses.positions[:, joints]
    root = int(np.flatnonzero(joints == root_library.root)[0])
    np.testing.assert_allclose(moved[..., 1], captured[..., 1], atol=1e-9)
    np.testing.assert_allclose(moved[0, root, [0, 2]], start.positions[0, [0, 2]], atol=1e-9)
    # On the floor, as complex numbers, the donor is rotated by the change of heading.
    ours, theirs = ((p - p[0, root])[..., [2, 0]] @ [1, 1j] for p in (moved, captured))
    x, y, z, w = clip.world_transforms()[0][frames][0, root_library.root] * [-1, -1, -1, 1]
    a, b, c, d = start.rotations[0]
    heading = 2 * np.arctan2(d * y - a * z + b * w + c * x, d * w - a * x - b * y - c * z)
    np.testing.assert_allclose(ours, theirs * np.exp(1j * heading), atol=1e-8)
    end = advance_root(problem, np.array([donor]), start)
    np.testing.assert_allclose(end.positions[0], poses.positions[-1, root_library.root], atol=1e-9)


def test_root_trellis_costs_are_those_along_the_cheapest_path(
    root_library, make_problem, make_wall
):
    wall = make_wall(root_library)
    face = mg.constraints.Face((0.0, 150.0, 500.0), weight=0.5)
    problem = make_problem(root_library, [wall, face])
    trellis = build_trellis(problem, "lower", {})
    unconstrained = DonorTrellis.build(
        problem.pools["lower"], problem.scenario, trellis.candidates, problem.cost_models["lower"]
    )
    path, root = viterbi(trellis.costs), root_library.root
    start = RootTransforms.from_motion(root_library.clips[0], root)[np.array([0])]
    expected, found = [], []
    for position, donor in enumerate(trellis.donor_sequence(path)):
        pair = np.array([position]), np.array([donor])
        poses = candidate_poses(problem, "lower", *pair, None, start)
        joints = problem.driven_joints["lower"]
        hard, soft = (c.errors(poses, joints)[0].max() for c in problem.constraints)
        penalty = INFEASIBLE_PENALTY * (1 + hard) if hard > 1 else 0.0
        expected.append(penalty + 0.5 * soft**2)
        index = path[position]
        costs = trellis.costs.unary[position][index]
        found.append(costs - unconstrained.costs.unary[position][index])
        start = RootTransforms(poses.rotations[-1:, root], poses.positions[-1:, root])
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
    assert np.ptp(expected) > 0
