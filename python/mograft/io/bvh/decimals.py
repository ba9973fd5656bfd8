"""Decimals of the angles in BVH files."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.validate import is_integer

MAX_DECIMALS = 12
"""Largest number of decimals to which angles are rounded.

The spacing of float64 numbers near 180 is 3e-14.
"""

_SAMPLE_LENGTH = 4096  # numbers of which the decimals are counted, about
_SHARE = 0.9  # of the numbers, which the result must reproduce
_MAX_SCALED = 2.0**53  # integers below this are exact


def check_digits(digits: object) -> int:
    """Return `digits` as an int; raise ValueError unless it is an integer from 1 to 12."""
    if not is_integer(digits) or not 1 <= digits <= MAX_DECIMALS:
        raise ValueError(f"`digits` must be an integer from 1 to {MAX_DECIMALS}, got {digits!r}")
    return int(digits)


def round_numbers(numbers: FloatArray, digits: int) -> FloatArray:
    """Return numbers rounded to `digits` decimals, without negative zeros.

    Numbers of at least 2**53 / 10**digits are returned unchanged: float64 numbers of this size have
    no more decimals.
    """
    scale = 10.0**digits
    is_small = np.abs(numbers) < _MAX_SCALED / scale
    scaled = np.rint(np.where(is_small, numbers, 0.0) * scale)
    return np.where(is_small, scaled / scale + 0.0, numbers)


def count_decimals(numbers: FloatArray) -> int:
    """Return the number of decimals with which numbers were written, at most 12.

    This is the smallest number of decimals that reproduces nine tenths of the numbers that are not
    integers. The other tenth may have been written with exponents. NaN is ignored. The result is 0
    if all numbers are integers. Of more than about 4,096 numbers, only a sample is examined.
    """
    flat = numbers.ravel()
    sample = flat[:: max(1, len(flat) // _SAMPLE_LENGTH)]
    sample = sample[np.isfinite(sample) & (sample != np.rint(sample))]
    for digits in range(MAX_DECIMALS):
        if (round_numbers(sample, digits) == sample).sum() >= _SHARE * len(sample):
            return digits
    return MAX_DECIMALS
