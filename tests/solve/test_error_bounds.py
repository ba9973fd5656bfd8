"""Laws of the positions whose candidates are not evaluated: no candidate has an error there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

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


def random_constraints(rng, motion):
    """Return one or two random constraints on obstacles near the path of the body."""
    world = motion.world_positions()
    constraints = []
    for _ in range(int(rng.integers(1, 3))):
        place = world[rng.integers(len(world)), rng.integers(world.shape[1])]
        place = place + rng.normal(size=3) * rng.choice([0.0, 20.0, 60.0, 150.0])
        obstacle = random_obstacle(rng, place, motion)
        weight = None if rng.integers(2) else float(rng.uniform(0.1, 3.0))
        frames = None if rng.integers(2) else (int(rng.integers(200)), int(rng.integers(200, 499)))
        if rng.integers(4):
            margin = float(rng.uniform(-0.05, 0.1))
            constraints.append(mc.Avoid(obstacle, margin=margin, weight=weight, frames=frames))
        else:
            joint = str(rng.choice(["Head", "LeftHand", "RightForeArm", "RightFoot"]))
            inside = bool(rng.integers(2))
            own = mc.KeepOut(joint, obstacle, inside=inside, weight=weight, frames=frames)
            constraints.append(own)
    return constraints


def random_problem(libraries, make_problem, rng):
    """Return a search problem with random constraints, a group, and donors of other groups."""
    library = libraries[int(rng.integers(len(libraries)))]
    names = [name for name in library.groups.names if name != library.groups.base]
    problem = make_problem(library, random_constraints(rng, library.clips[0]), names)
    group, chosen = str(rng.choice(names)), {}
    if len(names) > 1 and rng.integers(2):
        other = str(rng.choice([name for name in names if name != group]))
        chosen[other] = np.array([rng.choice(own) for own in problem.candidates[other]])
    return problem, group, chosen


@settings(few_examples(15), deadline=None)
@given(SEEDS)
def test_candidate_violations_match_poses_of_every_candidate_bit_for_bit(
    libraries, make_problem, seed
):
    problem, group, chosen = random_problem(libraries, make_problem, np.random.default_rng(seed))
    found = candidate_violations(problem, group, chosen)
    for own, (hard, soft) in zip(found, candidate_amounts(problem, group, chosen), strict=True):
        assert own.hard.tobytes() == hard.tobytes()
        assert own.soft.tobytes() == soft.tobytes()


class _Sphere(mc.Sphere):
    """An obstacle that measures something else than a distance from capsules."""


class _Avoid(mc.Avoid):
    """A constraint that may measure something else than a distance from an obstacle."""


@pytest.mark.parametrize(
    "constraint",
    [
        mc.Avoid(_Sphere((9000.0, 0.0, 0.0), 1.0)),
        _Avoid(mc.Sphere((9000.0, 0.0, 0.0), 1.0)),
        mc.KeepOut("LeftHand", mc.Sphere((9000.0, 0.0, 0.0), 1.0), inside=True),
        mc.AvoidSelf(),
        mc.Custom(lambda poses: poses.positions[:, 0, 1] * 0.0),
    ],
)
def test_positions_of_constraints_without_a_bound_are_all_evaluated(
    libraries, make_problem, constraint
):
    problem = make_problem(libraries[0], [constraint], ["upper"])
    assert find_evaluated_positions(problem, "upper", problem.base).all()
    bounded = make_problem(libraries[0], [mc.Avoid(mc.Sphere((9e3, 0.0, 0.0), 1.0))], ["upper"])
    assert not find_evaluated_positions(bounded, "upper", bounded.base).any()
