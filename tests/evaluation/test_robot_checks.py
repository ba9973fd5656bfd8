"""Checks of robots: each measure on motions in which it is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import mograft as mg
from mograft.evaluation import feasible_limits, robot_checks
from mograft.evaluation.robot_checks import UNITS, describe_checks
from mograft.io.robots.poses import Pose, to_motion, to_pose
from mograft.motion import rotations
from mograft.motion.hinges import TableLayout
from tests.io.robot_files import random_robot, smooth_angles, to_mjcf, write_walks
from tests.strategies import SEEDS, few_examples

pytestmark = pytest.mark.filterwarnings("ignore:frames per second of robot tables")


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    path, files = write_walks(tmp_path_factory.mktemp("walks"))
    model = mg.formats.read_model(path)
    return [mg.read(file, skeleton=model)[0] for file in files]


def changed(motion, **changes):
    """The motion with other numbers of its pose, or other fields of its hinges."""
    model, pose = motion.skeleton, to_pose(motion)
    of_pose = {name: own for name, own in changes.items() if name in Pose._fields}
    hinges = {name: own for name, own in changes.items() if name not in Pose._fields}
    skeleton = replace(model, hinges=replace(model.hinges, **hinges))
    layout = TableLayout()
    return to_motion(skeleton, pose._replace(**of_pose), layout, frame_time=motion.frame_time)


def still(motion, n_frames=60):
    """The robot on straight legs, for some frames."""
    n = len(motion.skeleton.hinges.names)
    places = np.tile([0.0, 0.0, 0.84], (n_frames, 1))
    quats = np.tile(rotations.IDENTITY, (n_frames, 1))
    return changed(motion, positions=places, quats=quats, angles=np.zeros((n_frames, n)))


def test_robot_checks_a_robot_that_stands_moves_and_slides_nowhere(walks):
    checks = robot_checks(still(walks[0]))
    assert list(checks) == list(UNITS)
    for name in ("limits", "speed", "overspeed", "acceleration", "skating", "floor"):
        assert checks[name] == pytest.approx(0.0, abs=1e-6)
    assert checks["zero_moment"] == 0.0


def test_robot_checks_limits_and_overspeed_are_the_largest_excess(walks):
    motion = walks[0]
    angles = to_pose(motion).angles
    limits, speeds = motion.skeleton.hinges.limits, np.full(angles.shape[1], 1e9)
    assert robot_checks(motion)["limits"] == 0.0
    narrow = limits.copy()
    narrow[3, 1] = angles[:, 3].max() - 0.2
    assert robot_checks(changed(motion, limits=narrow))["limits"] == pytest.approx(np.degrees(0.2))
    fastest = np.abs(np.gradient(angles[:, 3])).max() * motion.rate
    speeds[3] = fastest - 0.5
    assert robot_checks(changed(motion, speeds=speeds))["overspeed"] == pytest.approx(0.5)


def test_robot_checks_twice_the_rate_doubles_speed_and_quadruples_acceleration(walks):
    slow = walks[0]
    checks = robot_checks(slow)
    fast = robot_checks(
        mg.Motion(slow.skeleton, slow.frame_time / 2, slow.rotations, slow.positions)
    )
    assert fast["speed"] == pytest.approx(2 * checks["speed"])
    assert fast["acceleration"] == pytest.approx(4 * checks["acceleration"])


def test_robot_checks_masses_decide_where_the_zero_moment_point_is(walks):
    """A heavy torso that is held half a metre in front is outside the feet."""
    motion = still(walks[0])
    hinges = motion.skeleton.hinges
    centers = hinges.centers.copy()
    centers[motion.skeleton.index("torso_link")] += [0.5, 0.0, 0.0]
    masses = np.where(hinges.masses > 0, 0.001, 0.0)
    masses[motion.skeleton.index("torso_link")] = 50.0
    assert robot_checks(changed(motion, masses=masses))["zero_moment"] == 0.0
    leaning = changed(motion, masses=masses, centers=centers)
    assert robot_checks(leaning)["zero_moment"] == 100.0
    assert robot_checks(changed(leaning, masses=0 * masses))["zero_moment"] == 0.0


def test_robot_checks_floor_is_that_of_the_reference(walks):
    motion = walks[0]
    lower = changed(motion, positions=to_pose(motion).positions - [0.0, 0.0, 0.05])
    depth = robot_checks(lower, motion)["floor"] - robot_checks(motion, motion)["floor"]
    assert depth == pytest.approx(5.0)
    assert robot_checks(lower)["floor"] == pytest.approx(robot_checks(motion)["floor"])


@few_examples(10)
@given(seed=SEEDS)
def test_robot_checks_any_tree_and_one_frame_give_finite_numbers(tmp_path_factory, seed):
    path = tmp_path_factory.mktemp("any") / "robot.xml"
    path.write_text(to_mjcf(random_robot(seed)))
    model, rng = mg.formats.read_model(path), np.random.default_rng(seed)
    for n_frames in (1, 2, 30):
        angles = smooth_angles(model.hinges, rng, n_frames)
        quats = np.tile(rotations.IDENTITY, (n_frames, 1))
        motion = to_motion(model, Pose(np.zeros((n_frames, 3)), quats, angles), TableLayout())
        assert np.isfinite(list(robot_checks(motion).values())).all()


def test_feasible_limits_are_kept_by_the_recordings(walks):
    limits = feasible_limits(walks)
    for motion in walks:
        assert all(own <= limits[name] for name, own in robot_checks(motion).items())
    assert limits["speed"] == max(robot_checks(own)["speed"] for own in walks)
    assert describe_checks(limits).count(";") == len(UNITS) - 1


def test_robot_checks_motion_without_hinges_raises_value_error():
    motion = mg.Motion(mg.Skeleton(["a"], [-1], [[0, 0, 0]]), 1.0, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    with pytest.raises(ValueError, match="must be the motion of a robot"):
        robot_checks(motion)
