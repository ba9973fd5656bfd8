"""Tables and tracker files of robots: round trips, the order of quaternions, wrong content."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mograft as mg
from mograft.io.robots.poses import Pose, to_motion, to_pose
from mograft.motion import rotations
from mograft.motion.hinges import TableLayout
from tests.fuzz import robots as fuzz_robots
from tests.io import robot_files
from tests.strategies import SEEDS, few_examples

pytestmark = pytest.mark.filterwarnings("ignore:frames per second of robot tables")
ORDERS = {"wxyz": [3, 0, 1, 2], "xyzw": [0, 1, 2, 3]}
LEG = """<body name="{side}_thigh" pos="0 {y} 0">
<joint name="{side}_hip" axis="0 1 0" range="-1 1"/>
<body name="{side}_shin" pos="0 0 -0.35">
<joint name="{side}_knee_joint" axis="0 1 0" range="-1 1"/>
<body name="{side}_foot" pos="0 0 -0.35"/></body></body>"""
BIPED = f"""<mujoco><compiler angle="radian"/><worldbody><body name="pelvis"><freejoint/>
{LEG.format(side="left", y=0.1)}{LEG.format(side="right", y=-0.1)}
</body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def biped(tmp_path_factory):
    path = tmp_path_factory.mktemp("biped") / "biped.xml"
    path.write_text(BIPED)
    return mg.formats.read_model(path)


def upright_pose(model, rng, n_frames=12):
    """A slow turn and a small lean; the robot looks along no axis."""
    time = np.arange(n_frames)
    heading = rng.choice([-1, 1]) * rng.uniform(0.8, 1.8)
    turn = rotations.from_axis_angle([0, 0, 1], heading + 0.05 * time)
    lean = rotations.from_axis_angle([1, 0.3, 0], 0.05 * np.sin(time))
    places = np.stack([0.01 * time, -0.02 * time, 0.69 + 0.004 * np.sin(time)], axis=1)
    angles = robot_files.smooth_angles(model.hinges, rng, n_frames, 0.3)
    return Pose(places, rotations.multiply(turn, lean), angles)


def walking_pose(model, heading, n_frames=60):
    """A walk whose lowest foot stays where it is."""
    time = np.arange(n_frames)
    swing = 0.4 * np.sin(0.2 * time)
    # A knee bends while its leg swings forward, about -y.
    left, right = (0.1 + 0.5 * np.maximum(side * np.cos(0.2 * time), 0) for side in (-1, 1))
    angles = np.stack([swing, left, -swing, right], axis=1)
    quats = np.tile(rotations.from_axis_angle([0, 0, 1], heading), (n_frames, 1))
    return robot_files.standing_pose(model, quats, angles)


def table_text(model, pose, order="xyzw", unit=1.0, *, degrees=False, digits=6, first=None):
    """Return a table with a number of digits; None means numbers of single precision.

    With `first`, the names of the first columns, there is a header.
    """
    turn = 180 / np.pi if degrees else 1.0
    turns = pose.quats[:, ORDERS.get(order, [])]
    if order == "xyz":  # about fixed axes
        turns = turn * Rotation.from_quat(pose.quats).as_euler("xyz")
    rows = np.hstack([pose.positions / unit, turns, turn * pose.angles])
    rows, form = (rows, f".{digits}f") if digits else (rows.astype(np.float32), ".18e")
    lines = [[f"{value:{form}}" for value in row] for row in rows]
    if first is not None:
        for frame, line in enumerate(lines):
            line[:0] = [str(frame) if name == "Frame" else f"{frame / 50:{form}}" for name in first]
        kind = "rotate" if order == "xyz" else "quat"
        names = [*first, *(f"root_pos_{axis}" for axis in "xyz")]
        names += [f"root_{kind}_{axis}" for axis in order]
        lines.insert(0, names + [f"{name}_dof" for name in model.hinges.names])
    return "".join(",".join(line) + "\n" for line in lines)


def written(folder, text, name="walk.csv"):
    path = folder / name
    path.write_text(text)
    return path


@few_examples(60)
@given(
    seed=SEEDS,
    order=st.sampled_from(["wxyz", "xyzw", "xyz"]),
    unit=st.sampled_from([1.0, 0.01, 0.001]),
    degrees=st.booleans(),
    digits=st.none() | st.integers(4, 9),
    first=st.none() | st.lists(st.sampled_from(["Frame", "time"]), unique=True),
    blank=st.sampled_from([", ", " ", "\t"]),
)
def test_read_table_layouts_are_found_and_written_back_digit_for_digit(
    biped, tmp_path_factory, seed, order, unit, degrees, digits, first, blank
):
    folder = tmp_path_factory.mktemp("table")
    pose = upright_pose(biped, np.random.default_rng(seed))
    if order == "xyz" or "time" in (first or ()):
        first, digits = first or [], digits or 6  # only a header states three angles
    layout = {"degrees": degrees, "digits": digits, "first": first}
    text = table_text(biped, pose, order, unit, **layout)
    path = written(folder, text.replace(",", blank))
    clips = mg.read(path, skeleton=biped)
    motion, rate = clips[0], 50 if "time" in (first or ()) else 30
    layout = motion.skeleton.hinges.layout
    assert (layout.quaternion, layout.unit, layout.is_degrees) == (order, unit, degrees)
    assert motion.rate == pytest.approx(rate)
    origin = "50, from the times" if rate == 50 else "30 is assumed; the file states none (--fps)"
    assert clips.notes[2] == f"frames per second: {origin}"
    found = to_pose(motion)
    atol = 2 * 10.0 ** -(digits or 5)
    np.testing.assert_allclose(found.positions, pose.positions, atol=atol)
    np.testing.assert_allclose(found.angles, pose.angles, atol=atol)
    assert rotations.angle(found.quats, pose.quats).max() < 5 * atol
    mg.write(motion, folder / "again.csv")
    assert (folder / "again.csv").read_text() == text


@pytest.mark.parametrize("heading", [0.0, 0.02, 1.5, -3.1, np.pi])
@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_read_table_feet_that_stand_give_the_order_for_any_heading(biped, tmp_path, heading, order):
    pose = walking_pose(biped, heading)
    motion = mg.read(written(tmp_path, table_text(biped, pose, order)), skeleton=biped)[0]
    assert motion.skeleton.hinges.layout.quaternion == order
    np.testing.assert_allclose(motion.positions[:, 0], pose.positions, atol=1e-6)


def read_as(tmp_path, text, **given):
    model = tmp_path / "biped.xml"
    model.write_text(BIPED)
    return mg.read(written(tmp_path, text), skeleton=mg.formats.read_model(model, **given))[0]


@pytest.fixture
def text(biped):
    """A table of 12 frames."""
    return table_text(biped, upright_pose(biped, np.random.default_rng(1)))


def test_read_table_rates_by_glob_apply_to_names_of_files(text, tmp_path):
    assert read_as(tmp_path, text, rate={"w*": 60, "*": 25}).rate == pytest.approx(60)
    assert read_as(tmp_path, text, rate={"x*": 60, "*": 25}).rate == pytest.approx(25)


def test_read_table_ambiguous_order_is_refused_and_can_be_stated(biped, tmp_path):
    """A figure that looks along an axis, and one that is turned by half, have the same numbers."""
    pose = Pose(*(own[[3] * 12] for own in upright_pose(biped, np.random.default_rng(1))))
    pose = pose._replace(quats=np.tile([0.0, 0.0, 0.0, 1.0], (12, 1)))
    text = table_text(biped, pose)
    with pytest.raises(mg.FormatError, match=r"order of quaternions is ambiguous .*--quaternion"):
        read_as(tmp_path, text)
    ahead = read_as(tmp_path, text, quaternion="xyzw")
    np.testing.assert_array_equal(ahead.rotations[:, 0], pose.quats)
    back = read_as(tmp_path, text, quaternion="wxyz")
    np.testing.assert_array_equal(back.rotations[:, 0], np.tile([0.0, 0.0, 1.0, 0.0], (12, 1)))


def test_read_table_one_frame_is_read(text, tmp_path):
    motion = read_as(tmp_path, text.splitlines()[0])
    assert motion.n_frames == 1
    mg.formats.write_tracker(motion, tmp_path / "one.npz")
    assert not np.load(tmp_path / "one.npz")["joint_vel"].any()


def with_cell(row, column, *cells):
    """Return a change of a table: other cells in place of one."""

    def change(text):
        lines = [line.split(",") for line in text.splitlines()]
        lines[row][column : column + 1] = cells
        return "\n".join(map(",".join, lines))

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_cell(3, 8, "nan"), "line 4: expected 11 finite numbers, got 'nan'"),
        (with_cell(0, 8, "nan"), "line 1: expected 11 finite numbers, got 'nan'"),
        (with_cell(3, 8, "inf"), "line 4: expected 11 finite numbers, got 'inf'"),
        (with_cell(3, 8, "a"), "line 4: expected 11 finite numbers, got 'a'"),
        (with_cell(3, 8), "line 4: expected 11 finite numbers, got 10 numbers"),
        (with_cell(3, 8, "1", "2"), "line 4: expected 11 finite numbers, got 12 numbers"),
        (with_cell(3, 4, "0.9"), "in frame 3"),
        (with_cell(3, 8, "9000"), "expected angles within the limits of left_knee_joint"),
        (with_cell(3, 2, "1e9"), "expected heights of the root in m, cm or mm"),
        (lambda _: "", "expected at least one row of numbers"),
        (lambda text: "\n".join(f"{row},0" for row in text.splitlines()), "expected 11 columns"),
        (lambda text: f"{','.join('abcdefghijk')}\n{text}", "expected columns for left_hip, "),
        (
            lambda text: "x,y,q1,q2,q3,q4,q5,left_hip,left_knee,right_hip,right_knee\n" + text,
            "besides the joints, got x, y, q1",
        ),
    ],
    ids=range(13),
)
def test_read_table_wrong_content_raises_format_error(text, tmp_path, change, message):
    with pytest.raises(mg.FormatError, match=message):
        read_as(tmp_path, change(text))


def test_read_table_without_model_raises_format_error(text, tmp_path):
    with pytest.raises(mg.FormatError, match="expected the model of the robot, got none"):
        mg.read(written(tmp_path, text))[0]


def test_write_table_motion_without_hinges_raises_value_error(tmp_path):
    motion = mg.Motion(mg.Skeleton(["a"], [-1], [[0, 0, 0]]), 1.0, [[[0, 0, 0, 1]]], [[[0, 0, 0]]])
    for write in (mg.formats.write_table, mg.formats.write_tracker):
        with pytest.raises(ValueError, match="`motion` must be the motion of a robot"):
            write(motion, tmp_path / "a.csv")


def robot_motion(folder, seed, n_frames=40, rate=2.0):
    path = folder / "robot.xml"
    path.write_text(robot_files.to_mjcf(robot_files.random_robot(seed)))
    model = mg.formats.read_model(path)
    rng = np.random.default_rng(seed)
    angles = robot_files.smooth_angles(model.hinges, rng, n_frames)
    time = np.arange(n_frames)[:, None]
    quats = rotations.exp(0.8 * np.sin(0.1 * time + rng.uniform(0, 6, 3)))
    pose = Pose(np.sin(0.1 * time + rng.uniform(0, 6, 3)), quats, angles)
    return model, to_motion(model, pose, TableLayout("wxyz"), frame_time=1 / rate)


@few_examples(30)
@given(seed=SEEDS, tracker=st.sampled_from(["mjlab", "beyondmimic"]))
def test_write_tracker_has_the_order_and_the_derivatives_of_the_poses_and_is_read_back(
    tmp_path_factory, seed, tracker
):
    """Central differences of a smooth motion differ from derivatives by terms of second order."""
    folder = tmp_path_factory.mktemp("tracker")
    model, motion = robot_motion(folder, seed)
    mg.formats.write_tracker(motion, folder / "a.npz", tracker=tracker)
    again = mg.read(folder / "a.npz", skeleton=model)[0]
    assert again.rate == pytest.approx(2)
    np.testing.assert_allclose(to_pose(again).angles, to_pose(motion).angles, atol=1e-6)
    np.testing.assert_allclose(again.world_positions(), motion.world_positions(), atol=1e-5)
    arrays = dict(np.load(folder / "a.npz"))
    names = arrays["joint_names"].tolist()
    assert sorted(names) == sorted(model.hinges.names)
    depths = [len(model.ancestors(model.index(name))) for name in arrays["body_names"]]
    if tracker == "mjlab":
        assert names == list(model.hinges.names)
    else:
        assert depths == sorted(depths)
    column = names.index(model.hinges.names[-1])
    expected = to_pose(motion).angles[:, -1]
    np.testing.assert_allclose(arrays["joint_pos"][:, column], expected, atol=1e-6)
    places, quats = (arrays[f"body_{own}_w"].astype(float) for own in ("pos", "quat"))
    quats = quats[..., [1, 2, 3, 0]] / np.linalg.norm(quats, axis=-1, keepdims=True)
    turned = rotations.log(rotations.multiply(quats[2:], rotations.inverse(quats[:-2])))
    np.testing.assert_allclose(arrays["body_ang_vel_w"][1:-1], turned, atol=0.12)
    np.testing.assert_allclose(arrays["body_lin_vel_w"][1:-1], places[2:] - places[:-2], atol=0.12)
    speeds = 2 * np.gradient(arrays["joint_pos"].astype(float), axis=0)
    np.testing.assert_allclose(arrays["joint_vel"], speeds, atol=2e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fps": np.zeros_like}, "a rate above 0"),
        ({"joint_pos": lambda a: np.tile(a, 9)}, "array `joint_pos`: expected shape"),
        ({"body_quat_w": lambda a: a[..., ::-1]}, "m away from those of the model"),
        ({"body_quat_w": lambda a: 0.0 * a}, "`rotations` must be finite"),
        (
            {"body_pos_w": lambda a: a + 0.1 * np.arange(a.shape[1])[:, None]},
            "m away from those of the model",
        ),
        ({"joint_pos": lambda a: np.nan * a}, "array `joint_pos`: expected finite numbers"),
    ],
)
def test_read_tracker_wrong_array_raises_format_error(tmp_path, change, message):
    model, motion = robot_motion(tmp_path, 5)
    mg.formats.write_tracker(motion, tmp_path / "a.npz")
    arrays = dict(np.load(tmp_path / "a.npz"))
    for name, value in change.items():
        arrays[name] = value(arrays[name])
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(mg.FormatError, match=message):
        mg.read(tmp_path / "a.npz", skeleton=model)


def test_write_tracker_unknown_tracker_raises_value_error(tmp_path):
    with pytest.raises(ValueError, match="`tracker` must be mjlab or beyondmimic, got 'x'"):
        mg.formats.write_tracker(robot_motion(tmp_path, 5)[1], tmp_path / "a.npz", tracker="x")


@robot_files.needs_g1()
@pytest.mark.parametrize("family", ["g1moves", "kimodo"])
def test_read_table_g1_orders_are_found_and_files_written_back(tmp_path, family):
    model = mg.formats.read_model(robot_files.G1_MODEL)
    files = sorted(robot_files.G1.glob(f"{family}_*.csv"))
    assert len(files) == 5
    for path in files:
        motion = mg.read(path, skeleton=model)[0]
        expected = {"g1moves": "xyzw", "kimodo": "wxyz"}[family]
        assert motion.skeleton.hinges.layout.quaternion == expected
        mg.write(motion, tmp_path / path.name)
        assert (tmp_path / path.name).read_text().rstrip() == path.read_text().rstrip()


@robot_files.needs_g1()
def test_write_tracker_g1_matches_the_file_that_trainers_read(tmp_path):
    path = robot_files.G1 / "g1moves_M_Move10_training.npz"
    motion = mg.read(path, skeleton=mg.formats.read_model(robot_files.G1_MODEL, rate=60))[0]
    mg.formats.write_tracker(motion, tmp_path / "a.npz")
    own, expected = np.load(tmp_path / "a.npz"), np.load(path)
    for name in expected:
        np.testing.assert_allclose(own[name], expected[name], atol=1e-4, err_msg=name)


def test_read_damaged_files_return_a_motion_or_raise_format_error(tmp_path):
    valid = sum(fuzz_robots.check(seed, tmp_path) for seed in range(150))
    assert 5 < valid < 120
