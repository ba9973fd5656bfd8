"""The join of a loop: last frame equal to the first, continuous velocity, far frames kept."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.blend.loop_join import close_join
from mograft.blend.recombine import Part
from mograft.motion import rotations
from tests.strategies import SEEDS, assert_same_rotations, few_examples, smooth_rotations

RATE = 30.0
JOINTS = np.array([1, 2])


def open_loop(seed, n_frames, *, opposite=False):
    """A part whose ends do not meet; quaternions of one joint may change their sign on the way."""
    rng = np.random.default_rng(seed)
    quats = smooth_rotations(rng, n_frames, 2, 0.1)
    if opposite:
        quats[:, 0] = rotations.from_axis_angle(
            np.eye(3)[1], np.linspace(0.0, 2 * np.pi, n_frames) + 0.05
        )
    quats = rotations.continuous_signs(quats)
    return Part(JOINTS, quats, np.cumsum(rng.normal(size=(n_frames, 2, 3)), axis=0))


@few_examples(40)
@given(SEEDS, st.integers(8, 80), st.booleans(), st.floats(0.05, 0.5))
def test_close_join_last_frame_is_first_and_far_frames_stay(seed, n_frames, opposite, blend):
    part = open_loop(seed, n_frames, opposite=opposite)
    closed = close_join(part, RATE, blend)
    middle = (n_frames - 1) // 2
    frames = np.arange(n_frames)
    far = np.minimum(frames, n_frames - 1 - frames) > RATE * blend
    far &= frames != middle
    np.testing.assert_allclose(closed.positions[far], part.positions[far], atol=1e-12)
    assert_same_rotations(closed.rotations[far], part.rotations[far], 1e-12)
    np.testing.assert_array_equal(closed.positions[-1], closed.positions[0])
    assert_same_rotations(closed.rotations[-1], closed.rotations[0])
    assert (np.abs(closed.rotations[-1]) == np.abs(closed.rotations[0])).all()
    np.testing.assert_allclose(np.linalg.norm(closed.rotations, axis=-1), 1.0, atol=1e-12)
    if n_frames >= 30:
        # Else a writer or a player that interpolates would turn the long way round at the join.
        assert ((closed.rotations[-1] * closed.rotations[-2]).sum(axis=-1) > 0.0).all()
