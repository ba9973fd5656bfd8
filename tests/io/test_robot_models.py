"""Models of robots against MuJoCo, and models that are refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.io.robots.poses import Pose, to_motion
from mograft.io.robots.trackers import body_transforms
from mograft.motion import rotations
from mograft.motion.hinges import Hinges, TableLayout
from tests.io.robot_files import random_robot, to_mjcf, to_urdf
from tests.strategies import SEEDS, assert_same_rotations, few_examples

LEG = '<body name="leg"><joint name="knee" axis="0 1 0"/></body>'


def written(folder, text, name="robot.xml"):
    path = folder / name
    path.write_text(text)
    return path


def mjcf(bodies, top=""):
    return f'<mujoco>{top}<worldbody><body name="base">\n{bodies}\n</body></worldbody></mujoco>'


@few_examples(40)
@given(seed=SEEDS, degrees=st.booleans())
def test_read_model_bodies_match_mujoco(tmp_path_factory, seed, degrees):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    text = to_mjcf(random_robot(seed), degrees=degrees)
    path, rng = written(tmp_path_factory.mktemp("model"), text), np.random.default_rng(seed)
    model = mg.formats.read_model(path, quaternion="wxyz", rate={"a*": 50})
    oracle = mujoco.MjModel.from_xml_path(str(path))
    hinges, data = model.hinges, mujoco.MjData(oracle)
    assert hinges.names == tuple(oracle.joint(own).name for own in range(1, oracle.njnt))
    np.testing.assert_allclose(hinges.limits, oracle.jnt_range[1:], atol=1e-12)
    angles = rng.uniform(*hinges.limits.T)
    place, quat = rng.normal(size=3), rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    data.qpos[:] = np.concatenate([place, quat, angles])
    mujoco.mj_kinematics(oracle, data)
    pose = Pose(place[None], quat[None, [1, 2, 3, 0]], angles[None])
    motion = to_motion(model, pose, TableLayout())
    moved = np.flatnonzero(oracle.body_jntnum)
    turned, places = body_transforms(motion)
    np.testing.assert_allclose(places[0], data.xpos[moved], atol=1e-12)
    assert_same_rotations(turned[0], data.xquat[moved][:, [1, 2, 3, 0]])
    world, joints = motion.world_transforms()
    centers = joints + rotations.rotate(world, hinges.centers)
    center = (hinges.masses[:, None] * centers[0]).sum(axis=0)
    expected = (oracle.body_mass[:, None] * data.xipos).sum(axis=0)
    np.testing.assert_allclose(center, expected, atol=1e-11)
    again = Hinges.from_json(hinges.to_json())
    for field, value in vars(hinges).items():
        np.testing.assert_array_equal(getattr(again, field), value, field)


@few_examples(20)
@given(seed=SEEDS)
def test_read_model_urdf_and_mjcf_give_the_same_skeleton(tmp_path_factory, seed):
    folder, parts = tmp_path_factory.mktemp("urdf"), random_robot(seed, several=False)
    one = mg.formats.read_model(written(folder, to_mjcf(parts)))
    other = mg.formats.read_model(written(folder, to_urdf(parts), "robot.urdf"))
    assert one.names == other.names
    np.testing.assert_array_equal(one.parents, other.parents)
    np.testing.assert_allclose(one.offsets, other.offsets, atol=1e-9)
    ours, theirs = one.hinges, other.hinges
    assert ours.names == theirs.names
    assert (theirs.speeds == 7).all()
    for field in ("joints", "bodies", "axes", "limits", "centers", "masses"):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), atol=1e-9)


@pytest.mark.parametrize("order", ["xyz", "zyx", "XYZ", "YZX", "xzx"])
def test_read_model_euler_angles_match_mujoco(tmp_path, order):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    shape = '<geom size="1" mass="1"/>'
    inner = f'<body euler="20 -40 70">{shape}<joint name="j"/></body>'
    text = (
        f'<mujoco><compiler eulerseq="{order}"/><worldbody><body><freejoint/>{shape}{inner}</body>'
    )
    path = written(tmp_path, f"{text}</worldbody></mujoco>")
    oracle = mujoco.MjModel.from_xml_path(str(path))
    frame = mg.formats.read_model(path).hinges.frames[1]
    np.testing.assert_allclose(abs(frame @ oracle.body_quat[2][[1, 2, 3, 0]]), 1.0, atol=1e-12)


def test_read_model_reads_classes_and_their_defaults(tmp_path):
    top = (
        '<default><joint range="-1 1"/><default class="a"><joint axis="1 0 0"/>'
        '<default class="b"><joint range="-2 2"/></default></default></default>'
        '<compiler angle="radian"/>'
    )
    bodies = (
        '<body name="x" childclass="a"><joint name="jx"/><body name="y">'
        '<joint name="jy" class="b"/></body></body>'
        '<body name="z"><joint name="jz" limited="false"/></body>'
    )
    hinges = mg.formats.read_model(written(tmp_path, mjcf(bodies, top))).hinges
    np.testing.assert_array_equal(hinges.axes, [[1, 0, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(hinges.limits[:2], [[-1, 1], [-2, 2]])
    assert hinges.limits[2, 1] >= 1e9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (mjcf('<body name="b"><joint type="ball"/></body>'), "line 2: expected a hinge, got"),
        (mjcf(f'{LEG}<body name="b"><freejoint/></body>'), "line 2: expected a hinge"),
        (mjcf("<frame/>"), "line 2: <frame> is not supported"),
        (mjcf('<body name="b"><joint name="j" axis="0 0 0"/></body>'), "line 2: expected an axis"),
        (mjcf('<body name="b"><joint name="j" axis="0 x 0"/></body>'), "line 2: expected 3 finite"),
        (mjcf('<body name="b" xyaxes="1 0 0 0 1 0"/>'), "line 2: xyaxes is not supported"),
        (mjcf('<body name="b"><joint name="j" range="2 1"/></body>'), "line 2: expected an ascend"),
        (mjcf('<body name="b"><joint name="j" ref="1"/></body>'), "line 2: expected a joint with"),
        (mjcf('<body name="b"><joint name="j" class="c"/></body>'), "line 2: expected a class"),
        (mjcf(LEG + LEG), "line 1: expected joints of different names, got knee, knee"),
        (mjcf(""), "line 1: expected at least one hinge joint, got none"),
        ("<mujoco/>", "line 1: expected one body with a free joint, got 0"),
        ("<svg/>", "line 1: expected the element mujoco or robot, got svg"),
        ("no XML", "line 1: expected XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>\n<mujoco/>', "line 1: document types and entities"),
        ("<a>" * 300 + "</a>" * 300, "line 1: expected at most 256 levels"),
        ("<mujoco>" + "<a/>" * 600_000 + "</mujoco>", "expected at most 2 MiB of XML, got more"),
        ('<robot><link name="a"/><link name="b"/></robot>', "expected one link that is no child"),
        (
            '<robot><link name="a"/><link name="b"/>\n<joint name="j" type="prismatic">'
            '<parent link="a"/><child link="b"/></joint></robot>',
            "line 2: expected a joint of type revolute, continuous, fixed, got prismatic",
        ),
        (
            '<robot><link name="a"/>\n<joint name="j" type="fixed"><parent link="a"/>'
            '<child link="c"/></joint></robot>',
            "line 2: expected the name of a link, got 'c'",
        ),
    ],
)
def test_read_model_states_the_line_of_what_is_not_supported(tmp_path, text, message):
    path = written(tmp_path, text)
    with pytest.raises(mg.FormatError) as caught:
        mg.formats.read_model(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [({"quaternion": "zyx"}, "`quaternion` must be"), ({"rate": 0}, "1 / `rate`")],
)
def test_read_model_wrong_argument_raises_value_error(tmp_path, given, message):
    with pytest.raises(ValueError, match=message):
        mg.formats.read_model(written(tmp_path, mjcf(LEG)), **given)
