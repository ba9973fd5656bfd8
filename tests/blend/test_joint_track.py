"""`joint_track`: the world track of one joint, against forward kinematics of all joints."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.blend.rigid_alignment import RootTransforms, joint_track
from tests.strategies import motions


@given(motions(max_frames=20), st.data())
def test_tracks_of_any_joint_equal_world_transforms(motion, data):
    joint = data.draw(st.integers(0, motion.n_joints - 1))
    root = RootTransforms.from_motion(motion, joint)
    expected_quats, expected_positions = (track[:, joint] for track in motion.world_transforms())
    scale = 1.0 + np.abs(motion.positions).max()
    for quats, positions in (joint_track(motion, joint), (root.rotations, root.positions)):
        np.testing.assert_allclose(quats, expected_quats, atol=1e-12)
        np.testing.assert_allclose(positions, expected_positions, atol=1e-12 * scale)
