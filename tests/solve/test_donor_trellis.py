"""Poses, costs and evaluated positions of donors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import mograft as mg
import mograft.constraints as mc
from mograft.blend.rigid_alignment import RootTransforms
from mograft.dancer import dance
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.trellis import DonorTrellis, viterbi
from mograft.solve.donor_trellis import (
    advance_root,
    build_trellis,
    candidate_poses,
    candidate_violations,
    find_evaluated_positions,
)
from tests.grafting_fixtures import make_problem
from tests.oracles.constraints import candidate_amounts
from tests.strategies import SEEDS, few_examples


def test_candidate_poses_of_base_segments_are_the_base(root_library):
    problem = make_problem(root_library)
    positions = np.arange(len(problem.base_segments))
    poses = candidate_poses(problem, "lower", positions, problem.scenario)
    rotations, places = root_library.clips[0].world_transforms()
    np.testing.assert_array_equal(poses.rotations, rotations[poses.frames])
    np.testing.assert_array_equal(poses.positions, places[poses.frames])


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_candidate_poses_with_root_are_the_clip_moved_rigidly_to_the_root_start(root_library, seed):
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


def test_root_trellis_costs_are_those_along_the_cheapest_path(root_library, wall):
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


DIVIDED = {
    "lower": ["Hips", "*Leg", "*Foot"],
    "torso": ["Spine.Xrotation", "Spine.Zrotation", "Neck", "Head"],
    "arms": ["Spine.Yrotation", "*Shoulder", "*Arm", "*ForeArm", "*Hand"],
}


@pytest.fixture(scope="module")
def libraries():
    """Libraries of dances whose arms change their lengths, with three kinds of joint groups."""
    motion = dance(seed=1, strides=1).motion[:500]
    positions = motion.positions.copy()
    arms = [motion.skeleton.index(name) for name in ("LeftForeArm", "RightHand", "Neck")]
    stretch = 1.0 + 0.5 * np.sin(np.arange(len(positions)) / 40.0)
    positions[:, arms] *= stretch[:, None, None]
    motion = replace(motion, positions=positions, channel_values=None)
    groups = ["lower_upper", "lower_torso_larm_rarm", mg.JointGroups(DIVIDED, base="lower")]
    return [mg.Library.build(motion, own) for own in groups]


def random_obstacle(rng, place, motion):
    """Return an obstacle of a random kind and size at a place, which may or may not be touched."""
    size = float(rng.uniform(1.0, 40.0))
    direction = rng.normal(size=3)
    quat = rng.normal(size=4)
    return [
        mc.Sphere(place, size),
        mc.Capsule(place, tuple(place + 3.0 * size * direction), size),
        mc.Box(place, (size, 2.0 * size, 1.0), tuple(quat / np.linalg.norm(quat))),
        mc.HalfSpace(place, tuple(direction)),
        mc.Character(motion[:90], offset=tuple(place * [1, 0, 1]), delay=float(rng.uniform(0, 3))),
    ][int(rng.integers(5))]


def random_constraint(rng, motion):
    """Return a random constraint on an obstacle near the path of the body."""
    world = motion.world_positions()
    place = world[rng.integers(len(world)), rng.integers(world.shape[1])]
    place = place + rng.normal(size=3) * rng.choice([0.0, 20.0, 60.0, 150.0])
    obstacle = random_obstacle(rng, place, motion)
    weight = None if rng.integers(2) else float(rng.uniform(0.1, 3.0))
    frames = None if rng.integers(2) else (int(rng.integers(200)), int(rng.integers(200, 499)))
    if rng.integers(4):
        margin = float(rng.uniform(-0.05, 0.1))
        return mc.Avoid(obstacle, margin=margin, weight=weight, frames=frames)
    joint = str(rng.choice(["Head", "LeftHand", "RightForeArm", "RightFoot"]))
    is_inside = bool(rng.integers(2))
    return mc.KeepOut(joint, obstacle, inside=is_inside, weight=weight, frames=frames)


@few_examples(15)
@given(SEEDS)
def test_candidate_violations_match_poses_of_every_candidate_bit_for_bit(libraries, seed):
    """Also with donors of another group chosen already."""
    rng = np.random.default_rng(seed)
    library = libraries[rng.integers(len(libraries))]
    names = [name for name in library.groups.names if name != library.groups.base]
    constraints = [random_constraint(rng, library.clips[0]) for _ in range(rng.integers(1, 3))]
    problem = make_problem(library, constraints, names)
    group, other = rng.choice(names, 2).tolist()
    chosen = {other: np.array([rng.choice(own) for own in problem.candidates[other]])}
    chosen = {} if group == other else chosen
    found = candidate_violations(problem, group, chosen)
    for own, (hard, soft) in zip(found, candidate_amounts(problem, group, chosen), strict=True):
        assert own.hard.tobytes() == hard.tobytes()
        assert own.soft.tobytes() == soft.tobytes()


FAR = (9000.0, 0.0, 0.0)
# What measures something else than a distance of capsules from an obstacle.
OTHER_OBSTACLE, OTHER_CONSTRAINT = (type("Other", (own,), {}) for own in (mc.Sphere, mc.Avoid))


@pytest.mark.parametrize(
    "constraint",
    [
        mc.Avoid(OTHER_OBSTACLE(FAR, 1.0)),
        OTHER_CONSTRAINT(mc.Sphere(FAR, 1.0)),
        mc.KeepOut("LeftHand", mc.Sphere(FAR, 1.0), inside=True),
        mc.AvoidSelf(),
        mc.Custom(lambda poses: poses.positions[:, 0, 1] * 0.0),
    ],
)
def test_positions_of_constraints_without_a_bound_are_all_evaluated(libraries, constraint):
    problem = make_problem(libraries[0], [constraint], ["upper"])
    assert find_evaluated_positions(problem, "upper", problem.base).all()
    bounded = make_problem(libraries[0], [mc.Avoid(mc.Sphere(FAR, 1.0))], ["upper"])
    assert not find_evaluated_positions(bounded, "upper", bounded.base).any()
