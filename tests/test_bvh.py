"""Laws of reading and writing BVH."""

import io
from pathlib import Path

import numpy as np
import pytest

import mograft as mg

DATA = Path(__file__).parents[2] / "shared" / "data"
CLIPS = sorted(DATA.glob("*/*.bvh"))


def rewritten(motion):
    file = io.BytesIO()
    mg.write_bvh(motion, file)
    file.seek(0)
    return mg.read_bvh(file)


@pytest.mark.parametrize("path", CLIPS or [None], ids=lambda path: getattr(path, "stem", "none"))
def test_recordings_come_back_as_the_numbers_that_were_read(path):
    if path is None:
        pytest.skip(f"no recordings at {DATA}")
    motion = mg.read_bvh(path)
    again = rewritten(motion)
    assert again.channel_values.tobytes() == motion.channel_values.tobytes()
    assert again.skeleton.names == motion.skeleton.names
    assert again.skeleton.offsets.tobytes() == motion.skeleton.offsets.tobytes()
    np.testing.assert_array_equal(again.rotations, motion.rotations)
