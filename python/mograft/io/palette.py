"""Colours of joint groups in files, figures and pages."""

import numpy as np

from mograft._util.arrays import FloatArray, IntArray

PALETTE = ("#3b6ea8", "#d9596b", "#2b8a57", "#b08a00", "#8a5cb8", "#2492ad", "#9c5a2e", "#6b7280")
"""Colours of the joint groups, in order; if there are more groups, the colours repeat."""


def linear_colours(group_indices: IntArray) -> FloatArray:
    """Return the colour of each group index in linear RGB, shape (n, 3), from 0 to 1."""
    srgb = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in PALETTE])
    return srgb[group_indices % len(PALETTE)] ** 2.2
