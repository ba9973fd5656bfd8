"""The projector of films and strips follows the figure, and agrees with a pinhole camera."""

from math import inf

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.dancer import dance
from mograft.viewing.geometry import front_yaw, project

MOTION = dance(strides=1).motion[:1]
NODES = MOTION.world_positions()[0]
ANGLES = st.floats(-np.pi, np.pi)


def turn(yaw):
    """Return the matrix of a rotation about y that takes +z towards +x."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])


@given(ANGLES, ANGLES, st.floats(0.0, 1.0), st.sampled_from([5.0, inf]))
def test_project_turned_figure_gives_the_same_picture(yaw, beside, tilt, distance):
    pictures = []
    for own in (NODES @ turn(yaw).T, NODES):
        offsets, yaw = (own - own.mean(axis=0)) / 180.0, front_yaw(MOTION.skeleton, own)
        pictures.append(np.stack(project(offsets, yaw + beside, tilt, distance)))
    np.testing.assert_allclose(*pictures, atol=1e-9)


@given(ANGLES, st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_project_agrees_with_a_pinhole_camera(yaw, tilt, seed):
    offsets = np.random.default_rng(seed).uniform(-1.0, 1.0, (7, 3))
    cos, sin = np.cos(tilt), np.sin(tilt)
    axes = turn(yaw) @ [[1, 0, 0], [0, cos, sin], [0, -sin, cos]]
    eye = 5.0 * axes[:, 2]
    rays = (offsets - eye) @ axes
    expected = 5.0 * rays[:, :2] / -rays[:, [2]]
    across, high, size = project(offsets, yaw, tilt, 5.0)
    np.testing.assert_allclose(np.stack([across, high], axis=1), expected, atol=1e-9)
    np.testing.assert_allclose(size, -5.0 / rays[:, 2], atol=1e-9)
    far = np.stack(project(offsets, yaw, tilt)[:2], axis=1)
    np.testing.assert_allclose(far, (offsets @ axes)[:, :2], atol=1e-9)


def test_front_yaw_sees_left_thigh_on_the_right_of_the_picture():
    thighs = [MOTION.skeleton.index(f"{side}UpLeg") for side in ("Left", "Right")]
    for yaw in np.linspace(0.0, 6.0, 7):
        nodes = NODES @ turn(yaw).T
        left, right = project(nodes, front_yaw(MOTION.skeleton, nodes))[0][thighs]
        assert left > right
