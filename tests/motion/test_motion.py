"""Laws of `Motion`."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


@given(st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_channel_blocks_of_any_length_give_the_same_numbers(length, seed):
    """Also where angles are derived from those of the frame before, or of a later frame."""
    rng = np.random.default_rng(seed)
    skeleton = Skeleton(["Hips", "Spine"], [-1, 0], [[0, 0, 0], [0, 1, 0]])
    quats = rotations.exp(rng.normal(scale=2.0, size=(12, 2, 3)))
    values = Motion(skeleton, 1 / 30, quats, rng.normal(size=(12, 2, 3))).channel_numbers()
    values[rng.random(values.shape) < 0.3] = np.nan
    values[: rng.integers(12), 6:] = np.nan
    motion = Motion(skeleton, 1 / 30, quats, np.zeros((12, 2, 3)), values)
    blocks = np.concatenate(list(motion.channel_blocks(length)))
    np.testing.assert_array_equal(blocks, motion.channel_numbers())
