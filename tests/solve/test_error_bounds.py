"""Laws of the positions whose candidates are not evaluated: no candidate has an error there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import mograft as mg
import mograft.constraints as mc
from mograft.dancer import dance
from mograft.solve.donor_trellis import candidate_violations, find_evaluated_positions
from tests.oracles.constraints import candidate_amounts
from tests.strategies import SEEDS, few_examples

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
def test_candidate_violations_match_poses_of_every_candidate_bit_for_bit(
    libraries, make_problem, seed
):
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
def test_positions_of_constraints_without_a_bound_are_all_evaluated(
    libraries, make_problem, constraint
):
    problem = make_problem(libraries[0], [constraint], ["upper"])
    assert find_evaluated_positions(problem, "upper", problem.base).all()
    bounded = make_problem(libraries[0], [mc.Avoid(mc.Sphere(FAR, 1.0))], ["upper"])
    assert not find_evaluated_positions(bounded, "upper", bounded.base).any()
