"""A small BVH file, and helpers that read, rewrite and compare motions."""

import io

import numpy as np

import mograft as mg
from tests.fingerprint import fingerprint

TEXT = """\
HIERARCHY
ROOT Hips
{
	OFFSET 0.0 0.0 0.0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
	JOINT Spine
	{
		OFFSET 0.0 10.0 0.0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0.0 5.0 0.0
		}
	}
}
MOTION
Frames: 3
Frame Time: 0.04
0.0 90.0 0.0 1.5 -2.25 3.0 4.0 -5.5 6.0
0.5 90.5 1.0 2.5 -3.25 4.0 5.0 -6.5 7.0
1.0 91.0 2.0 3.5 -4.25 5.0 6.0 -7.5 8.0
"""


TEXT_VALUES = np.array([line.split() for line in TEXT.splitlines()[-3:]], dtype=float)


# The numbers of TEXT, six on each line.
REFLOWED_ROWS = "\n".join(
    " ".join(map(str, TEXT_VALUES.ravel()[n : n + 6])) for n in range(0, TEXT_VALUES.size, 6)
)


def read(text, **options):
    file = io.BytesIO(text) if isinstance(text, bytes) else io.StringIO(text)
    return mg.read_bvh(file, **options)


def round_trip(motion, **options):
    file = io.BytesIO()
    mg.write_bvh(motion, file, **options)
    file.seek(0)
    return mg.read_bvh(file, strict=False)


def assert_same_numbers(actual, desired):
    """Compare bit for bit, including the signs of zeros."""
    assert actual.shape == desired.shape
    np.testing.assert_array_equal(actual.view(np.int64), desired.view(np.int64))


def assert_same_skeleton(actual, desired):
    """Compare names, hierarchy, offsets, channels and end sites to the bit."""
    assert fingerprint(actual) == fingerprint(desired)
