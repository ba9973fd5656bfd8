"""Accelerations and jerks of joints against differences of whole arrays."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.body.derivatives import greatest_derivatives, world_jerk
from mograft.dancer import dance
from mograft.motion import rotations
from tests.strategies import few_examples

MOTION = dance(strides=1).motion


@few_examples(20)
@given(
    st.integers(0, 30),
    st.integers(1, 60),
    st.sets(st.integers(0, MOTION.n_joints - 1)),
    st.integers(1, 5),
)
def test_derivatives_agree_with_differences_of_arrays(start, n_frames, chosen, step):
    frames = slice(start, start + n_frames)
    motion, joints = MOTION[frames], np.array(sorted(chosen), np.int64)

    def differences(values, order):
        for _ in range(order):
            values = values[step:] - values[:-step]
        return values

    quats = motion.rotations[:, joints]
    relative = rotations.multiply(rotations.inverse(quats[:-step]), quats[step:])
    steps = 2.0 * relative[..., :3] * np.where(relative[..., 3:] < 0.0, -1.0, 1.0)
    for found, order in zip(greatest_derivatives(motion, joints, step), (1, 2), strict=True):
        lengths = np.linalg.norm(differences(steps, order), axis=-1)
        expected = np.zeros(n_frames)
        expected[step : step + len(lengths)] = lengths.max(axis=1, initial=0.0)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14)
    third = differences(motion.world_positions()[:, joints], 3)
    expected = np.zeros((n_frames, len(joints)))
    expected[step : step + len(third)] = np.linalg.norm(third, axis=-1)
    np.testing.assert_allclose(world_jerk(motion, joints, step), expected, rtol=1e-9, atol=1e-9)
    of_frames = world_jerk(MOTION, joints, step, frames)
    np.testing.assert_array_equal(of_frames, world_jerk(motion, joints, step))
